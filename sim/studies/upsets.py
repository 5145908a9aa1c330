"""Upsets: large steps and pushes of the wind, and starts far from the reference, with every law.

All laws fly on the same estimate, and only ours inverts the actuators' lags
(:mod:`sim.studies.comparison`). The printed law of 2013 is left out, as it does not hold these
vehicles still. In a hold, ours flies with its gains of a hold.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from statistics import median
from typing import Any, NamedTuple

import msgspec
import numpy as np

from groundstation.core.control import Gains, hold_gains
from groundstation.core.geometry import FARTHEST_M, Vec3
from groundstation.settings import Config
from sim.batch import Flights, fly_batch
from sim.scenarios import SCENARIOS, override_world, prepare
from sim.studies.comparison import worst_of_variants
from sim.studies.equal_margins import PUSHED
from sim.world import World, generator

LAWS = ("adaptive", "geometric", "l1", "pid", "indi")
VEHICLES = ("paper", "quad1kg")
"""Scenarios whose vehicles are upset."""
HOLD = ("trajectory.kind=hold", "trajectory.position_ned=[0.8,-0.8,-1.0]")
"""A hold one metre above the start."""
PHASES: dict[str, tuple[str, ...]] = {"figure": (), "hold": HOLD}
"""Overrides that choose each phase."""
BATCHES = len(LAWS) * (len(PHASES) + 1)
"""Number of batches for each vehicle [-]: the phases, and the drawn starts."""
UPSET_AT_S = World().wind_step_time_s
"""Time of the wind's step after the release [s], as in the scenarios with steps: laws and estimates
have settled."""
PUSHED_S = UPSET_AT_S + 5.0
"""Duration of these flights [s]."""
STATES_S = 6.0
"""Duration of the flights from a drawn start [s]. Chosen."""
FARTHEST_START_M = 5.0
"""Largest drawn distance from the reference [m]. Chosen."""
FASTEST_M_S = 3.0
"""Largest drawn speed [m/s]. Chosen."""
STEEPEST_DEG = 90.0
"""Largest drawn tilt [deg]. Chosen."""
ENOUGH = 1.1
"""Ratio to the best baseline up to which peak and time count as equal [-]. Chosen."""


class UpsetRow(NamedTuple):
    """One upset of one vehicle, by law: medians over the seeds, of the worst direction."""

    scenario: str
    phase: str
    upset: str
    peak_cm: dict[str, float | None]
    """Largest error; None where a flight did not get to its end."""
    back_s: dict[str, float | None]
    """Time until the error stays below 5 cm; None where it never does."""


class StatesRow(NamedTuple):
    """Flights of one law from drawn starts."""

    scenario: str
    law: str
    states: int
    recovered: float
    """Share whose error falls below 10 cm and stays there [-]."""
    lost: float
    """Share that flew 20 m away from their starts [-]."""
    settle_s: float | None
    """Median time of those that recover."""
    sink_m: float | None
    """Median height lost below the lower of start and reference, of those that recover."""
    sink_most_m: float | None
    """Largest such height."""


def list_upsets() -> dict[str, list[tuple[str, ...]]]:
    """Return the directions of each upset as overrides of the world: the variants of the scenarios
    with pushes.
    """
    found: dict[str, list[tuple[str, ...]]] = {}
    for name in PUSHED:
        scenario = SCENARIOS[name]
        for variant in scenario.variants:
            world = override_world(scenario.world, list(variant))
            size = math.hypot(*world.wind_step)
            push_s = world.wind_push_s
            vertical = world.wind_step[2] != 0.0
            what = (
                f"push {size:.0f}, {push_s:g} s" if push_s else f"step {'±' * vertical}{size:.0f}"
            )
            found.setdefault(f"{what}{' vertical' * vertical}", []).append(variant)
    return found


def fly_upsets(
    scenario: str,
    phase: str,
    *,
    seeds: int,
    laws: Sequence[str] = LAWS,
    on_done: Callable[[], None] = lambda: None,
) -> list[UpsetRow]:
    """Fly every law through every upset from each direction with seeds 0 to ``seeds`` - 1."""
    upsets = list_upsets()
    directions = [
        (upset, number, one) for upset, some in upsets.items() for number, one in enumerate(some)
    ]
    flown: dict[str, Flights] = {}
    for law in laws:
        world, config = _prepare(scenario, law, PHASES[phase])
        world = msgspec.structs.replace(world, wind_step_time_s=UPSET_AT_S)
        worlds = [
            override_world(world, list(one)) for _, _, one in directions for _ in range(seeds)
        ]
        flown[law] = fly_batch(
            worlds, config, list(range(seeds)) * len(directions), duration_s=PUSHED_S
        )
        on_done()
    places = [(upset, number) for upset, number, _ in directions for _ in range(seeds)]

    def find_worst(upset: str, values: Any, factor: float = 1.0) -> float | None:
        known = [None if math.isnan(value) else factor * value for value in values.tolist()]
        return worst_of_variants(
            [(k, value) for (one, k), value in zip(places, known, strict=True) if one == upset]
        )

    return [
        UpsetRow(
            scenario,
            phase,
            upset,
            {law: find_worst(upset, flights.gust_peak_m, 100.0) for law, flights in flown.items()},
            {law: find_worst(upset, flights.gust_back_s) for law, flights in flown.items()},
        )
        for upset in upsets
    ]


def _prepare(scenario: str, law: str, phase: Iterable[str]) -> tuple[World, Config]:
    """Return the world, and the configuration of ``law`` in the ``phase`` of these overrides.

    In a hold it flies with its gains of a hold, if it has any.
    """
    world, config = prepare(SCENARIOS[scenario], [*phase, f"controller.kind={law}"])
    if phase and isinstance(config.controller, Gains):
        config = msgspec.structs.replace(config, controller=hold_gains(config.controller))
    return world, config


def draw_start(world: World, reference: Vec3, seed: int) -> World:
    """Return ``world`` with a drawn start: position, velocity and tilt, each of uniform size."""
    draw = generator(seed, "upset")

    def draw_vector(most: float, axes: int) -> list[float]:
        normals = draw.standard_normal(axes)
        parts: list[float] = (most * draw.random() * normals / np.linalg.norm(normals)).tolist()
        return parts

    x, y, z = draw_vector(FARTHEST_START_M, 3)
    u, v, w = draw_vector(FASTEST_M_S, 3)
    roll, pitch = draw_vector(STEEPEST_DEG, 2)
    north, east, down = reference
    return msgspec.structs.replace(
        world,
        start_ned=(north + x, east + y, down + z),
        start_velocity=(u, v, w),
        start_turn_deg=(roll, pitch, 0.0),
        floor_z_m=FARTHEST_M,  # none in reach: the height that a law loses is measured instead
    )


def fly_states(
    scenario: str,
    *,
    states: int,
    laws: Sequence[str] = LAWS,
    on_done: Callable[[], None] = lambda: None,
) -> list[StatesRow]:
    """Fly every law to the figure from ``states`` drawn starts, the same for all."""
    found = []
    for law in laws:
        world, config = _prepare(scenario, law, ())
        reference = config.trajectory.build().position_at(0.0)
        worlds = [draw_start(world, reference, seed) for seed in range(states)]
        flights = fly_batch(worlds, config, list(range(states)), duration_s=STATES_S)
        lowest_starts = np.array([max(one.start_ned[2], reference[2]) for one in worlds])
        good = np.isfinite(flights.settle_s)
        settled = flights.settle_s[good].tolist()
        sunk = (flights.lowest_m - lowest_starts)[good].tolist()
        found.append(
            StatesRow(
                scenario,
                law,
                states,
                float(good.mean()),
                1.0 - float(flights.survived.mean()),
                median(settled) if settled else None,
                median(sunk) if sunk else None,
                max(sunk, default=None),
            )
        )
        on_done()
    return found


def compare_upsets(
    scenarios: Sequence[str], *, seeds: int, states: int, on_done: Callable[[], None] = lambda: None
) -> tuple[list[UpsetRow], list[StatesRow]]:
    """Fly every law through every upset of each vehicle, on its figure and in a hold, and from
    drawn starts.

    ``on_done`` is called after each of :data:`BATCHES` batches of a scenario.
    """
    pushed, started = list[UpsetRow](), list[StatesRow]()
    for scenario in scenarios:
        for phase in PHASES:
            pushed += fly_upsets(scenario, phase, seeds=seeds, on_done=on_done)
        started += fly_states(scenario, states=states, on_done=on_done)
    return pushed, started


def _over_best(values: dict[str, float | None]) -> tuple[str, bool]:
    """Return ours over the best of the others as a cell, and whether it exceeds :data:`ENOUGH`."""
    ours, others = values[LAWS[0]], [values[law] for law in LAWS[1:] if values.get(law) is not None]
    known = [value for value in others if value is not None]
    if ours is None:
        return "-", bool(known)
    if not known:
        return "only ours", False
    least = min(known)
    if least == 0.0:
        return ("1.00", False) if ours == 0.0 else (f"+{ours:.2f} s", True)
    return f"{ours / least:.2f}", ours > ENOUGH * least


def upsets_table(rows: Sequence[UpsetRow], states: Sequence[StatesRow]) -> str:
    """Return both results as a page shows them."""
    head = ["peak, cm (back under 5 cm after, s)", *LAWS, "peak over best", "time over best"]
    lines = [f"| {' | '.join(head)} |", f"|---|{'---:|' * (len(head) - 1)}"]
    missed = 0
    for row in rows:
        cells = [f"`{row.scenario}`, {row.phase}: {row.upset}"]
        for law in LAWS:
            peak, back = row.peak_cm[law], row.back_s[law]
            cells.append(
                "lost"
                if peak is None
                else f"{peak:.1f} ({'never' if back is None else f'{back:.2f}'})"
            )
        ratios = [_over_best(row.peak_cm), _over_best(row.back_s)]
        missed += any(over for _, over in ratios)
        lines.append(f"| {' | '.join([*cells, *(text for text, _ in ratios)])} |")
    lines += [
        "",
        f"{len(rows) - missed} of {len(rows)} rows are within {ENOUGH:g} of the best baseline in "
        "both.",
    ]
    if states:
        lines += [
            "",
            "| drawn starts | recover | fly off | median time, s | median height lost, m | most, "
            "m |",
            "|---|---:|---:|---:|---:|---:|",
        ]
    for one in states:
        recovered, lost = 100.0 * one.recovered, 100.0 * one.lost
        cells = [
            "-" if value is None else f"{value:.2f}"
            for value in (one.settle_s, one.sink_m, one.sink_most_m)
        ]
        lines.append(
            f"| `{one.scenario}`, {one.law} | {recovered:.1f} % | {lost:.1f} % | "
            f"{' | '.join(cells)} |"
        )
    return "\n".join(lines)
