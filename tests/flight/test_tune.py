"""Tuning with whole flights: a search end to end, and refusals before anything flies."""

import subprocess
from pathlib import Path

import pytest

from sim.__main__ import main
from sim.studies.tune import SortieOutcome, sorties, stage_scenarios, tune
from sim.studies.tune.tune import Sortie
from tests.e2e.stations import run_here


def call(words: str) -> "subprocess.CompletedProcess[str]":
    return run_here(main, "tune", *words.split())


def test_a_configuration_that_crashes_with_nothing_wrong_has_no_margins() -> None:
    done = call("--report --workers 1 --seeds 1 --duration 17 --set sim.thrust_gain=0.3")
    assert done.returncode == 1
    assert "fails with nothing wrong" in done.stdout


def test_flights_through_a_step_of_the_wind_last_beyond_it() -> None:
    (stage,) = stage_scenarios(["gust_front"], None, [])
    assert [sortie.duration_s for sortie in sorties(stage, [0], 20.0)] == [40.0]


def test_an_interrupted_search_says_how_to_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, flown = tmp_path / "x.toml", list[Sortie]()

    def come_to(sortie: Sortie) -> SortieOutcome:
        flown.append(sortie)
        if len(flown) > 12:
            raise KeyboardInterrupt
        return SortieOutcome(1.0 / len(flown), "flown to the end")

    monkeypatch.setattr(tune, "fly_sortie", come_to)
    words = f"--scenarios paper --seeds 1 --workers 1 --verify 1 --out {out}"
    done = call(words)
    assert done.returncode == 130
    assert "the same command goes on with them, or with --trials N ends at N" in done.stderr
    assert not out.exists()
    monkeypatch.setattr(tune, "fly_sortie", lambda _: SortieOutcome(0.5, "flown to the end"))
    done = call(f"{words} --trials 3")
    assert done.returncode == 1, "no better on other seeds"
    assert done.stdout.startswith("trial 2 of 3:")
    assert "NOT to be used, and not written" in done.stdout


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("--scenarios paper,quad1kg", "different vehicles"),
        ("--verify 101", "--verify: expected at most 100"),
        ("--write x.md", "--write: is for --report"),
        ("--report --out x.toml", "--out: a report writes no configuration"),
        ("--out nowhere/x.toml", "there is no such folder"),
        ("--report --write nowhere.md", "cannot read nowhere.md"),
        ("--set controller.kind=no.such:thing", "can't import"),
        ("--config nowhere.toml", "cannot read the configuration"),
        ("--config {mine} --out {mine}", "is the configuration to start from"),
        ("--out {mine}", "no search has written it"),
    ],
)
def test_a_wrong_search_is_refused_before_it_flies(
    words: str, complaint: str, tmp_path: Path
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("[controller]\nk2 = 0.6\n")
    done = call(words.format(mine=mine))
    assert done.returncode == 2
    assert complaint in done.stderr
    assert mine.read_text() == "[controller]\nk2 = 0.6\n"
