"""Arguments that can't be meant are refused in a sentence, before anything starts."""

import json
import os
import sys
from argparse import ArgumentParser
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from groundstation.__main__ import (
    COMMANDS as FLYING,
    GONE,
    MOVED,
    main as flying_main,
    parser as flying_parser,
)
from groundstation.config import ArgumentError, ConfigError, load
from groundstation.interfaces.cli import commands as flying
from groundstation.machine import RecordingConfig, tidy
from groundstation.recording import NoRecording, Recording
from groundstation.recording.records import MAGIC
from groundstation.runtime import Groups, build_parser
from groundstation.settings import Config
from sim.__main__ import (
    COMMANDS as SIMULATING,
    GONE as SIM_GONE,
    MOVED as SIM_MOVED,
    main as simulating_main,
    parser as simulating_parser,
)
from sim.cli import commands as simulating
from tests.e2e.stations import run_here


@pytest.mark.parametrize(("groups", "names", "most"), [(FLYING, 4, 20), (SIMULATING, 1, 10)])
def test_help_lists_few_commands_in_groups(groups: Groups, names: int, most: int) -> None:
    listed = [name for group in groups.values() for name in group if " " not in name]
    assert len(groups) == names and len(listed) <= most
    shown = build_parser("program", "", groups).format_help()
    assert all(f"\n  {name} " in shown for name in listed)


@pytest.mark.parametrize(
    ("parser", "groups"), [(flying_parser, FLYING), (simulating_parser, SIMULATING)]
)
def test_a_command_without_words_misses_only_what_it_requires(
    parser: Callable[[], ArgumentParser], groups: Groups, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in (name for group in groups.values() for name in group):
        with suppress(SystemExit):
            parser().parse_args(name.split())
            continue
        assert "error: the following arguments are required: " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("program", "moved"), [("groundstation", MOVED), ("groundstation-sim", SIM_MOVED)]
)
def test_an_old_spelling_is_the_command_of_today_with_a_line_of_advice(
    program: str,
    moved: dict[str, str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    main = {"groundstation": flying_main, "groundstation-sim": simulating_main}[program]
    for old, today in moved.items():
        monkeypatch.setattr(sys, "argv", [program, old, "--help"])
        with pytest.raises(SystemExit):
            main()
        shown = capsys.readouterr()
        assert shown.out.startswith(f"usage: {program} {today.partition(' --')[0]} ")
        assert shown.err.startswith(f"{program}: `{program} {old}` is now `{program} {today}`")


def test_the_old_option_of_the_scenario_still_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    args = simulating_parser().parse_args(["fly", "--scenario", "adverse"])
    assert args.scenario == simulating_parser().parse_args(["fly", "adverse"]).scenario == "adverse"
    assert "--scenario adverse is now adverse alone" in capsys.readouterr().err


FLY, SIM = flying_parser, simulating_parser
WHOLE = "expected a whole number, 0 or more, got"
SECONDS = "expected seconds, more than 0 and at most 86400"
UNKNOWN = "error: unrecognized arguments:"


@pytest.mark.parametrize(
    ("parser", "words", "complaint"),
    [
        *(
            (SIM, f"{command} --seed -1", f"--seed: {WHOLE} '-1'")
            for command in ("fly", "serve", "dev faults", "tune")
        ),
        (
            FLY,
            "request goto --vehicle mqx 0 0 -0.5",
            f"{UNKNOWN} 0 0 -0.5; write the options before or behind all other words",
        ),
        (SIM, "mission --seed 1.5", f"--seed: {WHOLE} '1.5'"),
        (SIM, "campaign --first-seed -1", f"--first-seed: {WHOLE} '-1'"),
        (SIM, "mission --seed 1_0", f"--seed: {WHOLE} '1_0'"),
        (SIM, "fly --duration 2_0", f"--duration: {SECONDS}, got '2_0'"),
        (SIM, "campaign --flights none", "expected a whole number, 1 or more, got 'none'"),
        (SIM, "fly --duration long", f"--duration: {SECONDS}, got 'long'"),
        (SIM, "compare --scenarios ,", "--scenarios: expected names between commas, got ','"),
        (SIM, "tune --gain-margin much", f"--gain-margin: {WHOLE} 'much'"),
        (FLY, "check lab.toml --seconds x", f"--seconds: {SECONDS}, got 'x'"),
        (FLY, "stop-all --nix", f"groundstation stop-all: {UNKNOWN} --nix"),
        (FLY, "config show lab.toml --nix x", f"groundstation config show: {UNKNOWN} --nix x"),
        (FLY, "request", "request: error: the following arguments are required: WHAT\n"),
    ],
)
def test_a_value_or_a_word_that_can_not_be_is_told_beside_the_usage_of_its_command(
    parser: Callable[[], ArgumentParser],
    words: str,
    complaint: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as caught:
        parser().parse_args(words.split())
    told = capsys.readouterr().err
    assert caught.value.code == 2 and complaint in told
    assert told.startswith(
        f"usage: groundstation{'-sim' if parser is SIM else ''} {words.split(maxsplit=1)[0]}"
    )


@pytest.mark.parametrize(
    ("parser", "words", "says"),
    [
        (SIM, "compare --controllers bogus", "^--controllers: expected one of .* got 'bogus'$"),
        (SIM, "tune --report --duration 16", r"^--duration: .* more than 16 .* got 16\.0: only"),
        (SIM, "compare --trials 3", "^--trials: is for --equal-margins alone: leave it out$"),
        (SIM, "compare --equal-margins --scenarios paper", "^--scenarios: is told by --equal-"),
        (SIM, "compare --equal-margins --controllers a:b", "^--controllers: expected some of"),
        (FLY, "check examples/loopback.toml --seconds 3", "^--seconds: is for --watch"),
        (FLY, "logs /there/a.mcap", "^logs: expected CONFIG.toml or a folder; .* report .*a.mcap"),
    ],
)
def test_what_can_not_be_meant_is_refused_by_its_option_before_anything_starts(
    parser: Callable[[], ArgumentParser], words: str, says: str
) -> None:
    args = parser().parse_args(words.split())
    commands = flying if parser is flying_parser else simulating
    with pytest.raises(ConfigError, match=says):
        getattr(commands, words.split(maxsplit=1)[0])(args)


@pytest.mark.parametrize(
    ("program", "line", "advice"),
    [
        (flying_main, "export LOG.mcap --format rrd", "`groundstation view` shows a recording"),
        (flying_main, "evidence LOG.mcap --write page.md", "`--json` has the figures"),
        (flying_main, "report README.md --format=html,tex", "`--format csv` has the table"),
        (simulating_main, "fly paper --view", "`groundstation view DIR/flight.mcap` shows the"),
        (simulating_main, "dev states", "`dev reference` draws its diagram"),
    ],
)
def test_words_that_are_gone_are_followed_by_what_to_do_instead(
    program: Callable[[], int], line: str, advice: str
) -> None:
    done = run_here(program, *line.split())
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 2 and last.startswith("`") and f"` is gone: {advice}" in last


def test_a_command_whose_options_hold_the_words_of_one_that_is_gone_gets_no_advice() -> None:
    done = run_here(simulating_main, "dev", "faults", "--kind", "honest", "--forced", "nothing")
    assert done.returncode == 2 and "is gone" not in done.stderr


@pytest.mark.parametrize(("parser", "gone"), [(FLY, GONE), (SIM, SIM_GONE)])
def test_what_is_said_to_be_gone_is_gone(
    parser: Callable[[], ArgumentParser], gone: dict[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    read_later = {"report --format tex", "report --format png"}  # a list: by the command itself
    made = parser()
    for spelling in gone.keys() - read_later:
        with pytest.raises(SystemExit, match="2"):
            made.parse_args([*spelling.split(), "x"])
        told = capsys.readouterr().err
        assert "unrecognized arguments" in told or "invalid choice" in told


def test_a_controller_that_there_is_not_is_blamed_on_the_option_that_named_it() -> None:
    for words in ([], ["--config", "examples/loopback.toml"]):
        with pytest.raises(
            ArgumentError, match=r"^controller: expected one of \['adaptive', .* got 'bogus'"
        ) as caught:
            simulating.fly(simulating_parser().parse_args(["fly", *words, "--controller", "bogus"]))
        assert caught.value.option == "--controller"
    with pytest.raises(ConfigError, match=r"^--set: controller.kind: "):
        simulating.fly(simulating_parser().parse_args(["fly", "--set", "controller.kind=bogus"]))


@pytest.mark.parametrize(
    ("overrides", "key"),
    [
        (["pose.listen=foo"], "pose.listen"),
        (["pose.kind=qualisys", "pose.server=foo"], "pose.server"),
        (["pose.kind=natnet", "pose.server=foo"], "pose.server"),
        (["link.remote=foo"], "link.remote"),
        (["link.tcp=foo"], "link.tcp"),
    ],
)
def test_an_address_that_is_none_is_blamed_by_its_dotted_key(
    overrides: list[str], key: str
) -> None:
    with pytest.raises(ConfigError, match=f"^--set: {key}: 'foo' is not an address"):
        load(None, Config, overrides)


def test_a_recording_of_a_few_bytes_is_listed_as_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "short.mcap").write_bytes(MAGIC + b"\x01")
    assert flying.logs(flying_parser().parse_args(["logs", str(tmp_path)])) == 0
    says = "short.mcap  is no recording of a flight, or was cut off before it began"
    assert says in capsys.readouterr().out


def test_a_link_to_a_file_that_is_gone_and_a_pipe_are_no_recordings(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    gone, pipe, short = (tmp_path / f"20260101-12000{second}-mqx.mcap" for second in range(3))
    gone.symlink_to("gone")
    os.mkfifo(pipe)
    short.write_bytes(MAGIC + b"\x01")
    assert flying.logs(flying_parser().parse_args(["logs", str(tmp_path), "--json"])) == 0
    assert [row["file"] for row in json.loads(capsys.readouterr().out)["flights"]] == [short.name]
    assert tidy(RecordingConfig(folder=str(tmp_path), keep_days=1.0), 2e9) == []
    with pytest.raises(NoRecording, match=r"is a pipe, .*: write it to a file first"):
        Recording(pipe)


def test_a_folder_that_the_configuration_names_may_come_with_the_first_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = flying_parser().parse_args(["logs", "--set", f"recording.folder={tmp_path / 'later'}"])
    assert flying.logs(args) == 0
    assert "0 flights" in capsys.readouterr().out


def test_a_folder_is_listed_with_the_flights_that_have_folders_of_their_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("20260101-120000-mqx.mcap", "paper/flight.mcap", "paper/deeper/flight.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert flying.logs(flying_parser().parse_args(["logs", str(tmp_path), "--json"])) == 0
    found = json.loads(capsys.readouterr().out)
    listed = ["20260101-120000-mqx.mcap", "paper/flight.mcap"]
    assert [row["file"] for row in found["flights"]] == listed
