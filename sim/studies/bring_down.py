"""Flights whose commands are cut short in the air: what the bring-down makes of them, by the simulated truth."""

import asyncio
import math
from collections.abc import Iterator
from statistics import median

import msgspec

from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import CommandSent, FlightEvent
from groundstation.flight import make_flight
from groundstation.machine import sleep_until
from sim.runs import CONFIRM_S, Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from sim.time import in_virtual_time

CAUSES = ("poses", "controller")
"""Streams that can be cut: the poses (the controller goes on to the coast limit), or the controller (its last
command is held)."""
FIRST_CUT_S = 4.0
"""Time of the cut in the first flight [s]."""
CUT_STEP_S = 0.713
"""Additional time of the cut in each next flight [s]."""
RELEASED_S = 4.0
"""Earliest cut after the release [s]: every handshake is over."""
AFTERMATH_S = 6.0
"""Observed time after the cut [s]: the autopilot's own failsafe is over by then."""


class Fall(msgspec.Struct, frozen=True, kw_only=True):
    """Descent of one vehicle after a cut."""

    scenario: str
    cause: str
    at_s: float
    """When the cut came [s of flight]."""
    height_m: float
    """Above the floor, at the cut."""
    speed_m_s: float
    """At the cut."""
    touchdown_m_s: float | None
    """Sinking speed as it first met the floor; None where it never did."""
    after_s: float | None
    """Time between the cut and the floor [s]."""
    tilt_deg: float
    """Largest tilt in the last 50 ms before the floor."""
    drift_m: float
    """Sideways, from the place of the cut to that where it rests."""


class _ControllerFailure(Exception):
    """Failure injected into the controller for the cause ``controller``."""


@in_virtual_time
async def cut(scenario: str, cause: str, at_s: float, *, seed: int = 0, overrides: list[str] | None = None) -> Fall:
    """Fly ``scenario`` in virtual time, cut ``cause`` after ``at_s`` [s], and see where the vehicle ends."""
    world, config = prepare(SCENARIOS[scenario], overrides or [])
    path: list[tuple[float, Vec3, float]] = []

    def step(time_s: float, position: Vec3) -> None:
        path.append((time_s, position, so3.angle_deg(so3.third_column(stage.plant.attitude)[2])))

    def watch(event: FlightEvent) -> None:
        if cause == "controller" and isinstance(event, CommandSent) and event.tick.flight_time_s >= at_s:
            raise _ControllerFailure

    stage = Stage(world, config, seed, step)
    flight = make_flight(config, confirm=confirm_at(CONFIRM_S), subscribers=(watch,))
    turning, flying = asyncio.ensure_future(stage.run()), asyncio.ensure_future(flight.run())
    loop = asyncio.get_running_loop()
    await sleep_until(RELEASED_S)
    assert flight.started_s is not None, "the hand-shake takes longer than it used to"
    when = flight.started_s + at_s
    await sleep_until(when)
    begun = stage.plant.truth(loop.time())
    if cause == "poses" and stage.mocap is not None:
        stage.mocap.cover(True)
    await sleep_until(when + AFTERMATH_S)
    ends = stage.plant.truth(loop.time())
    for task in (turning, flying):
        task.cancel()
    await asyncio.gather(turning, flying, return_exceptions=True)
    met = next((t for t, (_, _, z), _ in path if t > when and z >= world.floor_z_m - 1e-9), None)
    return Fall(
        scenario=scenario,
        cause=cause,
        at_s=at_s,
        height_m=world.floor_z_m - begun.position_ned[2],
        speed_m_s=math.hypot(*begun.velocity_ned),
        touchdown_m_s=stage.plant.floor.touchdown_m_s,
        after_s=None if met is None else met - when,
        tilt_deg=max((tilt for t, _, tilt in path if met is not None and met - 0.05 <= t < met), default=0.0),
        drift_m=math.dist(begun.position_ned[:2], ends.position_ned[:2]),
    )


def cut_all(scenarios: list[str], flights: int) -> Iterator[Fall]:
    """``flights`` flights a scenario and cause, cut at instants spread over the figure, seeds 0 and up."""
    for scenario in scenarios:
        for cause in CAUSES:
            for seed in range(flights):
                yield cut(scenario, cause, FIRST_CUT_S + CUT_STEP_S * seed, seed=seed)


def markdown(falls: list[Fall]) -> str:
    """One row a scenario and cause: medians, the worst in brackets."""
    lines = [
        "| cut | from | at | after | floor met at | tilt there | sideways |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for place in dict.fromkeys((fall.scenario, fall.cause) for fall in falls):
        here = [fall for fall in falls if (fall.scenario, fall.cause) == place]
        height, speed = _spread(here, "height_m", "m"), _spread(here, "speed_m_s", "m/s")
        rest = (_spread(here, "after_s", "s"), _spread(here, "touchdown_m_s", "m/s"), _spread(here, "tilt_deg", "°", 0))
        lines.append(
            f"| `{place[0]}`, {place[1]} | {' | '.join([height, speed, *rest, _spread(here, 'drift_m', 'm')])} |"
        )
    return "\n".join(lines)


def _spread(falls: list[Fall], field: str, unit: str, places: int = 1) -> str:
    values = [value for value in (getattr(fall, field) for fall in falls) if value is not None]
    if not values:
        return "never"
    low, high = f"{median(values):.{places}f}", f"{max(values):.{places}f}"
    return f"{low} {unit}" if low == high else f"{low} ({high}) {unit}"
