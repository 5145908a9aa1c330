"""Contract of every controller, by a table; the example of docs/how-to is one of them."""

import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import pytest

from groundstation.config import ConfigError, UserCodeFault
from groundstation.core.control import Custom, make_controller
from groundstation.core.control.controllers import Guarded
from groundstation.core.messages import Controller, Decision, Estimate, Tick
from groundstation.core.trajectory import Reference, TrajectoryConfig
from groundstation.core.trajectory.shapes import HoldConfig
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle
from groundstation.settings import Config
from sim.runs import fly
from sim.runs.flight import Result
from sim.scenarios import SCENARIOS, prepare
from sim.world import World
from tests.flight.flights import ticks_to

PAGE = Path(__file__).parents[2] / "docs/how-to/own-controller.md"
(CODE,) = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text("utf-8"), re.M | re.S)
EXAMPLE = "leaning:make"
QUICK = [f"{room}.frame_period_s=0.01" for room in ("sim", "vehicle")]
QUICK += ["sim.pose_rate_hz=100.0", "pose.rate_hz=100.0"]
DURATION_S = 7.0
YAW_DEG = 20.0

# Largest error over the last second [cm], without noise and lag, in steady wind, from 1.8 m away.
REACHES_CM = {
    "adaptive": 0.05,
    "uncompensated": 0.5,
    "geometric": 3.0,
    "l1": 3.0,
    "pid": 0.5,
    "indi": 0.1,
    EXAMPLE: 1.5,
}


class Watched(NamedTuple):
    result: Result
    ticks: list[Tick]
    last_cm: float
    vehicle: Vehicle


@pytest.fixture(autouse=True, scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The code of the page, where Python finds it."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "leaning.py").write_text(CODE, "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield


def told(kind: str, *overrides: str, scenario: str = "ideal") -> tuple[World, Config]:
    quick = QUICK if scenario == "ideal" else []
    return prepare(SCENARIOS[scenario], [*quick, *overrides, f"controller.kind={kind}"])


def watched(world: World, config: Config, duration_s: float = DURATION_S) -> Watched:
    ticks: list[Tick] = []
    result = fly(world, config, seed=5, duration_s=duration_s, watch=ticks_to(ticks.append))
    start = ticks[0].estimate.time_s - ticks[0].flight_time_s
    errors = result.track.errors(config.trajectory.build(), start, since_s=start + duration_s - 1.0)
    return Watched(result, ticks, 100.0 * max(errors), config.vehicle)


def trajectories(config: Config) -> dict[str, TrajectoryConfig]:
    return {
        "hover": HoldConfig(position_ned=(0.3, -0.3, -0.5), yaw_deg=YAW_DEG),
        "lemniscate": config.trajectory,
    }


@pytest.mark.tried(6)  # each controller once
@pytest.mark.parametrize("kind", REACHES_CM)
@pytest.mark.parametrize("path", ["hover", "lemniscate"])
def test_a_controller_reaches_and_follows_its_reference_within_the_limits(
    kind: str, path: str
) -> None:
    world, config = told(kind)
    config = msgspec.structs.replace(config, trajectory=trajectories(config)[path])
    flight = watched(world, config)
    assert flight.result.completed, flight.result.why
    assert flight.last_cm < REACHES_CM[kind]
    b_hat = flight.ticks[-1].decision.diagnostics.b_hat
    assert b_hat == pytest.approx(world.wind_mean, abs=0.02)
    w, _, _, z = flight.ticks[-1].estimate.motion.attitude
    yaw_deg = YAW_DEG if path == "hover" else 0.0
    assert math.degrees(2.0 * math.atan2(z, w)) == pytest.approx(yaw_deg, abs=0.3)
    assert_within_limits(flight)


def assert_within_limits(flight: Watched) -> None:
    vehicle = flight.vehicle
    limits = [math.radians(limit) for limit in vehicle.rate_limits_deg_s]
    for tick in flight.ticks:
        thrust, rates = tick.decision.drive
        assert all(map(math.isfinite, (thrust, *rates)))
        assert vehicle.thrust_min_n <= thrust <= vehicle.thrust_max_n
        assert all(abs(rate) <= limit for rate, limit in zip(rates, limits, strict=True))


@pytest.mark.parametrize("kind", REACHES_CM)
def test_a_controller_flies_the_real_limits_and_the_same_flight_again_bit_by_bit(kind: str) -> None:
    world, config = told(kind, scenario="adverse")
    once, again = (watched(world, config, 3.0) for _ in range(2))
    assert_within_limits(once)
    assert once.result.log_sha256 == again.result.log_sha256
    assert [tick.decision for tick in once.ticks] == [tick.decision for tick in again.ticks]


def test_the_example_flies_the_papers_figure_eight_and_holds_a_point_as_the_page_says() -> None:
    assert "within 2 cm RMS" in PAGE.read_text("utf-8")
    for path in ("hover", "lemniscate"):
        world, config = told(EXAMPLE, scenario="paper")
        config = msgspec.structs.replace(config, trajectory=trajectories(config)[path])
        verdict = fly(world, config, seed=0, duration_s=20.0).verdict
        assert verdict.rms_cm is not None and verdict.rms_cm < 2.0


# ---- a controller of the user's own


def test_keys_beside_a_factory_go_to_it_but_the_estimators_stay() -> None:
    beside = ("stiffness=8.0", "wind_noise=0.3", "options.gravity=9.7")
    controller = told(EXAMPLE, *(f"controller.{key}" for key in beside))[1].controller
    assert isinstance(controller, Custom)
    assert (controller.kind, controller.options) == (EXAMPLE, {"gravity": 9.7, "stiffness": 8.0})
    assert (controller.wind_noise, controller.gravity) == (0.3, 9.81)


LAB = """
THING = 3
class Nothing: pass
def no_controller(vehicle, options): return Nothing()
def picky(vehicle, options): raise ValueError("stiffness must be positive")
"""

REFUSED = [
    ("nosuchlab:make", "can't import nosuchlab: ModuleNotFoundError: No module named 'nosuchlab'"),
    ("brokenlab:make", "can't import brokenlab: ZeroDivisionError: division by zero"),
    ("goodlab:make", "goodlab has no attribute 'make'"),
    (
        "goodlab:THING",
        "goodlab:THING is not callable: expected factory(vehicle, options) -> Controller",
    ),
    ("goodlab:picky", "goodlab:picky failed: ValueError: stiffness must be positive"),
    (
        "goodlab:no_controller",
        "goodlab:no_controller made a Nothing without decide(estimate, reference, interval_s)",
    ),
]


@pytest.mark.parametrize(("kind", "line"), REFUSED, ids=[kind for kind, _ in REFUSED])
def test_a_factory_that_makes_no_controller_is_refused_by_key_and_cause(
    kind: str, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "goodlab.py").write_text(LAB, "utf-8")
    (tmp_path / "brokenlab.py").write_text("1 / 0\n", "utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    _, config = told(kind)
    with pytest.raises(ConfigError) as caught:
        make_controller(config.controller, config.vehicle)
    assert str(caught.value).startswith(f"controller.kind: {line}")


@pytest.mark.parametrize("kind", ["pidd", "lab:", ":make", "lab make:x", "lab.py/make"])
def test_a_name_that_is_no_controller_is_refused_with_those_that_are(kind: str) -> None:
    says = r"controller\.kind: expected one of \['adaptive', .*'package.module:factory'"
    with pytest.raises(ConfigError, match=says):
        told(kind)


def test_an_option_that_is_no_number_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"controller\.options\.stiffness: .* got nan"):
        told(EXAMPLE, "controller.stiffness=nan")


class Answers:
    """Says what it is told to say."""

    def __init__(self, answer: Callable[[Decision], Any]) -> None:
        self._answer = answer

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Any:
        """An answer made from a good one."""
        _, config = told("pid")
        good = make_controller(config.controller, config.vehicle)
        return self._answer(good.decide(estimate, reference, interval_s))


def asked(answer: Callable[[Decision], Any]) -> Decision:
    place, still = (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)
    motion = Motion(place, still, (1.0, 0.0, 0.0, 0.0), 0.08 * 9.81, still)
    controller: Controller = Guarded(Answers(answer), Vehicle(), "lab:make")
    return controller.decide(Estimate(0.0, motion, still, still), Reference(place), 0.02)


NOT_A_DRIVE: Any = None
TWO_RATES: Any = (0.7, (0.0, 0.0))
BAD_ANSWERS: dict[str, Callable[[Decision], Any]] = {
    "nothing": lambda good: None,
    "a bare tuple": lambda good: (0.7, (0.0, 0.0, 0.0)),
    "a drive of two rates": lambda good: ActuatorCommand(0.7, TWO_RATES[1]),
    "no drive": lambda good: good._replace(drive=NOT_A_DRIVE),
    "NaN thrust": lambda good: good._replace(drive=ActuatorCommand(math.nan, (0.0, 0.0, 0.0))),
    "infinite rate": lambda good: good._replace(drive=ActuatorCommand(0.7, (0.0, math.inf, 0.0))),
    "two rates": lambda good: good._replace(drive=TWO_RATES),
}


@pytest.mark.parametrize("answer", BAD_ANSWERS.values(), ids=BAD_ANSWERS)
def test_an_answer_that_is_no_command_ends_the_flight(answer: Callable[[Decision], Any]) -> None:
    with pytest.raises(UserCodeFault, match="controller lab:make"):
        asked(answer)


@pytest.mark.parametrize("alone", [False, True])
def test_a_command_beyond_the_limits_is_clamped_and_marked_also_where_it_is_all_of_the_answer(
    alone: bool,
) -> None:
    drive, vehicle = ActuatorCommand(99.0, (-99.0, 0.1, 99.0)), Vehicle()
    decision = asked(lambda good: drive if alone else good._replace(drive=drive, saturated=False))
    assert decision.drive.thrust == vehicle.thrust_max_n
    assert decision.drive.rates == pytest.approx((-math.radians(200.0), 0.1, math.radians(300.0)))
    assert decision.saturated
    assert not alone or decision.diagnostics.certificate.startswith("none")


def test_a_good_answer_passes_unchanged() -> None:
    decision = asked(lambda good: good)
    assert decision.drive.thrust == pytest.approx(0.08 * 9.81)
    assert not decision.saturated
