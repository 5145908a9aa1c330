"""Tuning with whole flights: margins that agree with flights on either side, and a search end to end."""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from groundstation.config import load
from groundstation.settings import Config
from sim.__main__ import main
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.studies.tune import DELAY, Flyers, SortieOutcome, failure, report, sorties, stage_scenarios
from sim.studies.tune.tune import GAIN_DOWN, Sortie, fly_sortie

DURATION_S = 18.0
BAD = """
[controller]
k2 = 0.6
k3 = 1.2
kb = 0.3
kappa = 0.5
sigma_slope = 0.8
"""


def call(words: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr("sys.argv", ["groundstation-sim", *words.split()])
    return main()


def test_margins_agree_with_flights_on_either_side() -> None:
    (stage,) = stage_scenarios(["paper"], None, [])
    found = report(stage, Flyers(1), seeds=1, duration_s=DURATION_S, axes=(DELAY,))
    assert found.limit_cm == 10.0
    (margin,) = found.margins
    assert margin.fails is not None
    assert 0.0 < margin.fails - margin.holds <= 0.001
    for value, why in ((margin.holds, None), (margin.fails, margin.why)):
        late, config = prepare(SCENARIOS["paper"], [f"sim.command_delay_s={value!r}"])
        result = fly(late, config, seed=0, duration_s=DURATION_S)
        assert failure([SortieOutcome(result.verdict.rms_cm, result.why)], 10.0) == why


def test_a_configuration_that_crashes_with_nothing_wrong_has_no_margins(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "tune --report --workers 1 --seeds 1 --duration 17 --set sim.thrust_gain=0.3"
    assert call(words, monkeypatch) == 1
    assert "fails with nothing wrong" in capsys.readouterr().out


def test_processes_and_one_process_see_the_same() -> None:
    (stage,) = stage_scenarios(["paper"], None, [])
    work = sorties(stage, [3, 4], 16.5)
    with Flyers(2) as flyers:
        together = flyers.fly(work)
    assert together == [fly_sortie(sortie) for sortie in work]
    assert all(outcome.rms_cm is not None for outcome in together)


def test_flights_through_a_step_of_the_wind_last_beyond_it() -> None:
    (stage,) = stage_scenarios(["gust_front"], None, [])
    assert [sortie.duration_s for sortie in sorties(stage, [0], 20.0)] == [40.0]


def test_a_short_search_betters_bad_gains_and_writes_a_configuration_that_flies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, good = tmp_path / "bad.toml", tmp_path / "good.toml"
    bad.write_text(BAD)
    words = (
        f"tune --config {bad} --scenarios paper --seeds 1 --duration 17 --trials 5 --verify 1 --workers 1 "
        f"--out {good} --json --keys k2,k3,sigma_slope --delay-margin 0"
    )
    monkeypatch.setattr("sim.studies.tune.tune.FLOORED", (GAIN_DOWN,))
    assert call(words, monkeypatch) == 0
    facts = json.loads(capsys.readouterr().out)
    before, after = facts["evidence"]["before"], facts["evidence"]["after"]
    assert after["mean_cm"] < before["mean_cm"]
    assert facts["trials"] == 5
    assert facts["written"] == str(good)
    text = good.read_text()
    assert f"# Tuned by: groundstation-sim tune --config {bad}" in text.replace("\n# ", " ")
    assert "seeds 0 to 0, none of which the search has seen" in text.replace("\n# ", " ")
    gains = [f"controller.{name}={value}" for name, value in facts["best"]["gains"].items()]
    assert load(good, Config) == load(bad, Config, gains)
    (stage,) = stage_scenarios(["paper"], good, [])
    (outcome,) = [fly_sortie(sortie) for sortie in sorties(stage, [0], 60.0)]
    assert outcome.rms_cm == after["figures"][0]["rms_cm"]


def test_a_search_that_finds_nothing_better_says_so_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "x.toml"
    words = f"tune --scenarios paper --seeds 1 --duration 17 --trials 1 --workers 1 --out {out}"
    assert call(words, monkeypatch) == 1
    assert "none of 1 sets of gains is better" in capsys.readouterr().out
    assert not out.exists()


def test_an_interrupted_search_leaves_the_best_so_far_and_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "x.toml"
    rounds = iter([1.0, 0.5])

    def interrupted(self: Flyers, work: Sequence[Sortie]) -> list[SortieOutcome]:
        for rms_cm in rounds:
            return [SortieOutcome(rms_cm, "flown to the end")] * len(work)
        raise KeyboardInterrupt

    monkeypatch.setattr(Flyers, "fly", interrupted)
    assert call(f"tune --scenarios paper --seeds 1 --workers 1 --out {out}", monkeypatch) == 130
    assert "the same command goes on with them; the best so far is in" in capsys.readouterr().err
    assert "NOT VERIFIED" in out.read_text()
    load(out, Config)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("--duration 16", "--duration: expected more than 16 s"),
        ("--scenarios paper,quad1kg", "different vehicles"),
        ("--verify 101", "--verify: expected at most 100"),
        ("--write x.md", "--write: is for --report"),
        ("--report --out x.toml", "--out: a report writes no configuration"),
        ("--out nowhere/x.toml", "there is no such folder"),
        ("--report --write nowhere.md", "cannot read nowhere.md"),
        ("--keys k9", "--keys: expected some of"),
        ("--set controller.kind=no.such:thing", "can't import"),
        ("--config nowhere.toml", "cannot read the configuration"),
    ],
)
def test_what_cannot_be_tuned_is_refused_before_anything_flies(
    words: str, complaint: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(f"tune {words}", monkeypatch) == 2
    assert complaint in capsys.readouterr().err


def test_a_search_overwrites_neither_its_start_nor_what_no_search_has_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text(BAD)
    assert call(f"tune --config {mine} --out {mine}", monkeypatch) == 2
    assert "is the configuration to start from" in capsys.readouterr().err
    assert call(f"tune --out {mine}", monkeypatch) == 2
    assert "no search has written it" in capsys.readouterr().err
    assert mine.read_text() == BAD
