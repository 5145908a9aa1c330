"""What `make fly` shows first: figures that can be compared, and nothing that promises nothing."""

import re
import sys
from functools import cache

import pytest

from sim.__main__ import main
from sim.cli.console import summary
from sim.runs import simulate


@cache
def screen(controller: str = "adaptive") -> str:
    return summary(simulate("paper", controller=controller, duration=18.0, record=False).facts, None, paper=False)


def wind(line: str, text: str) -> tuple[float, ...]:
    found = re.search(rf"wind, {line} +\((.*?)\)", text)
    assert found is not None
    return tuple(float(part) for part in found[1].split(","))


def test_the_wind_that_the_law_takes_for_weak_thrust_is_added_to_what_it_calls_wind() -> None:
    run = simulate("paper", duration=18.0, overrides=("sim.thrust_gain=0.9",), record=False).facts
    text = summary(run, None, paper=False)
    assert wind("estimated", text) == pytest.approx(run["wind_found"], abs=1e-3)
    taken = 9.81 * (1.0 - run["thrust_effectiveness"])
    assert taken > 0.5, "the thrust is a tenth weaker, and the law has found most of it"
    assert run["wind_found"][2] - run["wind_estimate"][2] == pytest.approx(taken, rel=0.2)


def test_a_controller_without_v_says_so() -> None:
    assert re.search(r"V above its bound +–$", screen("pid"), re.MULTILINE)
    assert re.search(r"V above its bound +\d", screen())


def test_no_line_tells_of_a_bound_that_promises_nothing() -> None:
    assert not re.search("promises nothing|a priori", screen())


@pytest.mark.parametrize(
    ("words", "its"),
    [([], True), (["--seed", "7"], True), (["--controller", "pid"], False), (["--scenario", "fast"], False),
     (["--set", "sim.wind_mean=[1,0,0]"], False), (["--source", "natnet"], False)],
)  # fmt: skip
def test_the_papers_figures_stand_only_beside_its_own_flight(
    words: list[str], its: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["groundstation-sim", "fly", "--duration", "1", *words])
    main()
    assert ("4.61 cm" in capsys.readouterr().out) is its
