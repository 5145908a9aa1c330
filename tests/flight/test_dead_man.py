"""A controller that fails in flight: frames that leave are fresh, or the bring-down, or none."""

import asyncio
import math
import random
from typing import Any

import pytest

from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import Ask, Request
from groundstation.core.mission import State
from groundstation.flight import Flight
from groundstation.flight.command_loop import Pacing, StallDetector
from groundstation.machine import sleep_until
from links.io import Sleep
from sim.runs import Stage
from sim.runs.flight import Script
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import Wire, after, fly_beside, flying, nothing
from tests.known import known

BREAKS = ("controller.kind=tests.e2e.misbehaving:make", "controller.fault=raise")


def check(wire: Wire, thrust_max_n: float) -> None:
    """Every frame is that of the newest command before its deadline, or its due part."""
    share = [c.thrust_n / thrust_max_n for _, c in wire.commands]
    index = -1
    for time_s, thrust, rates in wire.frames:
        if time_s <= wire.commands[0][0]:  # the last idle one may have left just then
            continue
        while index + 1 < len(wire.commands) and wire.commands[index + 1][0] <= time_s:
            index += 1
        if wire.commands[index][0] == time_s and thrust != pytest.approx(share[index], abs=1e-6):
            index -= 1  # repeated in the very instant in which the next one came
        command = wire.commands[index][1]
        if thrust == 0.0 and wire.state is State.LANDED:
            continue
        if time_s <= command.deadline_s:
            assert thrust == pytest.approx(share[index], abs=1e-6)
            assert rates == pytest.approx(command.rates_rad_s, abs=1e-6)
            continue
        assert index == len(wire.commands) - 1 or wire.state is State.LANDED
        end = command.deadline_s
        for part in command.bring_down:
            end += part.duration_s
            if time_s <= end:
                assert thrust == pytest.approx(part.thrust_n / thrust_max_n, abs=1e-6)
                assert rates == pytest.approx(part.rates_rad_s, abs=1e-6)
                break
        else:
            raise AssertionError(
                f"a frame left at {time_s:.3f}, {time_s - end:.3f} s after the bring-down"
            )


def fly(
    script: Script, *overrides: str, scenario: str = "paper", seed: int = 0, pace: str = "period"
) -> Wire:
    """A flight with every frame checked; PX4's own failsafe comes later than it ends."""
    told = (*overrides, f"link.pace={pace}")
    late = {"COM_OF_LOSS_T": 1.0}
    wire = fly_beside(script, *told, scenario=scenario, seed=seed, parameters=late)
    if wire.commands:
        _, config = prepare(SCENARIOS[scenario], list(told))
        check(wire, config.vehicle.thrust_max_n)
    return wire


@pytest.mark.parametrize("pace", ["period", "poses"])
def test_a_controller_that_raises_is_survived_by_its_link(pace: str) -> None:
    wire = fly(nothing, *BREAKS, "controller.after_s=2.0", pace=pace)
    assert wire.state is State.ABORTED
    failed = "controller tests.e2e.misbehaving:make failed: ArithmeticError: the controller broke"
    assert wire.reason == f"stopped by UserCodeFault: {failed}"
    assert any("the bring-down is over" in line for line in wire.lines)
    _, command = wire.commands[-1]
    assert wire.frames[-1][0] == pytest.approx(
        command.deadline_s + sum(p.duration_s for p in command.bring_down), abs=0.03
    )
    assert wire.frames[-1][1] == 0.0
    assert known(wire.stage.plant.floor.touchdown_m_s) < 2.0


@pytest.mark.tried(4)  # random instants
@pytest.mark.parametrize("seed", range(16))
def test_a_controller_that_stands_still_at_any_instant_for_any_time(seed: int) -> None:
    """It hangs in an await: all else goes on, poses come in unless the cameras are covered."""
    draw = random.Random(seed)
    at_s = draw.uniform(0.0, 7.0)
    lasts_s = draw.choice([draw.uniform(0.0, 0.5), draw.uniform(0.3, 4.0)])
    covered, pace = draw.random() < 0.3, draw.choice(["period", "poses"])
    monkeypatch = pytest.MonkeyPatch()

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, at_s)
        until = asyncio.get_running_loop().time() + lasts_s
        known(stage.mocap).cover(covered)

        async def stuck(*_: Any) -> None:
            await sleep_until(until)

        with monkeypatch.context() as patch:
            patch.setattr(Pacing, "next", stuck)
            await sleep_until(until)
        known(stage.mocap).cover(False)

    low = ("flight.duration_s=5.0", "trajectory.altitude_m=0.2", "flight.descent_m_s=1.0")
    wire = fly(script, *low, pace=pace)
    if lasts_s < 0.2 and not covered:
        assert wire.state is State.LANDED, wire.reason
    if 0.0 < at_s < 4.5 and lasts_s > 0.3:
        assert wire.state is State.ABORTED
        assert "bring-down" in wire.reason or "without it" in wire.reason
        assert wire.frames[-1][1] == 0.0


async def never(*_: Any) -> None:
    await asyncio.Event().wait()


HANGS = "the controller hangs: the link has brought the vehicle down without it"
SLEPT = "the sending computer slept for 600.0 s: arm again to fly"


@pytest.mark.parametrize(
    ("owner", "name", "wrong", "reason", "leaves_s"),
    [
        (Pacing, "next", never, HANGS, math.inf),
        (Sleep, "slept_s", 600.0, SLEPT, 0.0),
        # Poses are read all at once afterwards; a Vicon datagram does not tell how long it waited.
        (StallDetector, "detect_stale", lambda *_: True, "no pose for", math.inf),
    ],
    ids=["hangs for ever", "wakes from sleep", "stood still"],
)
def test_a_program_that_fails_ends_the_flight_and_says_why(
    owner: type, name: str, wrong: object, reason: str, leaves_s: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    wire = fly(after(2.0, lambda *_: monkeypatch.setattr(owner, name, wrong)))
    assert wire.state is State.ABORTED
    assert wire.reason.startswith(reason)
    assert wire.frames[-1].time_s <= wire.begun_s + 2.0 + leaves_s + 1e-6


def test_a_flight_that_is_stopped_is_brought_down_and_cannot_be_hurried() -> None:
    async def script(flight: Flight, _: Stage) -> None:
        await flying(flight, 3.0)
        for _again in range(5):
            flight.stop("told twice")
            await asyncio.sleep(0.1)

    wire = fly(script)
    assert (wire.state, wire.reason) == (State.ABORTED, "told twice")
    _, command = wire.commands[-1]
    assert wire.frames[-1][0] > command.deadline_s + 1.5
    assert wire.frames[-1][1] == 0.0


@pytest.mark.parametrize("after_stop_s", [None, 1.0])
def test_a_kill_stops_the_motors_in_flight_and_in_the_bring_down(
    after_stop_s: float | None,
) -> None:
    when: list[float] = []

    async def script(flight: Flight, _: Stage) -> None:
        await flying(flight, 3.0)
        if after_stop_s is not None:
            flight.stop("first")
            await asyncio.sleep(after_stop_s)
        when.append(asyncio.get_running_loop().time())
        flight.ask(Request(Ask.KILL, "told to"))

    wire = fly(script)
    assert wire.state is State.KILLED
    assert not wire.stage.autopilot.armed
    assert wire.frames[-1][0] <= when[0] + 1e-3
    assert any("acknowledged" in line for line in wire.lines)
    assert wire.reason == "motors off: told to"


# Vehicles and airs, and who is silent: the poses and the controller once each.
@pytest.mark.tried(2)
@pytest.mark.parametrize("scenario", ["paper", "adverse", "quad1kg"])
@pytest.mark.parametrize("cause", ["poses", "controller"])
def test_the_bring_down_ends_level_and_not_too_fast(scenario: str, cause: str) -> None:
    """Limits stand above the table in docs/explanation/safety.md, which has more flights."""
    tilts, places = list[float](), list[Vec3]()

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, 6.3)
        if cause == "poses":
            known(stage.mocap).cover(True)
        while True:
            truth = stage.plant.truth(asyncio.get_running_loop().time())
            places.append(truth.position_ned)
            if not truth.on_ground and stage.plant.floor.touchdown_m_s is None:
                tilts.append(so3.angle_deg(so3.third_column(truth.attitude)[2]))
            await asyncio.sleep(0.01)

    breaks = (*BREAKS, "controller.after_s=6.3") if cause == "controller" else ()
    told = ("trajectory.altitude_m=0.0", *breaks)
    wire = fly(script, *told, scenario=scenario, seed=3)
    touchdown_m_s = wire.stage.plant.floor.touchdown_m_s
    assert touchdown_m_s is not None and touchdown_m_s < 2.5
    assert max(tilts[-5:]) < 12.0
    assert math.dist(places[0][:2], places[-1][:2]) < 3.0


@pytest.mark.parametrize(("pace", "period_s"), [("period", 0.09), ("poses", 0.2)])
def test_a_pose_that_comes_just_before_the_deadline_is_flown_before_it(
    pace: str, period_s: float
) -> None:
    """A gap between poses ends a flight, however far away the next frame is."""

    async def script(flight: Flight, stage: Stage) -> None:
        await flying(flight, 2.0)
        for _gap in range(20):
            known(stage.mocap).cover(True)
            # And up to 30 ms until the next one, and 20 ms on its way: 240 of 250 ms.
            await asyncio.sleep(0.19)
            known(stage.mocap).cover(False)
            await asyncio.sleep(0.137)

    wire = fly(script, "flight.duration_s=10.0", f"link.period_s={period_s}", pace=pace)
    assert wire.state is State.LANDED, wire.reason
