"""Missions of a fleet in virtual time, in one process, judged by the truth: figures, and
distances.
"""

import asyncio
import math
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from itertools import combinations
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import numpy as np

from groundstation.core.geometry import Vec3
from groundstation.core.messages import FlightEvent, Notice, Subscriber
from groundstation.core.mission import State
from groundstation.flight import Flight, make_flight
from groundstation.lab import FleetPlan, Member, Relay, read_fleet
from groundstation.settings import Config
from sim.runs.flight import LIMIT_S, MISSION_CONFIRM_S, confirm_at, run_missions
from sim.runs.referee import MissionVerdict, StateEntry, TrueTrack
from sim.runs.stage import FleetStage, lay_out
from sim.time import in_virtual_time
from sim.world import World

SAMPLE_S = 0.02
"""Interval between samples of the distance between vehicles [s]."""


class Nearest(msgspec.Struct, frozen=True):
    """Smallest distance between two vehicles of a fleet."""

    distance_m: float
    between: tuple[str, str]
    time_s: float
    """Its time since the release of the first vehicle [s]."""


class FleetFlight(MissionVerdict, frozen=True, kw_only=True):
    """One vehicle's mission."""

    name: str


class Tracks:
    """True paths of all vehicles, by every step of their plants."""

    def __init__(self, count: int) -> None:
        self.of = [TrueTrack() for _ in range(count)]
        """Path of each vehicle."""

    def step(self, number: int, time_s: float, place: Vec3) -> None:
        """Take one step of vehicle ``number``: its instant [s] and position [m, NED]."""
        self.of[number].step(time_s, place)

    @property
    def begun_s(self) -> float:
        """Release of the first vehicle, on the event loop's clock [s]; 0 before that."""
        return min((one.times[0] for one in self.of if one.times), default=0.0)

    def last(self, number: int, start: Vec3) -> Vec3:
        """Return the last position of a vehicle [m, NED]; ``start`` if it was never released."""
        one = self.of[number]
        north, east, down = one.axes
        return (north[-1], east[-1], down[-1]) if one.times else start

    def nearest(self, names: Sequence[str], starts: Sequence[Vec3]) -> Nearest | None:
        """Find the smallest distance between two vehicles.

        One that was never released stays at its start.
        """
        end = max((one.times[-1] for one in self.of if one.times), default=0.0)
        grid = np.arange(self.begun_s, end + SAMPLE_S, SAMPLE_S)
        places = []
        for one, start in zip(self.of, starts, strict=True):
            columns = [
                np.interp(grid, one.times, axis) if one.times else grid * 0.0 + s
                for axis, s in zip(one.axes, start, strict=True)
            ]
            places.append(np.stack(columns))
        found: Nearest | None = None
        for a, b in combinations(range(len(names)), 2):
            apart = np.linalg.norm(places[a] - places[b], axis=0)
            at = int(np.argmin(apart))
            if found is None or apart[at] < found.distance_m:
                found = Nearest(
                    float(apart[at]), (names[a], names[b]), float(grid[at] - self.begun_s)
                )
        return found


def judge(
    number: int,
    member: Member,
    states: Sequence[StateEntry],
    started_s: float | None,
    fault: str,
    tracks: Tracks,
    stage: FleetStage,
) -> FleetFlight:
    """Judge one vehicle's flight by the truth.

    Args:
        number: number of the vehicle.
        member: its name, and the configuration of its ground station.
        states: states that its ground station went through.
        started_s: begin of its figure, on the event loop's clock [s]; None without one.
        fault: reason of an early end; empty without one.
        tracks: true paths of all vehicles.
        stage: the simulated side.
    """
    plant, world = stage.stages[number].plant, stage.stages[number].world
    begun = tracks.begun_s
    last = states[-1] if states else StateEntry(State.IDLE, begun, "nothing was heard of it")
    return FleetFlight(
        name=member.name,
        landed=last.state == State.LANDED and not fault,
        why=fault or last.reason,
        states=tuple(
            StateEntry(one.state, round(one.time_s - begun, 6), one.reason) for one in states
        ),
        touchdown_m_s=plant.floor.hardest_m_s,
        **tracks.of[number].judge_figure(
            member.core.trajectory.build(), started_s, states, world.step_s
        ),
        home_m=math.dist(world.start_ned[:2], tracks.last(number, world.start_ned)[:2]),
    )


PORTS = (51001, 51101, *range(14541, 14641))
"""UDP ports of poses, relay and links: in virtual time none is taken."""
APART_S = 0.1
"""Time between the arming of one vehicle and of the next [s]. Chosen."""

FleetScript: TypeAlias = Callable[[dict[str, Flight], FleetStage], Coroutine[Any, Any, None]]
Change: TypeAlias = Callable[[list[World], FleetPlan], tuple[list[World], FleetPlan]]


class FleetMission(msgspec.Struct, frozen=True, kw_only=True):
    """Flown missions."""

    vehicles: tuple[FleetFlight, ...]
    nearest: Nearest | None
    """Smallest distance between two vehicles; None for one vehicle alone."""
    duration_s: float
    wall_s: float

    @property
    def landed(self) -> bool:
        """Whether all vehicles have flown their missions and landed."""
        return all(one.landed for one in self.vehicles)


@in_virtual_time
async def fly_fleet(
    world: World,
    config: Config,
    count: int,
    *,
    seed: int,
    autopilot: str = "px4",
    script: FleetScript | None = None,
    change: Change | None = None,
    on_event: Callable[[str, Notice], None] | None = None,
) -> FleetMission:
    """Fly ``count`` vehicles like ``config`` in ``world``, side by side.

    See :func:`sim.runs.flight.from_floor`.

    ``script(flights, stage)`` runs beside them; ``change`` may alter worlds and plan before;
    ``on_event`` takes each vehicle's name and notice.

    Raises:
        ConfigError: see :func:`sim.runs.stage.lay_out`.
    """
    start = time.perf_counter()
    worlds, fleet = _plan_fleet(world, config, count)
    if change is not None:
        worlds, fleet = change(worlds, fleet)
    loop, tracks = asyncio.get_running_loop(), Tracks(len(worlds))
    stage = FleetStage(
        worlds, [member.lab for member in fleet.members], seed, tracks.step, autopilot=autopilot
    )
    states: dict[str, list[StateEntry]] = {member.name: [] for member in fleet.members}
    flights = _make_flights(fleet, states, on_event)
    limit = LIMIT_S + max(member.core.flight.duration_s or 0.0 for member in fleet.members)
    async with _relaying(fleet):
        outcomes, ended_s = await run_missions(
            stage.run(), list(flights.values()), limit, script and script(flights, stage)
        )
    for one in stage.stages:
        one.plant.advance(loop.time())
    vehicles = []
    for number, (member, outcome) in enumerate(zip(fleet.members, outcomes, strict=True)):
        fault = f"not over after {limit:g} s" if outcome is None else outcome.fault
        started_s = flights[member.name].started_s
        vehicles.append(judge(number, member, states[member.name], started_s, fault, tracks, stage))
    return FleetMission(
        vehicles=tuple(vehicles),
        nearest=tracks.nearest(list(flights), [world.start_ned for world in worlds]),
        duration_s=ended_s,
        wall_s=time.perf_counter() - start,
    )


def _plan_fleet(world: World, config: Config, count: int) -> tuple[list[World], FleetPlan]:
    """Return the world of each vehicle, and the fleet as its files describe it."""
    with tempfile.TemporaryDirectory(prefix="groundstation-sim-") as folder:
        file, worlds = lay_out(Path(folder), world, config, count, PORTS)
        return worlds, read_fleet(file)


def _make_flights(
    fleet: FleetPlan,
    states: dict[str, list[StateEntry]],
    on_event: Callable[[str, Notice], None] | None,
) -> dict[str, Flight]:
    """Return the ground station of each vehicle by its name.

    Arming is confirmed one after the other.
    """
    return {
        member.name: make_flight(
            member.core,
            confirm=confirm_at(MISSION_CONFIRM_S + APART_S * number),
            subscribers=(_note(states[member.name], member.name, on_event),),
        )
        for number, member in enumerate(fleet.members)
    }


@asynccontextmanager
async def _relaying(fleet: FleetPlan) -> AsyncIterator[None]:
    """Run the fleet's relay of poses, if it has one."""
    if fleet.relay_listen is None:
        yield
        return
    relay = Relay(fleet.relay_listen, fleet.relay_targets)
    await relay.open()
    yield
    relay.close()


def _note(
    states: list[StateEntry], name: str, on_event: Callable[[str, Notice], None] | None
) -> Subscriber:
    """Return a subscriber that adds the states of one flight to ``states``."""

    def take(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            if on_event is not None:
                on_event(name, event)
            if event.kind == "state":
                states.append(StateEntry(event.state, event.time_s, event.text))

    return take
