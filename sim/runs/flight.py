"""Flight or mission in virtual time: the real application against the simulated side, through wire
bytes.

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
from groundstation.core.messages import (
    CommandSent,
    FlightEvent,
    Notice,
    Pose,
    Severity,
    Subscriber,
    Tick,
    ignore,
)
from groundstation.core.mission import State
from groundstation.core.pilot import MONITORS, Monitors
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
"""When arming is confirmed, in virtual time [s]: so our frames do not start in step with the
cameras."""
DOWN = (State.LANDING, State.DESCENT, State.DISARMING)
"""Whoever meets the floor then has landed."""
LIMIT_S = 120.0
"""A hand-shake that takes longer, or a mission that takes so much longer than its figure, has
failed [s, virtual]."""


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
    track: TrueTrack
    """True path, by the event loop's clock."""


class WireLog:
    """Hashes every datagram with its virtual stamp and addresses."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.count = 0

    def __call__(self, time_s: float, source: Address, target: Address, data: bytes) -> None:
        """Take one datagram."""
        self._hash.update(_STAMP.pack(time_s, source[1], target[1], len(data)) + data)
        self.count += 1

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
    watch: Subscriber = ignore,
    on_pose: Callable[[Pose], None] | None = None,
    give: Give | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Result:
    """Fly ``config`` in ``world`` for ``duration_s`` [s] after the release.

    Never raises for a bad flight.

    ``autopilot`` is one of :data:`sim.autopilots.peer.AUTOPILOTS`; ``watch`` hears every event,
    ``on_pose`` every pose before the gate, ``give`` takes what is to be recorded, ``on_progress``
    the seconds flown.
    """
    flight = FlightFromAir(world, config, seed, autopilot, watch, on_pose, give)
    return await flight.run(duration_s, on_progress)


class FlightFromAir:
    """One flight that begins in the air: ground station and simulated side, watched by the
    referee.
    """

    def __init__(
        self,
        world: World,
        config: Config,
        seed: int,
        autopilot: str,
        watch: Subscriber,
        on_pose: Callable[[Pose], None] | None,
        give: Give | None,
    ) -> None:
        """Set up both sides; the arguments are those of :func:`fly`."""
        self._begun_s = time.perf_counter()
        self._world, self._watch, self._give = world, watch, give
        self._referee = Referee(
            world,
            config.vehicle,
            config.controller.kb if isinstance(config.controller, Law) else None,
        )
        self._trajectory = config.trajectory.build()
        self._warnings: list[str] = []
        """Warnings to the operator, the certificate's apart, with the time on the trajectory."""
        self._world_ended = False
        """Nothing that happens from then on, as the tasks are cancelled, is part of the flight."""
        self._stage = Stage(world, config, seed, self._referee.track.step, autopilot=autopilot)
        self._flight = make_flight(
            config,
            confirm=confirm_at(CONFIRM_S),
            subscribers=(self._hear,),
            on_pose=on_pose,
            wires=self._stage.wires,
            give=self._record if give is not None else None,
        )
        self._clock: asyncio.Task[None]
        """Ends with the flight's time; a crash cancels it."""

    async def run(self, duration_s: float, on_progress: Callable[[float], None] | None) -> Result:
        """Fly for ``duration_s`` [s] after the release."""
        loop, flight, log = asyncio.get_running_loop(), self._flight, WireLog()
        assert isinstance(loop, VirtualTimeLoop)
        loop.tap = log
        stage_task = asyncio.create_task(self._stage.run())
        flight_task = asyncio.create_task(flight.run())
        self._clock = asyncio.create_task(
            _end_of(flight_task, lambda: flight.started_s, duration_s, on_progress)
        )
        await asyncio.wait(
            {stage_task, flight_task, self._clock}, return_when=asyncio.FIRST_COMPLETED
        )
        started_s, now, crash = flight.started_s, loop.time(), self._referee.crash
        if started_s is not None and crash is None:
            # Nobody has asked for the last steps: the errors in them count too.
            self._stage.plant.advance(min(now, started_s + duration_s))
        # The world ends first: what the link does to bring down a vehicle that is no more is not
        # part of the flight.
        self._world_ended = True
        for task in (self._clock, stage_task, flight_task):
            task.cancel()
        failure, _ = await asyncio.gather(stage_task, self._clock, return_exceptions=True)
        loop.tap = None
        (outcome,) = await asyncio.gather(flight_task, return_exceptions=True)
        flown_s = 0.0 if started_s is None else min(now - started_s, duration_s)
        complete = started_s is not None and crash is None and flown_s >= duration_s - 1e-6
        if isinstance(outcome, FlightOutcome) and outcome.state is State.LANDED:
            complete = True
        return Result(
            completed=complete,
            why="flown to the end" if complete else _why(crash, outcome, failure),
            duration_s=flown_s,
            verdict=self._referee.verdict(self._trajectory, started_s or 0.0),
            warnings=tuple(self._warnings),
            log_sha256=log.sha256(),
            datagrams=log.count,
            wall_s=time.perf_counter() - self._begun_s,
            track=self._referee.track,
        )

    def _record(self, record: Record) -> None:
        if self._give is not None and not self._world_ended:
            self._give(record)

    def _hear(self, event: FlightEvent) -> None:
        self._watch(event)
        if isinstance(event, Notice):
            self._keep_warning(event)
        elif isinstance(event, CommandSent):
            self._judge(event.tick)

    def _keep_warning(self, notice: Notice) -> None:
        if (
            notice.severity is Severity.WARNING
            and notice.kind not in ("certificate", "state")
            and not self._world_ended
        ):
            self._warnings.append(
                f"{notice.time_s - (self._flight.started_s or 0.0):.2f} {notice.text}"
            )

    def _judge(self, tick: Tick) -> None:
        """Show the referee one command beside the truth; a crash ends the flight."""
        # First the plant: the wind answers forward in time only, so asking it must not run ahead of
        # the flight.
        truth = self._stage.plant.truth(tick.time_s)
        released_s = self._stage.plant.released_s
        wind = (
            self._stage.wind.at(tick.time_s - released_s)
            if released_s is not None
            else self._world.wind_mean
        )
        self._referee.tick(tick, wind, truth.velocity_ned)
        if self._give is not None:
            self._record(make_truth(truth, wind, self._trajectory, self._flight.started_s))
        if self._referee.find_crash(truth.position_ned, lands=self._flight.state in DOWN):
            self._clock.cancel()


def make_truth(
    truth: TrueState, wind: Vec3, trajectory: Trajectory, started_s: float | None
) -> TruthRecord:
    """Make the recording's entry of ``truth`` in a ``wind`` [m/s², NED].

    The trajectory began at ``started_s``.
    """
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
    limit = loop.time() + LIMIT_S
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


def _why(crash: str | None, outcome: Any, failure: Any) -> str:
    if crash is not None:
        return f"crashed: {crash}"
    if isinstance(outcome, FlightOutcome):
        return f"{outcome.state}: {outcome.reason}"
    for error in (outcome, failure):
        if isinstance(error, Exception):
            raise error
    return f"the hand-shake took more than {LIMIT_S:g} s"


Script: TypeAlias = Callable[[Flight, Stage], Coroutine[Any, Any, None]]
MISSION_CONFIRM_S = 3.0
"""When arming is confirmed, in virtual time [s]."""
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
    """Put the vehicle on the floor below its start in the air, with ``figure_s`` [s] of figure to
    fly.
    """
    north, east, _ = world.start_ned
    flight = msgspec.structs.replace(
        config.flight, start="floor", idle_thrust=0.0, duration_s=figure_s
    )
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
    watch: Subscriber = ignore,
    script: Script | None = None,
    give: Give | None = None,
    monitors: Monitors = MONITORS,
    confirm_s: float = MISSION_CONFIRM_S,
) -> MissionResult:
    """Fly ``config``, which says how long the figure is flown, in ``world``, from its floor.

    See :func:`from_floor`.

    ``script(flight, stage)`` runs beside it, to ask for what an operator would, or to break
    something; ``watch`` hears every event; ``give`` takes what is to be recorded; ``monitors``
    makes what may end the flight; arming is confirmed at ``confirm_s``.
    """
    begun_s, loop = time.perf_counter(), asyncio.get_running_loop()
    mission = MissionFromFloor(world, config, seed, autopilot, monitors, confirm_s, give, watch)
    stage, flight, track = mission.stage, mission.flight, mission.track
    limit_s = LIMIT_S + (config.flight.duration_s or 0.0)
    (outcome,), ended_s = await run_missions(
        stage.run(), [flight], limit_s, script and script(flight, stage)
    )
    stage.plant.advance(loop.time())
    start, end = world.start_ned, stage.plant.truth(loop.time()).position_ned
    return MissionResult(
        landed=outcome is not None and outcome.state is State.LANDED and not outcome.fault,
        why=f"not over after {limit_s:g} s"
        if outcome is None
        else f"{outcome.state}: {outcome.reason}",
        fault="" if outcome is None else outcome.fault,
        states=tuple(mission.states),
        warnings=tuple(mission.warnings),
        touchdown_m_s=stage.plant.floor.hardest_m_s,
        **track.judge_figure(mission.trajectory, flight.started_s, mission.states, world.step_s),
        home_m=math.dist(start[:2], end[:2]),
        tilt_max_deg=math.degrees(math.acos(max(mission.upright, -1.0))),
        duration_s=ended_s,
        wall_s=time.perf_counter() - begun_s,
    )


class MissionFromFloor:
    """One mission that begins on the floor: ground station and simulated side, and what is noted of
    both.
    """

    def __init__(
        self,
        world: World,
        config: Config,
        seed: int,
        autopilot: str | Airworthy,
        monitors: Monitors,
        confirm_s: float,
        give: Give | None,
        watch: Subscriber,
    ) -> None:
        """Set up both sides; the arguments are those of :func:`fly_mission`."""
        self._world, self._give, self._watch = world, give, watch
        self.track = TrueTrack()
        self.states: list[StateEntry] = []
        self.warnings: list[StateEntry] = []
        """Warnings to the operator, each with the mission's state."""
        self.upright = 1.0
        """Cosine of the largest tilt [-]."""
        self.stage = Stage(world, config, seed, self._see_step, autopilot=autopilot)
        self.trajectory = config.trajectory.build()
        self.flight = make_flight(
            config,
            confirm=confirm_at(confirm_s),
            subscribers=(self._hear,),
            wires=self.stage.wires,
            give=give,
            monitors=monitors,
        )

    def _see_step(self, time_s: float, position: Vec3) -> None:
        self.track.step(time_s, position)
        x, y = self.stage.plant.attitude[1:3]
        self.upright = min(self.upright, 1.0 - 2.0 * (x * x + y * y))

    def _hear(self, event: FlightEvent) -> None:
        self._watch(event)
        if isinstance(event, Notice):
            if event.kind == "state" or event.severity is Severity.WARNING:
                entry = StateEntry(event.state, round(event.time_s, 6), event.text)
                (self.states if event.kind == "state" else self.warnings).append(entry)
        elif isinstance(event, CommandSent) and self._give is not None:
            self._give(self._find_truth(event.tick.time_s))

    def _find_truth(self, time_s: float) -> TruthRecord:
        """The truth at one command, with the error of the figure while it is flown."""
        truth, released_s = self.stage.plant.truth(time_s), self.stage.plant.released_s
        wind = self._world.wind_mean
        if released_s is not None and self.track.times:
            # The wind answers forward in time only: it is asked for no later than the plant has
            # been.
            wind = self.stage.wind.at(self.track.times[-1] - released_s)
        started_s = self.flight.started_s if self.flight.state is State.TRACKING else None
        return make_truth(truth, wind, self.trajectory, started_s)


async def run_missions(
    world: Coroutine[Any, Any, None],
    flights: Sequence[Flight],
    limit_s: float,
    beside: Coroutine[Any, Any, None] | None = None,
) -> tuple[list[FlightOutcome | None], float]:
    """Run missions in ``world`` until all are over, or ``limit_s`` [s] have passed.

    ``beside`` runs with them.

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
