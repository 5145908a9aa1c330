"""Several missions at once in virtual time: every ground station, the relay and the simulated side in one process."""

import asyncio
import tempfile
import time
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from groundstation.core.mission import State
from groundstation.flight import Flight, Outcome
from groundstation.lab import FleetPlan, Relay, read_fleet
from groundstation.recording import make_flight
from groundstation.runtime import sleep_until
from groundstation.settings import Config
from sim.runs.fleet_lab import lay_out
from sim.runs.fleet_stage import FleetStage
from sim.runs.fleet_truth import Flown, Nearest, Told, Tracks, judged
from sim.runs.mission import LIMIT_S, MISSION_CONFIRM_S, REST_S, Entered
from sim.time import VirtualTimeLoop
from sim.world import World

PORTS = (51001, 51101, *range(14541, 14641))
"""In virtual time no port is ever taken."""
APART_S = 0.1
"""From one vehicle's arming to the next one's [s]."""

FleetScript: TypeAlias = Callable[[dict[str, Flight], FleetStage], Coroutine[Any, Any, None]]
Change: TypeAlias = Callable[[list[World], FleetPlan], tuple[list[World], FleetPlan]]


class FleetMission(msgspec.Struct, frozen=True, kw_only=True):
    """Flown missions."""

    vehicles: tuple[Flown, ...]
    nearest: Nearest | None
    """How near two of them came to each other; None for one vehicle alone."""
    duration_s: float
    wall_s: float
    load: tuple[float, float, float] | None = None
    """Load averages of the machine over 1, 5 and 15 minutes at the end; None in virtual time."""

    @property
    def landed(self) -> bool:
        """Whether all went as it was meant to."""
        return all(one.landed for one in self.vehicles)


def fly_fleet(
    world: World,
    config: Config,
    count: int,
    *,
    seed: int,
    autopilot: str = "px4",
    script: FleetScript | None = None,
    change: Change | None = None,
    on_event: Callable[[str, str], None] | None = None,
) -> FleetMission:
    """Fly ``count`` vehicles like ``config`` in ``world``, side by side; see :func:`sim.runs.mission.from_floor`.

    ``script(flights, stage)`` runs beside them; ``change`` may alter truth and plan before; ``on_event`` takes each
    vehicle's name and line.

    Raises:
        ConfigError: see :func:`sim.runs.fleet_lab.lay_out`.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="groundstation-sim-") as folder:
        file, worlds = lay_out(Path(folder), world, config, count, PORTS)
        fleet = read_fleet(file)
    if change is not None:
        worlds, fleet = change(worlds, fleet)
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        values = runner.run(_fly(worlds, fleet, seed, autopilot, script, on_event))
    return FleetMission(**values, wall_s=time.perf_counter() - start)


async def _fly(
    worlds: Sequence[World],
    fleet: FleetPlan,
    seed: int,
    autopilot: str,
    script: FleetScript | None,
    on_event: Callable[[str, str], None] | None,
) -> dict[str, Any]:
    loop, tracks = asyncio.get_running_loop(), Tracks(len(worlds))
    stage = FleetStage(worlds, [member.lab for member in fleet.members], seed, tracks.step, autopilot=autopilot)
    relay = None if fleet.relay_listen is None else Relay(fleet.relay_listen, fleet.relay_targets)
    states: dict[str, list[Entered]] = {member.name: [] for member in fleet.members}
    flights = {
        member.name: make_flight(
            member.core,
            confirm=_confirming(MISSION_CONFIRM_S + APART_S * number),
            on_event=None if on_event is None else _named(on_event, member.name),
            on_state=_entering(states[member.name]),
        )
        for number, member in enumerate(fleet.members)
    }
    if relay is not None:
        await relay.open()
    turning = asyncio.ensure_future(stage.run())
    flying = [asyncio.ensure_future(flight.run()) for flight in flights.values()]
    beside = asyncio.ensure_future(script(flights, stage)) if script is not None else None
    all_flown = asyncio.gather(*flying)
    limit = LIMIT_S + max(member.core.flight.duration_s or 0.0 for member in fleet.members)
    ends: set[asyncio.Future[Any]] = {turning, all_flown}
    await asyncio.wait(ends, timeout=limit, return_when=asyncio.FIRST_COMPLETED)
    ended_s = loop.time()
    outcomes: list[Outcome | None] = [one.result() if one.done() else None for one in flying]
    if all_flown.done():
        await asyncio.sleep(REST_S)
    for flight, outcome in zip(flights.values(), outcomes, strict=True):
        if outcome is None:
            flight.stop("the mission took too long")
    tasks = [task for task in (turning, *flying, beside) if task is not None]
    for task in tasks:
        task.cancel()
    for failure in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(failure, Exception):
            raise failure
    await asyncio.gather(all_flown, return_exceptions=True)
    if relay is not None:
        relay.close()
    for one in stage.stages:
        one.plant.advance(loop.time())
    vehicles = []
    for number, (member, outcome) in enumerate(zip(fleet.members, outcomes, strict=True)):
        told = Told(states=tuple(states[member.name]), started_s=flights[member.name].started_s)
        fault = f"not over after {limit:g} s" if outcome is None else outcome.fault
        vehicles.append(judged(number, member.name, member.core, told, fault, tracks, stage))
    names, starts = [member.name for member in fleet.members], [world.start_ned for world in worlds]
    return {"vehicles": tuple(vehicles), "nearest": tracks.nearest(names, starts), "duration_s": ended_s}


def _confirming(at_s: float) -> Callable[[], Coroutine[Any, Any, bool]]:
    async def confirm() -> bool:
        await sleep_until(at_s)
        return True

    return confirm


def _entering(states: list[Entered]) -> Callable[[State, str], None]:
    def entered(state: State, reason: str) -> None:
        states.append(Entered(state, asyncio.get_running_loop().time(), reason))

    return entered


def _named(on_event: Callable[[str, str], None], name: str) -> Callable[[str], None]:
    return lambda line: on_event(name, line)
