"""Comparison: controllers side by side in the same scenarios, with the same seeds, estimator and
wire bytes.
"""

import math
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import msgspec

from groundstation.analysis.report import figure_class
from groundstation.config import ConfigError, lend, several, without_frames
from groundstation.core.control import make_controller
from groundstation.core.messages import LEAST_JUDGED_S
from groundstation.machine import replace_between_markers
from groundstation.runtime import require_package
from sim.runs import (
    FlightVerdict,
    Flyers,
    check_duration,
    check_whole,
    fly,
    lend_name,
    run_beside,
)
from sim.scenarios import SCENARIOS, prepare
from sim.text import notice

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame


CONTROLLERS = ("adaptive", "uncompensated", "geometric", "l1", "pid", "indi")
WITHOUT_ADAPTATION = "adaptive, kb=0"
"""Controller that is flown beside ``adaptive`` through the gust front: it shows what adaptation
gains."""
GUST = "gust_front"


class ControllerComparison:
    """Result of a comparison: ``rows``, one for each controller in each scenario, and the
    ``flights`` that they sum up.
    """

    def __init__(self, flights: "Sequence[ComparedFlight]") -> None:
        self.flights = tuple(flights)
        self.rows = tuple(rows(flights))

    def __str__(self) -> str:
        """Return the table as a terminal shows it."""
        return text_table(self.rows)

    __repr__ = __str__  # what a notebook shows

    def to_pandas(self) -> "DataFrame":
        """Return the rows as a table, by scenario and controller.

        Raises:
            ConfigError: pandas is not installed.
        """
        require_package("pandas", "to_pandas", "notebook")
        from pandas import DataFrame

        return DataFrame(msgspec.to_builtins(self.rows)).set_index(["scenario", "controller"])

    def plot(self) -> "Figure":
        """Draw the RMS error [cm] by scenario and controller, without a bar where a flight crashed.

        Raises:
            ConfigError: pandas or matplotlib is not installed.
        """
        require_package("matplotlib", "plot", "notebook")
        errors_cm = self.to_pandas()["rms_cm"].astype(float).unstack(sort=False)
        figure = figure_class()(figsize=(9.5, 4.6), layout="constrained")
        errors_cm.plot.bar(ax=figure.subplots(), logy=True, rot=0, ylabel="RMS position error [cm]")
        return figure


@without_frames
def compare(
    controllers: object = CONTROLLERS,
    *,
    scenarios: str | Iterable[str] | None = None,
    seeds: int = 1,
    duration: float = 60.0,
    overrides: str | Sequence[str] = (),
    workers: int = 1,
    on_done: Callable[[int, int], None] | None = None,
) -> ControllerComparison:
    """Fly controllers through the same scenarios with the same seeds: what
    ``groundstation-sim compare`` does.

    Args:
        controllers: one or several: names, or your own, as :func:`sim.runs.simulation.simulate`
            takes one.
        scenarios: their names; without them, all that are flown once a seed. Those with large
            pushes (``step_5``, ``push_10``, …) are flown from each direction, and the worst counts.
        seeds: each flies with seeds 0 to ``seeds`` - 1.
        duration: of each flight [s], longer than 16.
        overrides: ``"key=value"`` each, for all, as ``--set``.
        workers: how many processes fly. More than one wants ``if __name__ == "__main__":`` around a
            script; a controller that they could not import, as one written in a notebook, has all
            fly in this one.
        on_done: hears how many of how many flights are flown.

    Raises:
        ConfigError: an unknown name or key, a bad value, or a flight that the vehicle can't fly.
        UserCodeFault: a controller of your own failed in flight; its cause shows where.
    """
    duration = check_duration(duration, LEAST_JUDGED_S)
    seeds, workers = check_whole("--seeds", seeds, 1), check_whole("--workers", workers, 1)
    places = _check_scenarios(scenarios)
    own: dict[str, object] = {}
    given = several(controllers)
    if not given or any(one is None for one in given):
        says = notice("compare.controllers", choices=list(CONTROLLERS), found=controllers)
        raise ConfigError("--controllers", says)
    names = [str(lend_name(controller, own)) for controller in given]
    work = cases(places, names, [str(one) for one in several(overrides)])
    with lend(own):
        for case in work:  # what can't fly says so before anything flies
            _, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
            make_controller(config.controller, config.vehicle)
        count, done = len(work) * seeds, on_done or (lambda flown, of: None)
        done(0, count)
        with Flyers(workers if all(_can_be_imported(*one) for one in own.items()) else 1) as flyers:
            return ControllerComparison(
                fly_all(work, seeds, duration, flyers, lambda flown: done(flown, count))
            )


def _check_scenarios(scenarios: str | Iterable[str] | None) -> list[str]:
    """Return the names of ``scenarios``; without them, of all that have no variants.

    Raises:
        ConfigError: there is none, or one is unknown.
    """
    plain = [name for name, scenario in SCENARIOS.items() if not scenario.variants]
    places = several(plain if scenarios is None else scenarios)
    unknown = [place for place in places if not isinstance(place, str) or place not in SCENARIOS]
    if unknown or not places:
        says = notice("value.choices", choices=sorted(SCENARIOS), found=(unknown or [scenarios])[0])
        raise ConfigError("--scenarios", says)
    return places


class Case(msgspec.Struct, frozen=True):
    """One controller in one scenario."""

    scenario: str
    controller: str
    """As the table names it."""
    overrides: tuple[str, ...]
    """``--set`` overrides that choose it."""
    variant: int = 0
    """Which of the scenario's variants."""


class ComparedFlight(msgspec.Struct, frozen=True):
    """One flight of a case."""

    case: Case
    seed: int
    survived: bool
    verdict: FlightVerdict


class ComparisonRow(msgspec.Struct, frozen=True):
    """One controller in one scenario, over all seeds: medians, and the spread of the RMS error."""

    scenario: str
    controller: str
    flights: int
    survived: bool
    """True where every flight got to its end."""
    crashed: int
    """Number of flights that crashed."""
    rms_cm: float | None
    """RMS of the true error over the steady part (from 15 s); None where a flight crashed, as for
    all below."""
    rms_cm_min: float | None
    rms_cm_max: float | None
    max_cm: float | None
    settle_s: float | None
    """Time after which the error stays below 10 cm; None too where most flights never get there."""
    effort_rad_s: float | None
    """Control effort: see :class:`sim.runs.FlightVerdict`."""
    peak_cm: float | None = None
    """Largest error after the wind's step or push: the worst of the scenario's variants."""
    back_s: float | None = None
    """Longest time after the gust until the error stays below 5 cm [s]; None where it never
    does."""


def cases(
    scenarios: Iterable[str], controllers: Sequence[str], overrides: Sequence[str] = ()
) -> list[Case]:
    """Return each controller in each scenario, and ours without adaptation in the gust front.

    ``overrides`` hold for all.
    """
    found: list[Case] = []
    for scenario in scenarios:
        for name in controllers:
            short, chosen = _short_name(name, controllers), (*overrides, f"controller.kind={name}")
            for number, variant in enumerate(SCENARIOS[scenario].variants or ((),)):
                found.append(Case(scenario, short, (*variant, *chosen), number))
            if scenario == GUST and name == "adaptive":
                off = ("controller.kb=0.0", "controller.composite=off")
                found.append(Case(scenario, WITHOUT_ADAPTATION, (*overrides, *off)))
    return found


def _short_name(name: str, among: Sequence[str]) -> str:
    """Return the name in a table: without the module, unless another is called the same."""
    short = name.rpartition(":")[2]
    return short if sum(one.rpartition(":")[2] == short for one in among) == 1 else name


def fly_case(case: Case, seed: int, duration_s: float) -> ComparedFlight:
    """Fly one case once."""
    world, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
    result = fly(world, config, seed=seed, duration_s=duration_s)
    return ComparedFlight(case, seed, result.completed, result.verdict)


def fly_all(
    work: Sequence[Case],
    seeds: int,
    duration_s: float,
    flyers: Flyers,
    on_done: Callable[[int], None] = lambda done: None,
) -> list[ComparedFlight]:
    """Fly each case with seeds 0 … ``seeds`` - 1; return the flights in the order of ``work``.

    ``on_done`` gets the number of flights so far.
    """
    flights = [partial(fly_case, case, seed, duration_s) for case in work for seed in range(seeds)]
    return flyers.each(run_beside, flights, on_done)


def _can_be_imported(name: str, thing: object) -> bool:
    """Whether another process finds ``thing`` under its name."""
    module, _, attribute = name.partition(":")
    return module != "__main__" and getattr(sys.modules.get(module), attribute, None) is thing


def rows(results: Sequence[ComparedFlight]) -> list[ComparisonRow]:
    """Return one row a case, in the order of their first flights."""
    by_place: dict[tuple[str, str], list[ComparedFlight]] = {}
    for one in results:
        by_place.setdefault((one.case.scenario, one.case.controller), []).append(one)
    return [_row(flights[0].case, flights) for flights in by_place.values()]


def worst_of_variants(flights: Sequence[tuple[int, float | None]]) -> float | None:
    """Return the largest of the medians of the variants, from pairs (variant, value).

    None where one of them is None.
    """
    by_variant: dict[int, list[float]] = {}
    for variant, value in flights:
        by_variant.setdefault(variant, []).append(math.inf if value is None else value)
    worst = max(median(values) for values in by_variant.values())
    return worst if math.isfinite(worst) else None


def _row(case: Case, flights: list[ComparedFlight]) -> ComparisonRow:
    crashed = sum(not one.survived for one in flights)
    verdicts = [one.verdict for one in flights]
    errors = [one.rms_cm for one in verdicts]
    known = [error for error in errors if error is not None] if not crashed else []
    # A flight that never settles counts as later than any.
    settled = median([math.inf if one.settle_s is None else one.settle_s for one in verdicts])
    nothing: tuple[float | None, float | None] = (None, None)
    pushed = [
        (one.verdict.gust_peak_cm, one.verdict.gust_back_s) if one.survived else nothing
        for one in flights
    ]
    variants = [one.case.variant for one in flights]
    return ComparisonRow(
        case.scenario,
        case.controller,
        flights=len(flights),
        survived=crashed == 0,
        crashed=crashed,
        rms_cm=_middle(errors, crashed),
        rms_cm_min=min(known, default=None),
        rms_cm_max=max(known, default=None),
        max_cm=_middle([one.max_cm for one in verdicts], crashed),
        settle_s=settled if not crashed and math.isfinite(settled) else None,
        effort_rad_s=_middle([one.effort_rad_s for one in verdicts], crashed),
        peak_cm=worst_of_variants(
            [(variant, peak) for variant, (peak, _) in zip(variants, pushed, strict=True)]
        ),
        back_s=worst_of_variants(
            [(variant, back) for variant, (_, back) in zip(variants, pushed, strict=True)]
        ),
    )


def _middle(values: list[float | None], crashed: int) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known and not crashed else None


NOTE = (
    "The error is the true one, from 15 s on. The baselines fly on our estimate and send commands "
    "as published, without inverting\nthe actuators' lags."
)
HEAD = (
    "scenario", "controller", "RMS cm", "spread", "max cm", "settled s", "effort", "peak cm",
    "back s", "survived",
)  # fmt: skip


def text_table(rows: Sequence[ComparisonRow]) -> str:
    """Return the table with columns aligned for a terminal."""
    lines = [HEAD, *map(_cells, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    shown: list[str] = []
    last = rows[0].scenario if rows else ""
    for line in lines:
        if line is not HEAD and line[0] != last:
            shown.append("")
            last = line[0]
        cells = [
            cell.ljust(w) if i < 2 else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        ]
        shown.append("  ".join(cells).rstrip())
    note = (
        "medians over the seeds; errors are true ones, from 15 s on; settled: the error stays "
        "below 10 cm"
    )
    pushed = (
        "peak, back: after the wind's step or push, until the error stays below 5 cm; the worst "
        "direction"
    )
    return "\n".join(
        [
            *shown,
            "",
            note,
            pushed,
            "effort: RMS of the commanded roll and pitch rates less their low-pass of 0.15 s "
            "[rad/s]",
        ]
    )


def markdown_table(rows: Sequence[ComparisonRow]) -> str:
    """Return one row a scenario, one column a controller: RMS error, and spread over the seeds."""
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    controllers = list(dict.fromkeys(row.controller for row in rows))
    by_place = {(row.scenario, row.controller): row for row in rows}
    lines = [f"| RMS error, cm | {' | '.join(controllers)} |", f"|---|{'---:|' * len(controllers)}"]
    for scenario in scenarios:
        cells = [_rms(by_place.get((scenario, controller))) for controller in controllers]
        peak = ", peak after it" if SCENARIOS[scenario].variants else ""
        lines.append(f"| `{scenario}`{peak} | {' | '.join(cells)} |")
    return "\n".join(lines)


def write_between_markers(path: Path, rows: Sequence[ComparisonRow], command: str) -> None:
    """Replace what stands between the markers of ``path`` by the table and by the ``command`` that
    made it.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    flights = max((row.flights for row in rows), default=0)
    what = f"Medians over {flights} flights each" if flights > 1 else "One flight each"
    spread = ", smallest and largest in brackets" if flights > 1 else ""
    made = f"{what}{spread}; made by `{command}`.\n{NOTE}"
    replace_between_markers(path, f"{markdown_table(rows)}\n\n{made}")


def _cells(row: ComparisonRow) -> tuple[str, ...]:
    spread = "" if row.rms_cm_min is None else f"{row.rms_cm_min:.2f} … {row.rms_cm_max:.2f}"
    survived = "yes" if row.survived else f"{row.flights - row.crashed} of {row.flights}"
    settled = "never" if row.survived and row.settle_s is None else _number(row.settle_s, 1)
    return (
        row.scenario,
        row.controller,
        _number(row.rms_cm, 2),
        spread,
        _number(row.max_cm, 2),
        settled,
        _number(row.effort_rad_s, 2),
        _number(row.peak_cm, 1),
        _number(row.back_s, 2),
        survived,
    )


def _number(value: float | None, places: int) -> str:
    return "-" if value is None else f"{value:.{places}f}"


def _rms(row: ComparisonRow | None) -> str:
    if row is None:
        return ""
    if row.rms_cm is None:
        return f"{row.crashed} of {row.flights} crashed"
    if SCENARIOS[row.scenario].variants:
        back = "never back" if row.back_s is None else f"{row.back_s:.2f} s"
        return f"{_number(row.peak_cm, 1)} ({back})"
    spread = f" ({row.rms_cm_min:.2f}–{row.rms_cm_max:.2f})" if row.flights > 1 else ""
    return f"{row.rms_cm:.2f}{spread}"
