"""``goto`` from a hold: flown straight, checked before each leg, ended by hold."""

import asyncio
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from groundstation.analysis.replay import replay_facts
from groundstation.core.geometry import so3
from groundstation.core.messages import Ask, Reply, Request, Waypoint
from groundstation.core.mission import FINAL, State
from groundstation.flight import Flight
from sim.runs import MissionResult, Stage, from_floor
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import CLIMB, mission
from tests.loops import until
from tests.recordings import record_mission

SHORT = (*CLIMB, "trajectory.altitude_m=-0.5")
FENCE = 'fence={kind="box", north_m=[-3, 3], east_m=[-3, 3], height_m=2.5}'
NEAR = Waypoint(1.0, -0.2, 0.2, 90.0)


async def hold_first(flight: Flight) -> None:
    await until(lambda: flight.state is State.HOLD)
    assert flight.ask(Request(Ask.HOLD, "the test")).done


def is_in(flight: Flight, state: State) -> bool:
    return flight.state is state


def goto(flight: Flight, *points: Waypoint) -> Reply:
    return flight.ask(Request(Ask.GOTO, "the test", points))


def flown(script: Callable[[Flight, Stage], object], *overrides: str) -> MissionResult:
    return mission("paper", *SHORT, FENCE, *overrides, script=script)


def test_it_flies_straight_to_a_point_turns_as_asked_and_holds_there_until_told() -> None:
    seen: list[tuple[float, float]] = []

    async def script(flight: Flight, stage: Stage) -> None:
        await hold_first(flight)
        said = goto(flight, NEAR)
        way = "moving: to north 1.00, east -0.20, 0.80 m above the floor: the test"
        assert said.done and said.says.startswith(way)
        await until(lambda: flight.state is State.HOLD)
        await asyncio.sleep(3.0)
        truth = stage.plant.truth(asyncio.get_running_loop().time())
        off_m, yaw = math.dist(truth.position_ned, NEAR.place_ned), so3.euler_zyx(truth.attitude)[2]
        seen.append((off_m, yaw))
        assert flight.state is State.HOLD
        flight.ask(Request(Ask.RETURN, "home"))

    done = flown(script)
    assert done.landed, done.fault or done.why
    ways = ["hold", "moving", "hold", "returning", "landing", "disarming", "landed"]
    assert [one.state for one in done.states][4:] == ways
    ((off_m, yaw),) = seen
    assert off_m < 0.05
    assert yaw == pytest.approx(math.pi / 2.0, abs=0.05)


def test_hold_ends_it_on_its_way_and_the_rest_of_the_points_is_forgotten() -> None:
    async def script(flight: Flight, _: Stage) -> None:
        assert goto(flight, NEAR).says == f"goto is not possible while {flight.state}"
        await hold_first(flight)
        assert goto(flight, Waypoint(2.0, 2.0, 0.0), Waypoint(-2.0, 2.0, 0.0)).done
        await asyncio.sleep(1.5)
        assert flight.state == "moving"
        assert goto(flight, NEAR).says == "goto is not possible while moving: request hold first"
        assert flight.ask(Request(Ask.HOLD, "stop")).done
        await asyncio.sleep(6.0)
        assert flight.state is State.HOLD
        assert math.dist(flight.snapshot().position_ned, (2.0, 2.0, 0.0)) > 1.0
        flight.land("the test")
        while flight.state not in FINAL:
            await asyncio.sleep(0.1)
        assert "after the end of a flight (landed): a daemon gets ready" in goto(flight, NEAR).says

    done = flown(script)
    states = "moving hold landing disarming landed"
    assert [one.state for one in done.states][5:] == states.split()


CAN_NOT_BE_HELD_AT = (
    ([Waypoint(3.0, 0.0, 0.0)], "point 1 of 1, [3.0, 0.0, 0.0], is 0.00 m outside the fence"),
    ([Waypoint(3.5, 0.0, 0.0)], "point 1 of 1, [3.5, 0.0, 0.0], is 0.50 m outside the fence"),
    ([NEAR, Waypoint(0.0, 0.0, 0.9)], "point 2 of 2, [0.0, 0.0, 0.9], is 0.10 m above the floor"),
    ([Waypoint(0.0, 0.0, 2.0)], "is 1.00 m below the floor: it must be at least 0.3 m above it"),
    ([Waypoint(0.0, 0.0, -2.0)], "0.50 m outside the fence"),
)


def test_a_point_that_can_not_be_held_at_is_refused_before_anything_moves() -> None:
    async def script(flight: Flight, _: Stage) -> None:
        await hold_first(flight)
        for points, says in CAN_NOT_BE_HELD_AT:
            said = goto(flight, *points)
            assert not said.done and says in said.says
            assert flight.state is State.HOLD
        flight.land("the test")

    assert "moving" not in [one.state for one in flown(script).states]


HARD = ("takeoff.transit_m_s=1.9", "takeoff.transit_m_s2=2.0")
SLOW = ("takeoff.transit_m_s=0.9", "limits.max_speed_m_s=0.6")


@pytest.mark.parametrize(
    ("overrides", "point", "says"),
    [
        (HARD, Waypoint(2.9, 0.0, 0.0), "could not brake within the fence"),
        (SLOW, Waypoint(-2.0, 2.0, 0.0), "limits.max_speed_m_s"),
    ],
)
def test_a_leg_that_is_too_fast_is_refused(
    overrides: tuple[str, ...], point: Waypoint, says: str
) -> None:
    async def script(flight: Flight, _: Stage) -> None:
        await hold_first(flight)
        said = goto(flight, point)
        assert not said.done
        assert says in said.says
        flight.land("the test")

    flown(script, *overrides)


def test_a_leg_towards_another_vehicle_is_refused_or_ends_in_a_hold() -> None:
    told: list[str] = []

    async def script(flight: Flight, _: Stage) -> None:
        await hold_first(flight)
        now = asyncio.get_running_loop().time()
        angles = (0.4 * now, 0.4 * (now + 4.0))
        there, later = (Waypoint(2.5 * math.cos(a), 2.5 * math.sin(a), -1.0) for a in angles)
        said = goto(flight, there)
        assert not said.done and "too near to other0" in said.says
        assert goto(flight, NEAR, later).done
        await until(lambda: flight.state is State.HOLD)
        told.append(flight.reason)
        flight.land("the test")

    flown(script, "sim.other_bodies=1", 'separation.others=["other0"]', "separation.distance_m=1.2")
    (why,) = told
    assert why.startswith("not to north") and "other0" in why


def test_only_a_vehicle_that_holds_goes_anywhere() -> None:
    async def script(flight: Flight, _: Stage) -> None:
        for state in (State.READY, State.TAKEOFF, State.TRACKING, State.RETURNING, State.LANDING):
            await until(partial(is_in, flight, state))
            said = goto(flight, NEAR)
            assert not said.done and f"not possible while {state}" in said.says

    assert flown(script).landed


def test_points_are_flown_in_order_and_replayed_to_the_last_bit(tmp_path: Path) -> None:
    told: list[str] = []

    async def script(flight: Flight, _: Stage) -> None:
        await hold_first(flight)
        assert goto(flight, NEAR, Waypoint(0.0, 0.0, 0.0), Waypoint(0.5, 0.5, 0.2)).done
        await until(lambda: flight.state is State.HOLD)
        told.extend(notice.line for notice in flight.snapshot().events)
        flight.land("the test")

    world, config = from_floor(*prepare(SCENARIOS["adverse"], [*SHORT, FENCE]), 5.0)
    mission, path = record_mission(tmp_path, world, config, script, "adverse")
    assert mission.states[-1].state == "landed"
    norths = [line.partition("to north ")[2][:4] for line in told if "moving: to" in line]
    assert norths == ["1.00", "0.00", "0.50"]
    assert any("hold: there: north 0.50" in line and "3 of 3" in line for line in told)
    facts = replay_facts(path)
    assert facts["first_difference"] is None
    assert facts["commands"] > 250
