"""Controllers side by side: the same scenarios, seeds, estimator and wire bytes, flown by several processes."""

import concurrent.futures as cf  # noqa: TID251  # processes, not threads, and none of them around an event loop
import math
import multiprocessing
from array import array
from collections.abc import Callable, Iterable, Sequence
from statistics import median

import msgspec

from groundstation.core import Tick
from groundstation.core.geometry import Vec3
from sim.runs import STEADY_S, fly
from sim.scenarios import SCENARIOS, prepare

CONTROLLERS = ("adaptive", "uncompensated", "geometric", "pid", "indi")
WITHOUT_ADAPTATION = "adaptive, kb=0"
"""Flown beside ``adaptive`` through the gust front: what adaptation buys."""
GUST = "gust_front"
TRACE_S = 0.05
"""One point of a trace is the largest error of so long [s]."""


class Case(msgspec.Struct, frozen=True):
    """One controller in one scenario."""

    scenario: str
    controller: str
    """As the table names it."""
    overrides: tuple[str, ...]
    """``--set`` overrides that choose it."""


class Flown(msgspec.Struct, frozen=True):
    """One flight of a case."""

    case: Case
    seed: int
    survived: bool
    rms_cm: float | None
    max_cm: float | None
    settle_s: float | None
    effort: float | None
    trace: list[float] | None
    """True error [cm] from the start on, every :data:`TRACE_S`; only where asked for."""


class Row(msgspec.Struct, frozen=True):
    """One controller in one scenario, over all seeds: medians, and the spread of the RMS error."""

    scenario: str
    controller: str
    flights: int
    survived: bool
    """True where every flight got to its end."""
    crashed: int
    """How many did not."""
    rms_cm: float | None
    """RMS of the true error over the steady part (from 15 s); None where a flight crashed, as for all below."""
    rms_cm_min: float | None
    rms_cm_max: float | None
    max_cm: float | None
    settle_s: float | None
    """Time after which the error stays below 10 cm; None too where most flights never get there."""
    effort: float | None
    """√(mean |ω|² / (1 rad/s)² + var T / (m g)²) of the commands over the steady part [-]."""


def cases(scenarios: Iterable[str], controllers: Sequence[str], overrides: Sequence[str] = ()) -> list[Case]:
    """Every controller in every scenario, and ours without adaptation in the gust front; ``overrides`` hold for all."""
    found: list[Case] = []
    for scenario in scenarios:
        for name in controllers:
            found.append(Case(scenario, name, (*overrides, f"controller.kind={name}")))
            if scenario == GUST and name == "adaptive":
                off = ("controller.kb=0.0", "controller.composite=off")
                found.append(Case(scenario, WITHOUT_ADAPTATION, (*overrides, *off)))
    return found


def flown(case: Case, seed: int, duration_s: float, *, traced: bool = False) -> Flown:
    """Fly one case once."""
    world, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
    rates, thrusts = array("d"), array("d")
    times: list[float] = []
    places: list[Vec3] = []
    start = math.inf

    def on_tick(tick: Tick) -> None:
        nonlocal start
        start = tick.estimate.time_s - tick.flight_time_s
        if tick.flight_time_s >= STEADY_S:
            x, y, z = tick.decision.drive.rates
            rates.append(x * x + y * y + z * z)
            thrusts.append(tick.decision.drive.thrust)

    def on_step(time_s: float, position: Vec3) -> None:
        times.append(time_s)
        places.append(position)

    result = fly(world, config, seed=seed, duration_s=duration_s, on_tick=on_tick, on_step=on_step if traced else None)
    verdict = result.verdict
    weight = config.vehicle.mass_kg * config.controller.gravity
    trace = None
    if traced:
        at = config.trajectory.build().position_at
        trace = [0.0] * (int(duration_s / TRACE_S) + 1)
        for time_s, place in zip(times, places, strict=True):
            index = int((time_s - start) / TRACE_S)
            if 0 <= index < len(trace):
                trace[index] = max(trace[index], 100.0 * math.dist(place, at(time_s - start)))
        trace = trace[: int(result.duration_s / TRACE_S)]
    return Flown(
        case,
        seed,
        result.completed,
        verdict.rms_cm,
        verdict.max_cm,
        verdict.settle_s,
        _effort(rates, thrusts, weight) if rates else None,
        trace,
    )


def fly_all(
    work: Sequence[Case],
    seeds: int,
    duration_s: float,
    *,
    workers: int,
    traced: bool = False,
    on_done: Callable[[int], None] | None = None,
) -> list[Flown]:
    """Every case with seeds 0 … ``seeds`` - 1, in the order of ``work``; ``on_done`` hears how many are flown.

    Only the first seed of the gust front is traced.
    """
    flights = [(case, seed) for case in work for seed in range(seeds)]
    # Spawned, as a forked process would inherit whatever threads this one has.
    context = multiprocessing.get_context("spawn")
    with cf.ProcessPoolExecutor(max_workers=workers, mp_context=context) as pool:
        futures = [
            pool.submit(flown, case, seed, duration_s, traced=traced and seed == 0 and case.scenario == GUST)
            for case, seed in flights
        ]
        try:
            for count, _ in enumerate(cf.as_completed(futures), start=1):
                if on_done is not None:
                    on_done(count)
            return [future.result() for future in futures]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def rows(results: Sequence[Flown]) -> list[Row]:
    """One row a case, in the order of their first flights."""
    by_case: dict[Case, list[Flown]] = {}
    for one in results:
        by_case.setdefault(one.case, []).append(one)
    return [_row(case, flights) for case, flights in by_case.items()]


def _row(case: Case, flights: list[Flown]) -> Row:
    crashed = sum(not one.survived for one in flights)
    errors = [one.rms_cm for one in flights]
    known = [error for error in errors if error is not None] if not crashed else []
    # A flight that never settles counts as later than any.
    settled = median([math.inf if one.settle_s is None else one.settle_s for one in flights])
    return Row(
        case.scenario,
        case.controller,
        flights=len(flights),
        survived=crashed == 0,
        crashed=crashed,
        rms_cm=_middle(errors, crashed),
        rms_cm_min=min(known, default=None),
        rms_cm_max=max(known, default=None),
        max_cm=_middle([one.max_cm for one in flights], crashed),
        settle_s=settled if not crashed and math.isfinite(settled) else None,
        effort=_middle([one.effort for one in flights], crashed),
    )


def _middle(values: list[float | None], crashed: int) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known and not crashed else None


def _effort(rates: Sequence[float], thrusts: Sequence[float], weight: float) -> float:
    mean = sum(thrusts) / len(thrusts)
    swing = sum((thrust - mean) ** 2 for thrust in thrusts) / len(thrusts) / weight**2
    return math.sqrt(sum(rates) / len(rates) + swing)
