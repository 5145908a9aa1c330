"""A whole mission in virtual time: from the floor to the figure and back, judged by the simulated truth."""

import asyncio
import math
import time
from array import array
from collections.abc import Callable, Coroutine
from typing import Any, TypeAlias

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.mission import State
from groundstation.flight import Flight, FlightOutcome
from groundstation.recording import Give, make_flight
from groundstation.runtime import sleep_until
from groundstation.settings import Config
from sim.runs.referee import STEADY_S
from sim.runs.stage import Stage
from sim.time import VirtualTimeLoop
from sim.world import World

Script: TypeAlias = Callable[[Flight, Stage], Coroutine[Any, Any, None]]
MISSION_CONFIRM_S = 3.0
"""When arming is confirmed, in virtual time [s]."""
LIMIT_S = 120.0
"""A mission that takes so much longer than its figure has failed [s, virtual]."""
REST_S = 1.0
"""How long the world goes on after the end [s]."""


class Entered(msgspec.Struct, frozen=True):
    """A state of the mission, when it began, and why."""

    state: str
    time_s: float
    """On the event loop's clock [s]."""
    reason: str


class MissionResult(msgspec.Struct, frozen=True, kw_only=True):
    """A flown mission."""

    landed: bool
    """On the floor, motors off, and nothing made it come down early."""
    why: str
    """Why it ended, as a sentence."""
    fault: str
    """What made it come down early; empty where nothing did."""
    states: tuple[Entered, ...]
    """In their order."""
    touchdown_m_s: float | None
    """Fastest that it met the floor, by the truth; None where it never did."""
    rms_cm: float | None
    """Of the true error on the figure, from 15 s after it began; None where it was not flown so long."""
    max_cm: float | None
    figure_s: float
    """How long that is [s]."""
    home_m: float
    """From where it took off to where it stands now [m]."""
    tilt_max_deg: float
    """Farthest that it leant."""
    duration_s: float
    wall_s: float


class TrueTrack:
    """What the referee of a mission sees: every step of the plant."""

    def __init__(self) -> None:
        self.time = array("d")
        self.places: list[Vec3] = []
        self.upright = 1.0
        """Cosine of the largest tilt."""


def from_floor(world: World, config: Config, figure_s: float | None) -> tuple[World, Config]:
    """The same vehicle on the floor below where it would be let go, and told to fly ``figure_s`` [s]."""
    north, east, _ = world.start_ned
    flight = msgspec.structs.replace(config.flight, start="floor", idle_thrust=0.0, duration_s=figure_s)
    return (
        msgspec.structs.replace(world, start_ned=(north, east, world.floor_z_m), start_thrust=0.0, ground_effect=True),
        msgspec.structs.replace(config, flight=flight),
    )


def fly_mission(
    world: World,
    config: Config,
    *,
    seed: int,
    autopilot: str = "px4",
    on_event: Callable[[str], None] | None = None,
    script: Script | None = None,
    give: Give | None = None,
) -> MissionResult:
    """Fly ``config``, which says how long the figure is flown, in ``world``, from its floor; see :func:`from_floor`.

    ``script(flight, stage)`` runs beside it, to ask for what an operator would, or to break something; ``give`` takes
    what is to be recorded.
    """
    start = time.perf_counter()
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        values = runner.run(_fly(world, config, seed, autopilot, on_event, script, give))
    return MissionResult(**values, wall_s=time.perf_counter() - start)


async def _fly(
    world: World,
    config: Config,
    seed: int,
    autopilot: str,
    on_event: Callable[[str], None] | None,
    script: Script | None,
    give: Give | None,
) -> dict[str, Any]:
    loop = asyncio.get_running_loop()
    truth, states = TrueTrack(), list[Entered]()

    def step(time_s: float, position: Vec3) -> None:
        truth.time.append(time_s)
        truth.places.append(position)
        x, y = stage.plant.attitude[1:3]
        truth.upright = min(truth.upright, 1.0 - 2.0 * (x * x + y * y))

    async def confirm() -> bool:
        await sleep_until(MISSION_CONFIRM_S)
        return True

    def note_state(state: State, reason: str) -> None:
        states.append(Entered(state, round(loop.time(), 6), reason))

    stage = Stage(world, config, seed, step, autopilot=autopilot)
    flight = make_flight(config, confirm=confirm, on_event=on_event, on_state=note_state, wires=stage.wires, give=give)
    turning, flying = asyncio.ensure_future(stage.run()), asyncio.ensure_future(flight.run())
    beside = asyncio.ensure_future(script(flight, stage)) if script is not None else None
    limit = LIMIT_S + (config.flight.duration_s or 0.0)
    await asyncio.wait({turning, flying}, timeout=limit, return_when=asyncio.FIRST_COMPLETED)
    outcome: Any = flying.result() if flying.done() else None
    ended_s = loop.time()
    if flying.done():
        await asyncio.sleep(REST_S)
    else:
        flight.stop("the mission took too long")
    tasks = [task for task in (turning, flying, beside) if task is not None]
    for task in tasks:
        task.cancel()
    failures = await asyncio.gather(*tasks, return_exceptions=True)
    for failure in failures:
        if isinstance(failure, Exception):
            raise failure
    stage.plant.advance(loop.time())
    errors = _errors(config, truth, states, flight.started_s)
    start, end = world.start_ned, stage.plant.truth(loop.time()).position_ned
    assert outcome is None or isinstance(outcome, FlightOutcome)
    return {
        "landed": outcome is not None and outcome.state is State.LANDED and not outcome.fault,
        "why": f"not over after {limit:g} s" if outcome is None else f"{outcome.state}: {outcome.reason}",
        "fault": "" if outcome is None else outcome.fault,
        "states": tuple(states),
        "touchdown_m_s": stage.plant.hardest_m_s,
        "rms_cm": 100.0 * math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else None,
        "max_cm": 100.0 * max(errors) if errors else None,
        "figure_s": len(errors) * world.step_s,
        "home_m": math.dist(start[:2], end[:2]),
        "tilt_max_deg": math.degrees(math.acos(max(truth.upright, -1.0))),
        "duration_s": ended_s,
    }


def _errors(config: Config, truth: TrueTrack, states: list[Entered], started_s: float | None) -> list[float]:
    """True distances from the figure [m], from 15 s after its beginning until the flight leaves it."""
    tracking = next((i for i, one in enumerate(states) if one.state == State.TRACKING), None)
    if tracking is None or started_s is None:
        return []
    until = states[tracking + 1].time_s if tracking + 1 < len(states) else math.inf
    at = config.trajectory.build().position_at
    return [
        math.dist(place, at(t - started_s))
        for t, place in zip(truth.time, truth.places, strict=True)
        if started_s + STEADY_S <= t < until
    ]
