"""Several vehicles in one room: apart, made to meet, hidden, and without their relay."""

import asyncio
from collections.abc import Callable

import msgspec
import pytest

from groundstation.config import ConfigError
from groundstation.core.messages import Ask, Request
from groundstation.core.mission import State
from groundstation.core.trajectory.shapes import HoldConfig
from groundstation.flight import Flight
from groundstation.lab import FleetPlan, Member
from groundstation.settings import Config
from sim.__main__ import parser
from sim.cli.commands import mission as mission_command
from sim.runs import FleetMission, fly_fleet, from_floor
from sim.runs.fleet import Change, FleetFlight, FleetScript
from sim.runs.stage import FleetStage
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from sim.world import World
from tests.known import known

SHORT = ("takeoff.height_m=0.8", "takeoff.hold_s=1.0", "takeoff.climb_m_s=1.0")
HOLD = (*SHORT, "trajectory.kind=hold", "trajectory.position_ned=[0.8, -0.8, 0.2]")


def flown(
    count: int,
    *overrides: str,
    figure_s: float = 2.0,
    source: str = "vicon",
    script: FleetScript | None = None,
    change: Change | None = None,
    said: list[str] | None = None,
) -> FleetMission:
    world, config = prepare(SCENARIOS["paper"], list(overrides), source=source)
    world, config = from_floor(world, config, figure_s)
    hear = None if said is None else lambda name, event: said.append(f"{name} {event.line}")
    return fly_fleet(world, config, count, seed=0, script=script, change=change, on_event=hear)


def cores(change: Callable[[str, Config], Config]) -> Change:
    """Alter what each core is told, by its vehicle's name."""

    def changed(worlds: list[World], fleet: FleetPlan) -> tuple[list[World], FleetPlan]:
        members = tuple(
            Member(one.name, one.lab, change(one.name, one.core)) for one in fleet.members
        )
        return worlds, fleet._replace(members=members)

    return changed


def towards_the_first(name: str, config: Config) -> Config:
    """The second vehicle is told to hold where the first one does."""
    if name != "quad2":
        return config
    return msgspec.structs.replace(config, trajectory=HoldConfig(position_ned=(0.8, -0.8, 0.2)))


async def land_all(flights: dict[str, Flight], after_s: float) -> None:
    await asyncio.sleep(after_s)
    for flight in flights.values():
        flight.ask(Request(Ask.LAND, "the test"))


def reasons(one: FleetFlight, state: State) -> str:
    return "; ".join(entered.reason for entered in one.states if entered.state == state)


def test_three_vehicles_fly_side_by_side_and_keep_apart() -> None:
    mission = flown(3, *SHORT)
    assert mission.landed, [one.why for one in mission.vehicles]
    assert known(mission.nearest).distance_m > 2.5
    assert all(
        one.touchdown_m_s is not None and one.touchdown_m_s <= 0.5 for one in mission.vehicles
    )
    assert all(one.home_m < 0.1 for one in mission.vehicles)


@pytest.mark.tried(1)  # sources
@pytest.mark.parametrize("source", ["natnet", "qualisys", "json"])
def test_every_source_that_shows_several_bodies_serves_a_fleet(source: str) -> None:
    mission = flown(2, *HOLD, source=source, figure_s=0.5)
    assert mission.landed, [one.why for one in mission.vehicles]


def test_two_that_are_told_to_be_at_the_same_place_stop_before_they_meet() -> None:
    async def script(flights: dict[str, Flight], _: FleetStage) -> None:
        await land_all(flights, 30.0)

    mission = flown(2, *HOLD, figure_s=40.0, script=script, change=cores(towards_the_first))
    first, second = mission.vehicles
    assert 0.6 <= known(mission.nearest).distance_m < 0.9
    for one, other in ((first, "quad2"), (second, "quad1")):
        assert f"from {other} and approaching: braking" in reasons(one, State.HOLD)
        assert reasons(one, State.DESCENT) == ""
        assert one.states[-1].state == State.LANDED, one.states[-1]
        assert known(one.touchdown_m_s) <= 0.5


def test_from_one_that_looks_at_nobody_the_other_lands() -> None:
    def change(name: str, config: Config) -> Config:
        config = towards_the_first(name, config)
        if name == "quad1":
            return config
        alone = msgspec.structs.replace(config.separation, others=())
        return msgspec.structs.replace(config, separation=alone)

    async def script(flights: dict[str, Flight], _: FleetStage) -> None:
        await land_all({"quad2": flights["quad2"]}, 18.5)

    mission = flown(2, *HOLD, figure_s=40.0, script=script, change=cores(change))
    first = mission.vehicles[0]
    assert "from quad2 and approaching: braking" in reasons(first, State.HOLD)
    assert "from quad2, limit 0.6 m" in reasons(first, State.LANDING)
    assert reasons(first, State.DESCENT) == ""
    assert known(first.touchdown_m_s) <= 0.5
    assert known(mission.nearest).distance_m > 0.3


def test_one_that_the_cameras_lose_descends_and_the_others_hold() -> None:
    said: list[str] = []

    async def script(flights: dict[str, Flight], stage: FleetStage) -> None:
        while any(flight.state is not State.TRACKING for flight in flights.values()):
            await asyncio.sleep(0.1)
        stage.mocap.hidden.add("quad3")
        await land_all(flights, 5.0)

    mission = flown(3, *HOLD, figure_s=30.0, script=script, said=said)
    *others, hidden = mission.vehicles
    assert "no pose for" in reasons(hidden, State.DESCENT)
    for one in others:
        assert "no sighting of quad3" in reasons(one, State.HOLD)
        assert one.states[-1].state == State.LANDED, one.states[-1]
        lines = (line for line in said if line.startswith(one.name))
        warnings = [line for line in lines if "warning: no sighting of" in line]
        assert len(warnings) == 1


def test_without_the_relay_every_core_brings_its_own_vehicle_down() -> None:
    async def script(flights: dict[str, Flight], _: FleetStage) -> None:
        while any(flight.state is not State.TRACKING for flight in flights.values()):
            await asyncio.sleep(0.1)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.endpoints["127.0.0.1", 51001].close()

    mission = flown(2, *HOLD, figure_s=30.0, script=script)
    for one in mission.vehicles:
        assert "no pose for" in reasons(one, State.DESCENT)
        assert one.states[-1].state == State.ABORTED
        assert known(one.touchdown_m_s) < 2.0


def test_who_stands_too_near_to_another_does_not_take_off() -> None:
    def change(worlds: list[World], fleet: FleetPlan) -> tuple[list[World], FleetPlan]:
        north, east, down = worlds[0].start_ned
        near = msgspec.structs.replace(worlds[1], start_ned=(north + 0.5, east, down))
        return [worlds[0], near], fleet

    mission = flown(2, *HOLD, change=change)
    for one in mission.vehicles:
        assert "0.50 m from quad" in one.why
        assert one.states[-1].state == State.ABORTED
        assert one.touchdown_m_s is None


TO_ONE_POINT = "--set trajectory.kind=waypoints --set trajectory.points_ned=[[1,1,0]]"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("--vehicles 14", "--vehicles"),
        ("--vehicles 2 --link dsm", "--link"),
        ("--vehicles 2 --source vision", "must see the others"),
        (f"--vehicles 2 {TO_ONE_POINT}", "trajectory"),
    ],
)
def test_a_fleet_that_can_not_be_simulated_says_why(words: str, says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        mission_command(parser().parse_args(["mission", *words.split()]))
    assert says in str(refused.value)
