"""A whole flight in virtual time: the real application against the simulated side, through wire bytes."""

import asyncio
import hashlib
import struct
import time
from collections.abc import Callable
from typing import Any

import msgspec

from groundstation.core import Tick
from groundstation.core.control import Law
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Pose
from groundstation.core.mission import State
from groundstation.flight import FlightOutcome
from groundstation.recording import Give, Record, make_flight
from groundstation.runtime import sleep_until
from groundstation.settings import Config
from sim.runs.referee import FlightVerdict, Referee
from sim.runs.stage import Stage
from sim.time import Address, VirtualTimeLoop
from sim.world import World

CONFIRM_S = 1.0
"""When arming is confirmed, in virtual time [s]."""
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
        self._hash.update(_STAMP.pack(time_s, source[1], target[1], len(data)))
        self._hash.update(data)
        self.count += 1
        if self._keep is not None:
            self._keep(time_s, source, target, data)

    def sha256(self) -> str:
        """The digest so far, in hex."""
        return self._hash.hexdigest()


_STAMP = struct.Struct("<dHHI")


def fly(
    world: World,
    config: Config,
    *,
    seed: int,
    duration_s: float,
    autopilot: str = "px4",
    on_tick: Callable[[Tick], None] | None = None,
    on_datagram: Callable[[float, Address, Address, bytes], None] | None = None,
    on_event: Callable[[str], None] | None = None,
    on_pose: Callable[[Pose], None] | None = None,
    give: Give | None = None,
    on_progress: Callable[[float], None] | None = None,
    on_step: Callable[[float, Vec3], None] | None = None,
) -> Result:
    """Fly ``config`` in ``world`` for ``duration_s`` [s] after the release; never raises for a bad flight.

    ``give`` takes what is to be recorded. ``autopilot`` is one of :data:`sim.autopilots.kinds.AUTOPILOTS`.
    ``on_step`` sees the true position [m, NED] at every step of the plant, by the event loop's clock.
    """
    start = time.perf_counter()
    log = WireLog(on_datagram)
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        loop = runner.get_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.tap = log
        values = runner.run(
            _fly(world, config, seed, duration_s, autopilot, on_tick, on_event, on_pose, give, on_progress, on_step)
        )
    return Result(**values, log_sha256=log.sha256(), datagrams=log.count, wall_s=time.perf_counter() - start)


async def _fly(
    world: World,
    config: Config,
    seed: int,
    duration_s: float,
    autopilot: str,
    on_tick: Callable[[Tick], None] | None,
    on_event: Callable[[str], None] | None,
    on_pose: Callable[[Pose], None] | None,
    give: Give | None,
    on_progress: Callable[[float], None] | None,
    on_step: Callable[[float, Vec3], None] | None,
) -> dict[str, Any]:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    referee = Referee(
        world, config.vehicle.mass_kg, config.controller.kb if isinstance(config.controller, Law) else None
    )

    def step(time_s: float, position: Vec3) -> None:
        referee.step(time_s, position)
        if on_step is not None:
            on_step(time_s, position)

    over = False  # then the world has come to its end, and what is cancelled is no part of the flight
    stage = Stage(world, config, seed, referee.step if on_step is None else step, autopilot=autopilot)
    plant = stage.plant

    def watch(tick: Tick) -> None:
        # First the plant: the wind answers forward in time only, so asking it must not run ahead of the flight.
        truth = plant.truth(tick.time_s)
        released = plant.released_s
        referee.tick(tick, stage.wind.at(tick.time_s - released) if released is not None else world.wind_mean)
        if on_tick is not None:
            on_tick(tick)
        if referee.find_crash(truth.position_ned, lands=flight.state in DOWN):
            clock.cancel()

    async def confirm() -> bool:
        # Whoever confirms takes a moment: so our frames do not start in step with the cameras.
        await sleep_until(CONFIRM_S)
        return True

    def record(record: Record) -> None:
        if give is not None and not over:
            give(record)

    flight = make_flight(
        config,
        confirm=confirm,
        on_tick=watch,
        on_event=on_event,
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
    return {
        "completed": complete,
        "why": "flown to the end" if complete else _why(referee, outcome, failure),
        "duration_s": flown,
        "verdict": referee.verdict(config.trajectory.build(), begun or 0.0),
    }


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
