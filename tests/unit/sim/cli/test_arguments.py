"""Arguments that can't be meant are refused in a sentence, before anything starts."""

import json
import sys
from argparse import ArgumentParser
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.__main__ import COMMANDS as FLYING
from groundstation.__main__ import MOVED
from groundstation.__main__ import main as flying_main
from groundstation.__main__ import parser as flying_parser
from groundstation.config import ArgumentError, ConfigError, load
from groundstation.interfaces.cli import commands as flying
from groundstation.recording.records import MAGIC
from groundstation.runtime import Groups, build_parser
from groundstation.settings import Config
from links.bridge import BridgeConfig
from sim.__main__ import COMMANDS as SIMULATING
from sim.__main__ import MOVED as SIM_MOVED
from sim.__main__ import main as simulating_main
from sim.__main__ import parser as simulating_parser
from sim.cli import commands as simulating

BRIDGE = """
listen = "127.0.0.1:14600"
[link]
kind = "dsm"
port = "/dev/ttyUSB0"
"""


@pytest.mark.parametrize(("groups", "names", "most"), [(FLYING, 4, 20), (SIMULATING, 1, 10)])
def test_help_lists_few_commands_in_groups(groups: Groups, names: int, most: int) -> None:
    listed = [name for group in groups.values() for name in group if " " not in name]
    assert len(groups) == names and len(listed) <= most
    shown = build_parser("program", "", groups).format_help()
    assert all(f"\n  {name} " in shown for name in listed)


@pytest.mark.parametrize(("program", "moved"), [("groundstation", MOVED), ("groundstation-sim", SIM_MOVED)])
def test_an_old_spelling_is_the_command_of_today_with_a_line_of_advice(
    program: str, moved: dict[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    main = {"groundstation": flying_main, "groundstation-sim": simulating_main}[program]
    for old, today in moved.items():
        monkeypatch.setattr(sys, "argv", [program, old, "--help"])
        with pytest.raises(SystemExit):
            main()
        shown = capsys.readouterr()
        assert shown.out.startswith(f"usage: {program} {today} ")
        assert shown.err.startswith(f"{program}: `{program} {old}` is now `{program} {today}`")


def test_the_old_option_of_the_scenario_still_names_it(capsys: pytest.CaptureFixture[str]) -> None:
    args = simulating_parser().parse_args(["fly", "--scenario", "adverse"])
    assert args.scenario == simulating_parser().parse_args(["fly", "adverse"]).scenario == "adverse"
    assert "--scenario adverse is now adverse alone" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["fly", "serve", "mission", "dev faults", "tune"])
@pytest.mark.parametrize("seed", ["-1", "1.5", "seven"])
def test_a_seed_is_a_whole_number(command: str, seed: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        simulating_parser().parse_args([*command.split(), "--seed", seed])
    assert caught.value.code == 2
    assert f"argument --seed: expected a whole number from 0 on, got {seed}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("campaign --first-seed -1", "--first-seed: expected a whole number from 0 on, got -1"),
        ("campaign --flights none", "--flights: expected a whole number from 1 on, got none"),
        ("fly --duration long", "--duration: expected seconds, more than 0 and at most 86400, got long"),
        ("compare --scenarios ,", "--scenarios: expected names between commas, got ','"),
        ("tune --gain-margin much", "--gain-margin: expected percent from 0 to below 90, got much"),
    ],
)
def test_numbers_are_refused_with_what_is_expected(
    words: str, complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        simulating_parser().parse_args(words.split())
    assert complaint in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["stop-all", "--nix"], "groundstation stop-all: error: unrecognized arguments: --nix"),
        (
            ["config", "show", "lab.toml", "--nix", "more"],
            "groundstation config show: error: unrecognized arguments: --nix more",
        ),
        (["request"], "groundstation request: error: the following arguments are required: WHAT\n"),
    ],
)
def test_a_word_too_many_or_too_few_is_told_beside_the_usage_of_its_command(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        flying_parser().parse_args(words)
    told = capsys.readouterr().err
    assert caught.value.code == 2 and says in told
    assert told.startswith(f"usage: groundstation {words[0]}")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--controllers", "bogus"], r"^--controllers: expected one of \['adaptive', .* got 'bogus'$"),
        (["--table", "found.csv"], "^--table: is for --equal-margins$"),
        (["--trials", "3"], "^--trials: is for --equal-margins$"),
    ],
)
def test_a_comparison_that_can_not_be_meant_flies_nothing(words: list[str], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        simulating.compare(simulating_parser().parse_args(["compare", *words]))


def test_seconds_of_the_ground_station_are_a_number(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        flying_parser().parse_args(["check", "lab.toml", "--seconds", "x"])
    assert "--seconds: expected seconds, more than 0 and at most 86400, got x" in capsys.readouterr().err


def test_a_controller_that_there_is_not_is_blamed_on_the_option_that_named_it() -> None:
    for words in ([], ["--config", "examples/loopback.toml"]):
        with pytest.raises(ArgumentError, match=r"^controller: expected one of \['adaptive', .* got 'bogus'") as caught:
            simulating.fly(simulating_parser().parse_args(["fly", *words, "--controller", "bogus"]))
        assert caught.value.option == "--controller"
    with pytest.raises(ConfigError, match=r"^--set: controller.kind: "):
        simulating.fly(simulating_parser().parse_args(["fly", "--set", "controller.kind=bogus"]))


@pytest.mark.parametrize(
    ("param", "complaint"),
    [
        ("FOO", "--param: expected NAME=VALUE, got 'FOO'"),
        ("FOO=1", "--param: expected one of "),
        ("COM_OBL_RC_ACT=much", "--param: COM_OBL_RC_ACT=much: "),
    ],
)
def test_a_parameter_of_the_simulated_autopilot_is_a_name_and_a_value(param: str, complaint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        simulating.serve(simulating_parser().parse_args(["serve", "--param", param]))
    assert str(caught.value).startswith(complaint)


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
def test_an_address_that_is_none_is_blamed_by_its_dotted_key(overrides: list[str], key: str) -> None:
    with pytest.raises(ConfigError, match=f"^--set: {key}: 'foo' is not an address: it has no port"):
        load(None, Config, overrides)


def test_an_address_that_is_none_is_blamed_by_its_key_in_the_bridges_file_too(tmp_path: Path) -> None:
    file = tmp_path / "bridge.toml"
    file.write_text(BRIDGE, "utf-8")
    with pytest.raises(ConfigError, match=r"^--set: listen: 'foo' is not an address: it has no port"):
        load(file, BridgeConfig, ["listen=foo"])
    file.write_text(BRIDGE.replace("127.0.0.1:14600", "bar"), "utf-8")
    with pytest.raises(ConfigError, match=r"bridge\.toml: listen: 'bar' is not an address"):
        load(file, BridgeConfig)


def test_the_list_of_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for name, what in (("nope", "does not exist"), ("file", "is no folder")):
        args = flying_parser().parse_args(["logs", "--folder", str(tmp_path / name)])
        with pytest.raises(ConfigError, match=f"^--folder: .*{name} {what}$"):
            flying.logs(args)


def test_the_list_of_a_file_says_what_tells_of_one_flight(tmp_path: Path) -> None:
    args = flying_parser().parse_args(["logs", str(tmp_path / "flight.mcap")])
    with pytest.raises(ConfigError, match=r"^logs: expected CONFIG.toml or a folder; .*`groundstation report .*flight"):
        flying.logs(args)


def test_a_recording_of_a_few_bytes_is_listed_as_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "short.mcap").write_bytes(MAGIC + b"\x01")
    assert flying.logs(flying_parser().parse_args(["logs", str(tmp_path)])) == 0
    assert "short.mcap  is no recording of a flight, or was cut off before it began" in capsys.readouterr().out


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
    assert [row["file"] for row in found["flights"]] == ["20260101-120000-mqx.mcap", "paper/flight.mcap"]


def test_how_long_to_watch_is_refused_where_nothing_is_watched(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").touch()
    args = flying_parser().parse_args(["check", str(tmp_path / "lab.toml"), "--seconds", "3"])
    with pytest.raises(ConfigError, match=r"^--seconds: is for --watch"):
        flying.check(args)


def test_a_flight_that_leaves_no_recording_is_not_viewed() -> None:
    with pytest.raises(ConfigError, match=r"^--view: shows what was recorded: expected --out DIR beside it$"):
        simulating.fly(simulating_parser().parse_args(["fly", "--view"]))


@pytest.mark.parametrize("parser", [flying_parser, simulating_parser], ids=["flying", "simulating"])
def test_a_file_behind_view_is_told_where_view_stands(
    parser: Callable[[], ArgumentParser], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        parser().parse_args(["fly", "--view", "room.toml"])
    assert "'room.toml' is no viewer: expected rerun or foxglove, or --view at the very end" in capsys.readouterr().err
