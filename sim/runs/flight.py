"""Flight or mission in virtual time: the real application against the simulated side, through wire bytes.

A flight begins in the air and lasts so long; a mission goes from the floor to the figure and back.
"""

import asyncio
import hashlib
import math
import struct
import time
from collections.abc import Callable, Coroutine, Sequence
from typing import Any, TypeAlias

import msgspec

from groundstation.core.control import Law
from groundstation.core.geometry import Vec3
from groundstation.core.messages import CommandSent, FlightEvent, Notice, Pose, Severity, Tick
from groundstation.core.mission import State
from groundstation.core.safety import MONITORS, Monitors
from groundstation.core.trajectory import Trajectory
from groundstation.flight import Flight, FlightOutcome, Give, make_flight
from groundstation.machine import sleep_until
from groundstation.recording import Record, TruthRecord
from groundstation.settings import Config
from sim.autopilots import Airworthy
from sim.runs.referee import FlightVerdict, MissionVerdict, Referee, StateEntry, TrueTrack
from sim.runs.stage import Stage
from sim.time import Address, VirtualTimeLoop, in_virtual_time
from sim.world import TrueState, World

CONFIRM_S = 1.0
"""When arming is confirmed, in virtual time [s]: so our frames do not start in step with the cameras."""
DOWN = (State.LANDING, State.DESCENT, State.DISARMING)
"""Whoever meets the floor then has landed."""
HANDSHAKE_LIMIT_S = 60.0
"""A hand-shake that takes longer has failed [s, virtual]."""


class Result(msgspec.Struct, frozen=True, kw_only=True):
    """A flown scenario: what was asked, what came of it."""

    completed: bool
    why: str
    """Why the flight ended, as a sentence."""
    duration_s: float
    verdict: FlightVerdict
    warnings: tuple[str, ...]
    """Warnings to the operator, the certificate's apart, with the time on the trajectory."""
    log_sha256: str
    """Over all wire bytes both ways with their virtual stamps."""
    datagrams: int
    wall_s: float


class WireLog:
    """Hashes, and on request keeps, every datagram with its virtual stamp and addresses."""

    def __init__(self, keep: Callable[[float, Address, Address, bytes], None] | None = None) -> None:
        """``keep`` sees each datagram too."""
        self._hash = hashlib.sha256()
        self._keep = keep
        self.count = 0

    def __call__(self, time_s: float, source: Address, target: Address, data: bytes) -> None:
        """Take one datagram."""
        self._hash.update(_STAMP.pack(time_s, source[1], target[1], len(data)) + data)
        self.count += 1
        if self._keep is not None:
            self._keep(time_s, source, target, data)

    def sha256(self) -> str:
        """The digest so far, in hex."""
        return self._hash.hexdigest()


_STAMP = struct.Struct("<dHHI")


@in_virtual_time
async def fly(
    world: World,
    config: Config,
    *,
    seed: int,
    duration_s: float,
    autopilot: str = "px4",
    on_tick: Callable[[Tick], None] | None = None,
    on_datagram: Callable[[float, Address, Address, bytes], None] | None = None,
    on_event: Callable[[Notice], None] | None = None,
    on_pose: Callable[[Pose], None] | None = None,
    give: Give | None = None,
    on_progress: Callable[[float], None] | None = None,
    on_step: Callable[[float, Vec3], None] | None = None,
) -> Result:
    """Fly ``config`` in ``world`` for ``duration_s`` [s] after the release; never raises for a bad flight.

    ``give`` takes what is to be recorded. ``autopilot`` is one of :data:`sim.autopilots.peer.AUTOPILOTS`.
    ``on_step`` sees the true position [m, NED] at every step of the plant, by the event loop's clock.
    """
    start, loop = time.perf_counter(), asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    log = loop.tap = WireLog(on_datagram)
    referee = Referee(world, config.vehicle, config.controller.kb if isinstance(config.controller, Law) else None)

    def step(time_s: float, position: Vec3) -> None:
        referee.track.step(time_s, position)
        if on_step is not None:
            on_step(time_s, position)

    trajectory = config.trajectory.build()
    warnings: list[str] = []
    over = False  # then the world has come to its end, and what is cancelled is no part of the flight
    stage = Stage(world, config, seed, referee.track.step if on_step is None else step, autopilot=autopilot)
    plant = stage.plant

    def watch(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            if event.severity is Severity.WARNING and event.kind not in ("certificate", "state") and not over:
                warnings.append(f"{event.time_s - (flight.started_s or 0.0):.2f} {event.text}")
            if on_event is not None:
                on_event(event)
        if not isinstance(event, CommandSent):
            return
        tick = event.tick
        # First the plant: the wind answers forward in time only, so asking it must not run ahead of the flight.
        truth = plant.truth(tick.time_s)
        released = plant.released_s
        wind = stage.wind.at(tick.time_s - released) if released is not None else world.wind_mean
        referee.tick(tick, wind, truth.velocity_ned)
        if give is not None:
            record(make_truth(truth, wind, trajectory, flight.started_s))
        if on_tick is not None:
            on_tick(tick)
        if referee.find_crash(truth.position_ned, lands=flight.state in DOWN):
            clock.cancel()

    def record(record: Record) -> None:
        if give is not None and not over:
            give(record)

    flight = make_flight(
        config,
        confirm=confirm_at(CONFIRM_S),
        subscribers=(watch,),
        on_pose=on_pose,
        wires=stage.wires,
        give=record if give is not None else None,
    )
    stage_task = asyncio.create_task(stage.run())
    flight_task = asyncio.create_task(flight.run())
    clock = asyncio.create_task(_end_of(flight_task, lambda: flight.started_s, duration_s, on_progress))
    await asyncio.wait({stage_task, flight_task, clock}, return_when=asyncio.FIRST_COMPLETED)
    begun, now = flight.started_s, loop.time()
    if begun is not None and referee.crash is None:
        # Nobody has asked for the last steps: the errors in them count too.
        plant.advance(min(now, begun + duration_s))
    over = True
    # The world ends first: what the link does to bring down a vehicle that is no more is not part of the flight.
    for task in (clock, stage_task, flight_task):
        task.cancel()
    failure, _ = await asyncio.gather(stage_task, clock, return_exceptions=True)
    loop.tap = None
    (outcome,) = await asyncio.gather(flight_task, return_exceptions=True)
    flown = 0.0 if begun is None else min(now - begun, duration_s)
    complete = begun is not None and referee.crash is None and flown >= duration_s - 1e-6
    if isinstance(outcome, FlightOutcome) and outcome.state is State.LANDED:
        complete = True
    return Result(
        completed=complete,
        why="flown to the end" if complete else _why(referee, outcome, failure),
        duration_s=flown,
        verdict=referee.verdict(trajectory, begun or 0.0),
        warnings=tuple(warnings),
        log_sha256=log.sha256(),
        datagrams=log.count,
        wall_s=time.perf_counter() - start,
    )


def make_truth(truth: TrueState, wind: Vec3, trajectory: Trajectory, started_s: float | None) -> TruthRecord:
    """Make the recording's entry of ``truth`` in a ``wind`` [m/s², NED]; the trajectory began at ``started_s``."""
    place, error = truth.position_ned, None
    if started_s is not None and started_s <= truth.time_s:
        error = math.dist(place, trajectory.position_at(truth.time_s - started_s))
    return TruthRecord(truth.time_s, place, truth.velocity_ned, truth.attitude, wind, error)


async def _end_of(
    flight: "asyncio.Task[FlightOutcome]",
    begun: Callable[[], float | None],
    duration_s: float,
    on_progress: Callable[[float], None] | None,
) -> None:
    """Return when the flight has lasted ``duration_s`` [s], or its hand-shake far too long."""
    loop = asyncio.get_running_loop()
    limit = loop.time() + HANDSHAKE_LIMIT_S
    while (start := begun()) is None and not flight.done():
        if loop.time() > limit:
            return
        await asyncio.sleep(0.01)
    if start is None:
        return
    second = 1.0
    while on_progress is not None and second < duration_s:
        await sleep_until(start + second)
        on_progress(second)
        second += 1.0
    await sleep_until(start + duration_s)


def _why(referee: Referee, outcome: Any, failure: Any) -> str:
    if referee.crash is not None:
        return f"crashed: {referee.crash}"
    if isinstance(outcome, FlightOutcome):
        return f"{outcome.state}: {outcome.reason}"
    for error in (outcome, failure):
        if isinstance(error, Exception):
            raise error
    return f"the hand-shake took more than {HANDSHAKE_LIMIT_S:g} s"


Script: TypeAlias = Callable[[Flight, Stage], Coroutine[Any, Any, None]]
MISSION_CONFIRM_S = 3.0
"""When arming is confirmed, in virtual time [s]."""
LIMIT_S = 120.0
"""A mission that takes so much longer than its figure has failed [s, virtual]."""
REST_S = 1.0
"""Time for which the world goes on after the end [s]."""


class MissionResult(MissionVerdict, frozen=True, kw_only=True):
    """A flown mission."""

    fault: str
    """Cause of an early end; empty without one."""
    warnings: tuple[StateEntry, ...]
    """Warnings to the operator, each with the mission's state."""
    tilt_max_deg: float
    """Farthest that it leant."""
    duration_s: float
    wall_s: float


def from_floor(world: World, config: Config, figure_s: float | None) -> tuple[World, Config]:
    """Put the vehicle on the floor below its start in the air, with ``figure_s`` [s] of figure to fly."""
    north, east, _ = world.start_ned
    flight = msgspec.structs.replace(config.flight, start="floor", idle_thrust=0.0, duration_s=figure_s)
    place = (north, east, world.floor_z_m)
    return (
        msgspec.structs.replace(world, start_ned=place, start_thrust=0.0, ground_effect=True),
        msgspec.structs.replace(config, flight=flight),
    )


@in_virtual_time
async def fly_mission(
    world: World,
    config: Config,
    *,
    seed: int,
    autopilot: str | Airworthy = "px4",
    on_event: Callable[[Notice], None] | None = None,
    script: Script | None = None,
    give: Give | None = None,
    monitors: Monitors = MONITORS,
    confirm_s: float = MISSION_CONFIRM_S,
) -> MissionResult:
    """Fly ``config``, which says how long the figure is flown, in ``world``, from its floor; see :func:`from_floor`.

    ``script(flight, stage)`` runs beside it, to ask for what an operator would, or to break something; ``give`` takes
    what is to be recorded; ``monitors`` makes what may end the flight; arming is confirmed at ``confirm_s``.
    """
    begun_s, loop = time.perf_counter(), asyncio.get_running_loop()
    track, states, upright = TrueTrack(), list[StateEntry](), 1.0
    warnings: list[StateEntry] = []

    def step(time_s: float, position: Vec3) -> None:
        nonlocal upright
        track.step(time_s, position)
        x, y = stage.plant.attitude[1:3]
        upright = min(upright, 1.0 - 2.0 * (x * x + y * y))

    stage = Stage(world, config, seed, step, autopilot=autopilot)
    trajectory = config.trajectory.build()

    def hear(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            if on_event is not None:
                on_event(event)
            if event.kind == "state" or event.severity is Severity.WARNING:
                entry = StateEntry(event.state, round(event.time_s, 6), event.text)
                (states if event.kind == "state" else warnings).append(entry)
        elif isinstance(event, CommandSent) and give is not None:
            tick = event.tick
            truth, released = stage.plant.truth(tick.time_s), stage.plant.released_s
            # The wind answers forward in time only: it is asked for no later than the plant has been.
            flown = released is not None and bool(track.times)
            wind = stage.wind.at(track.times[-1] - (released or 0.0)) if flown else world.wind_mean
            started = flight.started_s if flight.state is State.TRACKING else None
            give(make_truth(truth, wind, trajectory, started))

    flight = make_flight(
        config,
        confirm=confirm_at(confirm_s),
        subscribers=(hear,),
        wires=stage.wires,
        give=give,
        monitors=monitors,
    )
    limit = LIMIT_S + (config.flight.duration_s or 0.0)
    (outcome,), ended_s = await run_missions(stage.run(), [flight], limit, script and script(flight, stage))
    stage.plant.advance(loop.time())
    start, end = world.start_ned, stage.plant.truth(loop.time()).position_ned
    return MissionResult(
        landed=outcome is not None and outcome.state is State.LANDED and not outcome.fault,
        why=f"not over after {limit:g} s" if outcome is None else f"{outcome.state}: {outcome.reason}",
        fault="" if outcome is None else outcome.fault,
        states=tuple(states),
        warnings=tuple(warnings),
        touchdown_m_s=stage.plant.hardest_m_s,
        **track.judge_figure(trajectory, flight.started_s, states, world.step_s),
        home_m=math.dist(start[:2], end[:2]),
        tilt_max_deg=math.degrees(math.acos(max(upright, -1.0))),
        duration_s=ended_s,
        wall_s=time.perf_counter() - begun_s,
    )


async def run_missions(
    world: Coroutine[Any, Any, None],
    flights: Sequence[Flight],
    limit_s: float,
    beside: Coroutine[Any, Any, None] | None = None,
) -> tuple[list[FlightOutcome | None], float]:
    """Run missions in ``world`` until all are over, or ``limit_s`` [s] have passed; ``beside`` runs with them.

    Returns:
        How each ended, None where it did not, and when that was on the event loop's clock [s].
    """
    loop = asyncio.get_running_loop()
    turning = asyncio.ensure_future(world)
    flying = [asyncio.ensure_future(flight.run()) for flight in flights]
    script = asyncio.ensure_future(beside) if beside is not None else None
    all_flown = asyncio.gather(*flying)
    ends: set[asyncio.Future[Any]] = {turning, all_flown}
    await asyncio.wait(ends, timeout=limit_s, return_when=asyncio.FIRST_COMPLETED)
    ended_s = loop.time()
    if all_flown.done():
        all_flown.result()  # raises what a flight has raised
    outcomes = [one.result() if one.done() else None for one in flying]
    if all_flown.done():
        await asyncio.sleep(REST_S)
    for flight, outcome in zip(flights, outcomes, strict=True):
        if outcome is None:
            flight.stop("the mission took too long")
    tasks = [task for task in (turning, *flying, script) if task is not None]
    for task in tasks:
        task.cancel()
    for failure in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(failure, Exception):
            raise failure
    await asyncio.gather(all_flown, return_exceptions=True)
    return outcomes, ended_s


def confirm_at(time_s: float) -> Callable[[], Coroutine[Any, Any, bool]]:
    """Whoever confirms the arming, at ``time_s`` on the event loop's clock [s]."""

    async def confirm() -> bool:
        await sleep_until(time_s)
        return True

    return confirm
