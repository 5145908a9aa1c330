"""A flight whose commands are cut short in the air, and what the bring-down makes of it by the simulated truth."""

import asyncio
import math
from typing import NamedTuple

from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import CommandSent, FlightEvent
from groundstation.flight import make_flight
from groundstation.machine import sleep_until
from sim.runs import CONFIRM_S, Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from sim.time import in_virtual_time

RELEASED_S = 4.0
"""Earliest cut after the release [s]: every handshake is over."""
AFTERMATH_S = 6.0
"""Observed time after the cut [s]: the autopilot's own failsafe is over by then."""


class Fall(NamedTuple):
    """Descent of one vehicle after a cut."""

    touchdown_m_s: float | None
    """Sinking speed as it first met the floor; None where it never did."""
    tilt_deg: float
    """Largest tilt in the last 50 ms before the floor."""
    drift_m: float
    """Sideways, from the place of the cut to that where it rests."""


class _ControllerFailure(Exception):
    """Failure injected into the controller for the cause ``controller``."""


@in_virtual_time
async def cut(scenario: str, cause: str, at_s: float, *, seed: int, overrides: list[str]) -> Fall:
    """Fly ``scenario``, cut ``poses`` or ``controller`` after ``at_s`` [s], and see where the vehicle ends."""
    world, config = prepare(SCENARIOS[scenario], overrides)
    path: list[tuple[float, Vec3, float]] = []

    def step(time_s: float, position: Vec3) -> None:
        path.append((time_s, position, so3.angle_deg(so3.third_column(stage.plant.attitude)[2])))

    def watch(event: FlightEvent) -> None:
        if cause == "controller" and isinstance(event, CommandSent) and event.tick.flight_time_s >= at_s:
            raise _ControllerFailure

    stage = Stage(world, config, seed, step)
    flight = make_flight(config, confirm=confirm_at(CONFIRM_S), subscribers=(watch,))
    turning, flying = asyncio.ensure_future(stage.run()), asyncio.ensure_future(flight.run())
    await sleep_until(RELEASED_S)
    assert flight.started_s is not None, "the hand-shake takes longer than it used to"
    when = flight.started_s + at_s
    await sleep_until(when)
    begun = stage.plant.truth(when).position_ned
    if cause == "poses" and stage.mocap is not None:
        stage.mocap.cover(True)
    await sleep_until(when + AFTERMATH_S)
    for task in (turning, flying):
        task.cancel()
    await asyncio.gather(turning, flying, return_exceptions=True)
    met = next((t for t, (_, _, z), _ in path if t > when and z >= world.floor_z_m - 1e-9), math.inf)
    return Fall(
        touchdown_m_s=stage.plant.floor.touchdown_m_s,
        tilt_deg=max((tilt for t, _, tilt in path if met - 0.05 <= t < met), default=0.0),
        drift_m=math.dist(begun[:2], path[-1][1][:2]),
    )
