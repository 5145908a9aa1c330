"""What `make fly` shows first: figures that can be compared, and nothing that promises nothing."""

import math
import re
from functools import cache

import pytest

from sim.__main__ import main
from sim.cli.console import summary
from sim.runs import fly, simulate
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.stations import run_here
from tests.known import known


@cache
def screen(*overrides: str) -> str:
    run = simulate("paper", duration=17.0, overrides=overrides, record=False)
    return summary(run.facts, None, paper=False)


def vector(line: str, text: str) -> tuple[float, ...]:
    found = known(re.search(rf"^{line} +\((.*?)\)", text, re.MULTILINE))
    return tuple(float(part) for part in found[1].split(","))


@pytest.mark.tried(2)  # too little, and right
@pytest.mark.parametrize("wrong", [("sim.thrust_gain=0.9",), ("sim.mass_kg=0.086",), ()])
def test_what_the_law_makes_out_is_told_beside_what_it_should(wrong: tuple[str, ...]) -> None:
    """Wind, and what thrust and mass are off: λ takes a part of that, which is added to b̂."""
    text = screen(*wrong)
    true, found = vector("disturbance, true", text), vector("disturbance, estimated", text)
    assert math.dist(true, found) < 0.2
    wind = vector("wind, true", text)
    assert wind == pytest.approx((0.1, -0.05, 0.2))
    if wrong:
        assert true[2] - wind[2] > 0.5, "the vehicle sinks by more than the wind"
    else:
        assert math.dist(true, wind) < 0.05


LATE = ("sim.telemetry_hz=50", "sim.pose_latency_s=0.04")
"""Poses come 20 ms later than told, and the vehicle tells its attitude."""


def test_what_the_operator_was_warned_of_stands_on_it() -> None:
    late = r"warning: poses are [12]\d ms later than configured"
    assert re.search(rf"^told in flight, at \[s\] +\d+\.\d\d {late}", screen(*LATE), re.MULTILINE)
    assert "told in flight" not in screen()
    done = run_here(main, "mission", "--duration", "5", *(f"--set={one}" for one in LATE))
    assert done.returncode == 0
    assert re.search(rf"^ +\d+\.\d\d s +{late}", done.stdout, re.MULTILINE)


@pytest.mark.tried(3)  # latencies
@pytest.mark.parametrize(("scenario", "late_ms", "told"), [
    *(("paper", late_ms, late_ms not in (0, 8)) for late_ms in (0, 8, 15, 20, 30, -15)),
    ("rotors_mqx", 0, False),
    ("rotors_mqx", 20, True),
])  # fmt: skip
def test_a_latency_told_wrong_is_said_in_flight_by_poses_alone(
    scenario: str, late_ms: int, told: bool
) -> None:
    latency = f"sim.pose_latency_s={0.02 + 1e-3 * late_ms}"
    world, config = prepare(SCENARIOS[scenario], [latency], link="dsm")
    warnings = fly(world, config, seed=0, duration_s=15.0).warnings
    word = "later" if late_ms > 0 else "earlier"
    assert bool(warnings) is told
    said = rf"poses or the vehicle's turns are \d+ ms {word} than configured"
    assert all(re.search(said, one) for one in warnings)
