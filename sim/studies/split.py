"""Split of the disturbance into wind and thrust scale: how far it drifts, and whether its intervals hold the truth."""

import math
from collections.abc import Sequence
from statistics import fmean, median
from typing import Any, NamedTuple

import msgspec

from groundstation.core.messages import QUANTILE_95, DisturbanceMeter, DisturbanceReading, Notice, TickRecord
from groundstation.core.mission import State
from sim.batch import fly_batch
from sim.runs import fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare
from sim.world import generator

STEADY_SCENARIOS = ("paper", "quad1kg")
"""The scenarios with a constant vertical wind and the thrust as configured."""
PHASES = (State.HOLD, State.TRACKING)
"""Phases flown for a long time: hold, then the figure."""
STEADY_S = 300.0
"""Length of each phase [s]: a split that drifts has the time to."""
SAMPLE_S = 1.0
"""Time between two samples of the reading [s]: the reading is a mean over as long."""
DRAWN_SCENARIO = "paper"
"""The scenario that thrust scale and wind are drawn in."""
DRAWN_S = 60.0
"""Length of a flight with drawn thrust and wind [s]."""
THRUST_SCALES = (0.8, 1.1)
"""Range of the true thrust over the configured thrust [-], as a campaign draws it."""
VERTICAL_WIND_M_S2 = 1.0
"""Largest drawn vertical wind, up or down [m/s²]."""


class SteadySplit(NamedTuple):
    """Split in one long phase of one flight, by the readings that the screens show."""

    scenario: str
    phase: str
    true_m_s2: float
    """Vertical wind, down [m/s²]."""
    mean_m_s2: float
    """Mean of the readings [m/s²]."""
    worst_m_s2: float
    """Largest error of a reading [m/s²]."""
    half_m_s2: float
    """Median half of their 95 % interval [m/s²]."""
    covered: float
    """Share of the readings whose interval holds the truth [-]."""


class DrawnSplits(NamedTuple):
    """Thrust scale at the end of flights with drawn thrust and wind."""

    flights: int
    normalised_square: float
    """Mean of the squared error over its variance [-]: 1 where the variance is right."""
    covered: float
    """Share of the 95 % intervals that hold the truth [-]."""
    half: float
    """Median half of the interval [-]."""
    error: float
    """RMS error [-]."""


def fly_steadily(scenario: str, seed: int = 0) -> list[SteadySplit]:
    """Fly one mission with a long hold and a long figure; one result for each."""
    world, config = from_floor(*prepare(SCENARIOS[scenario], [f"takeoff.hold_s={STEADY_S:g}"]), STEADY_S)
    meter, readings = DisturbanceMeter(config.vehicle.mass_kg), dict[str, list[DisturbanceReading]]()
    state, sampled_s = "", -math.inf

    def hear(event: Notice) -> None:
        nonlocal state
        state = event.state

    def take(record: Any) -> None:
        nonlocal sampled_s
        if not isinstance(record, TickRecord) or state not in PHASES:
            return
        tick = record.tick
        meter.add(tick.time_s, tick.estimate)
        reading = meter.reading
        if reading is not None and tick.time_s >= sampled_s + SAMPLE_S:
            sampled_s = tick.time_s
            readings.setdefault(state, []).append(reading)

    fly_mission(world, config, seed=seed, on_event=hear, give=take)
    return [_summarise(scenario, phase, world.wind_mean[2], found) for phase, found in readings.items()]


def _summarise(scenario: str, phase: str, true: float, readings: Sequence[DisturbanceReading]) -> SteadySplit:
    errors = [abs(reading.wind_down_m_s2 - true) for reading in readings]
    halves = [reading.wind_down_error_m_s2 or 0.0 for reading in readings]
    return SteadySplit(
        scenario,
        str(phase),
        true,
        fmean(reading.wind_down_m_s2 for reading in readings),
        max(errors),
        median(halves),
        fmean(error <= half for error, half in zip(errors, halves, strict=True)),
    )


def fly_drawn(flights: int) -> DrawnSplits:
    """Fly ``flights`` with seeds 0 and up at once, each with its own thrust scale and vertical wind."""
    worlds = []
    world, config = prepare(SCENARIOS[DRAWN_SCENARIO], [])
    for seed in range(flights):
        draw = generator(seed, "split")
        scale = float(draw.uniform(*THRUST_SCALES))
        north, east, _ = world.wind_mean
        down = float(draw.uniform(-VERTICAL_WIND_M_S2, VERTICAL_WIND_M_S2))
        worlds.append(msgspec.structs.replace(world, thrust_gain=scale, wind_mean=(north, east, down)))
    flown = fly_batch(worlds, config, list(range(flights)), duration_s=DRAWN_S)
    errors = [float(found) - one.thrust_gain for found, one in zip(flown.thrust_scale.tolist(), worlds, strict=True)]
    deviations = flown.thrust_scale_deviation.tolist()
    shares = [abs(error) / deviation for error, deviation in zip(errors, deviations, strict=True)]
    return DrawnSplits(
        flights,
        fmean(share * share for share in shares),
        fmean(share <= QUANTILE_95 for share in shares),
        median(QUANTILE_95 * deviation for deviation in deviations),
        math.sqrt(fmean(error * error for error in errors)),
    )


def split_table(steady: Sequence[SteadySplit], drawn: DrawnSplits) -> str:
    """Both results as a page shows them."""
    lines = [
        "| 300 s of | wind down, true | mean found | worst error | 95 % interval | holds the truth |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for one in steady:
        lines.append(
            f"| `{one.scenario}`, {one.phase} | {one.true_m_s2:.2f} m/s² | {one.mean_m_s2:.2f} | "
            f"{one.worst_m_s2:.2f} | ± {one.half_m_s2:.2f} | {100.0 * one.covered:.0f} % |"
        )
    lines += [
        "",
        f"{drawn.flights} flights of `{DRAWN_SCENARIO}`, thrust scale {THRUST_SCALES[0]:g} to {THRUST_SCALES[1]:g} and "
        f"vertical wind ±{VERTICAL_WIND_M_S2:g} m/s² drawn, {DRAWN_S:g} s each: mean normalised squared error of λ̂ "
        f"{drawn.normalised_square:.2f}, {100.0 * drawn.covered:.0f} % of the 95 % intervals hold the truth, median "
        f"interval ±{drawn.half:.3f}, RMS error {drawn.error:.3f}.",
    ]
    return "\n".join(lines)
