"""Comparison: controllers side by side in the same scenarios, with the same seeds, estimator and wire bytes.

Several processes fly it. Its table is for people, and for documents, between the markers that they hold for it.

A comparison as a picture: RMS error by scenario, and the error through the gust front over time.
"""

import concurrent.futures as cf  # noqa: TID251  # processes, not threads, and none of them around an event loop
import math
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.analysis.report import figure_class
from groundstation.config import ConfigError, lend
from groundstation.core import Tick
from groundstation.core.control import make_controller
from groundstation.core.messages import STEADY_S
from groundstation.runtime import replace_between_markers, require_package, split_at_markers
from sim.runs import TrueTrack, Workers, fly, lend_name, run_beside
from sim.scenarios import SCENARIOS, prepare

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

CONTROLLERS = ("adaptive", "uncompensated", "geometric", "l1", "pid", "indi")
WITHOUT_ADAPTATION = "adaptive, kb=0"
"""Flown beside ``adaptive`` through the gust front: what adaptation buys."""
GUST = "gust_front"
TRACE_S = 0.05
"""One point of a trace is the largest error of so long [s]."""


class ControllerComparison:
    """Controllers side by side: ``rows`` for each in each scenario, and the ``flights`` that they sum up."""

    def __init__(self, flights: "Sequence[ComparedFlight]") -> None:
        self.flights = tuple(flights)
        self.rows = tuple(rows(flights))

    def __str__(self) -> str:
        """The table, as a terminal shows it."""
        return text_table(self.rows)

    def to_pandas(self) -> "DataFrame":
        """The rows as a table, by scenario and controller.

        Raises:
            ConfigError: pandas is not installed.
        """
        require_package("pandas", "to_pandas", "notebook")
        from pandas import DataFrame

        return DataFrame(msgspec.to_builtins(self.rows)).set_index(["scenario", "controller"])

    def plot(self) -> "Figure":
        """RMS error by scenario, and the error through the gust front over time where that was flown and traced.

        Raises:
            ConfigError: matplotlib is not installed.
        """
        require_package("matplotlib", "plot", "notebook")
        return draw(self.rows, self.flights)


def compare(
    controllers: Sequence[object] = CONTROLLERS,
    *,
    scenarios: Iterable[str] | None = None,
    seeds: int = 1,
    duration: float = 60.0,
    overrides: Sequence[str] = (),
    workers: int = 1,
    traced: bool = True,
    on_done: Callable[[int, int], None] | None = None,
) -> ControllerComparison:
    """Fly controllers through the same scenarios with the same seeds: what ``groundstation-sim compare`` does.

    Args:
        controllers: names, or your own, as :func:`sim.runs.simulation.simulate` takes one.
        scenarios: their names; without them, all there are.
        seeds: each flies with seeds 0 to ``seeds`` - 1.
        duration: of each flight [s], longer than 16.
        overrides: ``"key=value"`` each, for all, as ``--set``.
        workers: how many processes fly. More than one wants ``if __name__ == "__main__":`` around a script; a
            controller that they could not import, as one written in a notebook, is flown in this one.
        traced: keep the error over time of the first flight through the gust front, to draw it.
        on_done: hears how many of how many flights are flown.

    Raises:
        ConfigError: an unknown name or key, a bad value, or a flight that the vehicle can't fly.
        UserCodeFault: a controller of your own failed in flight; its cause shows where.
    """
    if duration <= STEADY_S + 1.0:
        raise ConfigError(
            "--duration", f"expected more than {STEADY_S + 1:g} s, as figures are taken from {STEADY_S:g} s"
        )
    places = list(SCENARIOS if scenarios is None else scenarios)
    for place in places:
        if place not in SCENARIOS:
            raise ConfigError("--scenarios", f"expected some of {sorted(SCENARIOS)}, got {place!r}")
    own: dict[str, object] = {}
    names = [str(lend_name(controller, own)) for controller in controllers]
    work = cases(places, names, overrides)
    with lend(own):
        for case in work:  # what can't fly says so before anything flies
            _, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
            make_controller(config.controller, config.vehicle)
        if on_done is not None:
            on_done(0, len(work) * seeds)
        return ControllerComparison(
            fly_all(work, seeds, duration, workers=workers, own=own, traced=traced, on_done=on_done)
        )


class Case(msgspec.Struct, frozen=True):
    """One controller in one scenario."""

    scenario: str
    controller: str
    """As the table names it."""
    overrides: tuple[str, ...]
    """``--set`` overrides that choose it."""
    kind: str = ""
    """The controller's kind."""


class ComparedFlight(msgspec.Struct, frozen=True):
    """One flight of a case."""

    case: Case
    seed: int
    survived: bool
    rms_cm: float | None
    max_cm: float | None
    settle_s: float | None
    effort_rad_s: float | None
    trace: list[float] | None
    """True error [cm] from the start on, every :data:`TRACE_S`; only where asked for."""


class ComparisonRow(msgspec.Struct, frozen=True):
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
    effort_rad_s: float | None
    """How hard the vehicle is worked: see :class:`sim.runs.FlightVerdict`."""


def cases(scenarios: Iterable[str], controllers: Sequence[str], overrides: Sequence[str] = ()) -> list[Case]:
    """Every controller in every scenario, and ours without adaptation in the gust front; ``overrides`` hold for all."""
    found: list[Case] = []
    for scenario in scenarios:
        for name in controllers:
            found.append(Case(scenario, _short_name(name, controllers), (*overrides, f"controller.kind={name}"), name))
            if scenario == GUST and name == "adaptive":
                off = ("controller.kb=0.0", "controller.composite=off")
                found.append(Case(scenario, WITHOUT_ADAPTATION, (*overrides, *off), name))
    return found


def _short_name(name: str, among: Sequence[str]) -> str:
    """As a table names it: without the module, where no other is called so."""
    short = name.rpartition(":")[2]
    return short if sum(one.rpartition(":")[2] == short for one in among) == 1 else name


def fly_case(case: Case, seed: int, duration_s: float, *, traced: bool = False) -> ComparedFlight:
    """Fly one case once."""
    world, config = prepare(SCENARIOS[case.scenario], list(case.overrides))
    track, start = TrueTrack(), math.inf

    def on_tick(tick: Tick) -> None:
        nonlocal start
        start = tick.estimate.time_s - tick.flight_time_s

    result = fly(
        world, config, seed=seed, duration_s=duration_s, on_tick=on_tick, on_step=track.step if traced else None
    )
    verdict = result.verdict
    trace = None
    if traced:
        errors = track.errors(config.trajectory.build(), start)
        trace = [0.0] * (int(duration_s / TRACE_S) + 1)
        for time_s, error in zip(track.times, errors, strict=True):
            index = int((time_s - start) / TRACE_S)
            if 0 <= index < len(trace):
                trace[index] = max(trace[index], 100.0 * error)
        trace = trace[: int(result.duration_s / TRACE_S)]
    return ComparedFlight(
        case,
        seed,
        result.completed,
        verdict.rms_cm,
        verdict.max_cm,
        verdict.settle_s,
        verdict.effort_rad_s,
        trace,
    )


def fly_all(
    work: Sequence[Case],
    seeds: int,
    duration_s: float,
    *,
    workers: int = 1,
    own: Mapping[str, object] | None = None,
    traced: bool = False,
    on_done: Callable[[int, int], None] | None = None,
) -> list[ComparedFlight]:
    """Every case with seeds 0 … ``seeds`` - 1, in the order of ``work``; ``on_done`` hears how many are flown.

    Only the first seed of the gust front is traced. What no other process could import of ``own``, and everything where
    there is but one worker, is flown in this process.
    """
    here = {name for name, thing in (own or {}).items() if not _can_be_imported(name, thing)}
    flights = [
        partial(fly_case, case, seed, duration_s, traced=traced and seed == 0 and case.scenario == GUST)
        for case in work
        for seed in range(seeds)
    ]
    homely = [workers == 1 or one.args[0].kind in here for one in flights]
    flown: dict[int, ComparedFlight] = {}

    def note(index: int, flight: ComparedFlight) -> None:
        flown[index] = flight
        if on_done is not None:
            on_done(len(flown), len(flights))

    with ExitStack() as stack:
        futures: dict[cf.Future[ComparedFlight], int] = {}
        if not all(homely):
            pool = stack.enter_context(Workers(workers))
            futures = {pool.submit(one): i for i, one in enumerate(flights) if not homely[i]}
        for i, one in enumerate(flights):
            if homely[i]:
                note(i, run_beside(one))
        for future in cf.as_completed(futures):
            note(futures[future], future.result())
    return [flown[i] for i in range(len(flights))]


def _can_be_imported(name: str, thing: object) -> bool:
    """Whether another process finds ``thing`` under its name."""
    module, _, attribute = name.partition(":")
    return module != "__main__" and getattr(sys.modules.get(module), attribute, None) is thing


def rows(results: Sequence[ComparedFlight]) -> list[ComparisonRow]:
    """One row a case, in the order of their first flights."""
    by_case: dict[Case, list[ComparedFlight]] = {}
    for one in results:
        by_case.setdefault(one.case, []).append(one)
    return [_row(case, flights) for case, flights in by_case.items()]


def _row(case: Case, flights: list[ComparedFlight]) -> ComparisonRow:
    crashed = sum(not one.survived for one in flights)
    errors = [one.rms_cm for one in flights]
    known = [error for error in errors if error is not None] if not crashed else []
    # A flight that never settles counts as later than any.
    settled = median([math.inf if one.settle_s is None else one.settle_s for one in flights])
    return ComparisonRow(
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
        effort_rad_s=_middle([one.effort_rad_s for one in flights], crashed),
    )


def _middle(values: list[float | None], crashed: int) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known and not crashed else None


BEGIN, END = "<!-- figures:begin -->", "<!-- figures:end -->"
NOTE = (
    "The error is the true one, from 15 s on. The baselines fly on our estimate and send commands as published, "
    "without inverting\nthe actuators' lags; `docs/decisions/0006-baselines.md` has both."
)
HEAD = ("scenario", "controller", "RMS cm", "spread", "max cm", "settled s", "effort", "survived")


def text_table(rows: Sequence[ComparisonRow]) -> str:
    """Columns aligned for a terminal."""
    lines = [HEAD, *map(_cells, rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(HEAD))]
    shown: list[str] = []
    last = rows[0].scenario if rows else ""
    for line in lines:
        if line is not HEAD and line[0] != last:
            shown.append("")
            last = line[0]
        cells = [
            cell.ljust(w) if i < 2 else cell.rjust(w) for i, (cell, w) in enumerate(zip(line, widths, strict=True))
        ]
        shown.append("  ".join(cells).rstrip())
    note = "medians over the seeds; errors are true ones, from 15 s on; settled: the error stays below 10 cm"
    return "\n".join(
        [*shown, "", note, "effort: RMS of the commanded roll and pitch rates less their low-pass of 0.15 s [rad/s]"]
    )


def markdown_table(rows: Sequence[ComparisonRow]) -> str:
    """One row a scenario, one column a controller: RMS error, and its spread over the seeds."""
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    controllers = list(dict.fromkeys(row.controller for row in rows))
    by_place = {(row.scenario, row.controller): row for row in rows}
    lines = [f"| RMS error, cm | {' | '.join(controllers)} |", f"|---|{'---:|' * len(controllers)}"]
    for scenario in scenarios:
        cells = [_rms(by_place.get((scenario, controller))) for controller in controllers]
        lines.append(f"| `{scenario}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def check_markers(path: Path) -> None:
    """Look for the markers in ``path``, before any work is done.

    Raises:
        ConfigError: it can't be read, or has not just one pair of them.
    """
    split_at_markers(path, BEGIN, END)


def write_between_markers(path: Path, rows: Sequence[ComparisonRow], command: str) -> None:
    """Replace what stands between the markers of ``path`` by the table and by the ``command`` that made it.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    flights = max((row.flights for row in rows), default=0)
    what = f"Medians over {flights} flights each" if flights > 1 else "One flight each"
    spread = ", smallest and largest in brackets" if flights > 1 else ""
    made = f"{what}{spread}; made by `{command}`.\n{NOTE}"
    put_between_markers(path, f"{markdown_table(rows)}\n\n{made}")


def put_between_markers(path: Path, shown: str) -> None:
    """Replace what stands between the markers of ``path`` by ``shown``.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    replace_between_markers(path, BEGIN, END, shown)


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
        survived,
    )


def _number(value: float | None, places: int) -> str:
    return "-" if value is None else f"{value:.{places}f}"


def _rms(row: ComparisonRow | None) -> str:
    if row is None:
        return ""
    if row.rms_cm is None:
        return f"{row.crashed} of {row.flights} crashed"
    spread = f" ({row.rms_cm_min:.2f}–{row.rms_cm_max:.2f})" if row.flights > 1 else ""
    return f"{row.rms_cm:.2f}{spread}"


# M. Okabe, K. Ito: a palette that the colour-blind can tell apart; markers and dashes differ too.
STYLES: dict[str, dict[str, Any]] = {
    "adaptive": {"color": "#0072B2", "marker": "o"},
    WITHOUT_ADAPTATION: {"color": "#0072B2", "marker": "*", "linestyle": ":", "markerfacecolor": "white"},
    "uncompensated": {"color": "#000000", "marker": "x", "linestyle": (0, (1, 1))},
    "geometric": {"color": "#E69F00", "marker": "s", "linestyle": "--"},
    "l1": {"color": "#D55E00", "marker": "v", "linestyle": (0, (3, 1))},
    "pid": {"color": "#CC79A7", "marker": "^", "linestyle": "-."},
    "indi": {"color": "#009E73", "marker": "D", "linestyle": (0, (5, 1, 1, 1, 1, 1))},
}
OTHERS: tuple[dict[str, Any], ...] = (
    {"color": "#56B4E9", "marker": "P", "linestyle": "--"},
    {"color": "#8C6D1F", "marker": "h", "linestyle": "-."},
)
SHOWN_S = (25.0, 45.0)
"""What the gust's panel shows of the flight [s]."""


def check_plot(path: Path) -> None:
    """That a picture can be drawn into ``path``: before minutes of flying, not after.

    Raises:
        ConfigError: matplotlib is not installed, the folder is not there, or it is no kind of picture.
    """
    require_package("matplotlib", "--plot", "plot")
    from matplotlib.figure import Figure

    if not path.absolute().parent.is_dir():
        raise ConfigError("--plot", f"cannot write {path}: there is no such folder")
    if path.is_dir():
        raise ConfigError("--plot", f"cannot write {path}: it is a folder")
    kinds = Figure().canvas.get_supported_filetypes()
    if path.suffix and path.suffix[1:].lower() not in kinds:
        raise ConfigError("--plot", f"cannot write {path}: expected a name that ends in one of {sorted(kinds)}")


def plot(path: Path, rows: Sequence[ComparisonRow], flights: Sequence[ComparedFlight]) -> None:
    """Draw ``rows``, and the traced ones of ``flights``, into ``path`` (.png, .svg or .pdf).

    Raises:
        ConfigError: the file can't be written.
    """
    try:
        draw(rows, flights).savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise ConfigError("--plot", f"cannot write {path}: {error}") from None


def draw(rows: Sequence[ComparisonRow], flights: Sequence[ComparedFlight]) -> "Figure":
    """The picture of ``rows``, and of the traced ones of ``flights``."""
    traced = [one for one in flights if one.trace]
    names = list(dict.fromkeys(row.controller for row in rows))
    free = iter(OTHERS * len(names))
    styles = {name: STYLES.get(name) or next(free) for name in names}
    figure = figure_class()(figsize=(9.5, 8.2 if traced else 4.6), layout="constrained")
    panels = figure.subplots(2 if traced else 1, 1, squeeze=False)[:, 0]
    _by_scenario(panels[0], rows, styles)
    if traced:
        _over_time(panels[1], traced, styles)
    return figure


def _by_scenario(panel: Any, rows: Sequence[ComparisonRow], styles: dict[str, dict[str, Any]]) -> None:
    scenarios = list(dict.fromkeys(row.scenario for row in rows))
    highest = max((row.rms_cm_max for row in rows if row.rms_cm_max is not None), default=1.0)
    crash = 3.0 * highest
    for k, (name, style) in enumerate(styles.items()):
        offset = 0.7 * ((k + 0.5) / len(styles) - 0.5)
        mine = [row for row in rows if row.controller == name]
        look = {
            "linestyle": "none",
            "markersize": 7,
            "capsize": 3,
            **{k: v for k, v in style.items() if k != "linestyle"},
        }
        places = [(scenarios.index(row.scenario) + offset, row) for row in mine if row.rms_cm is not None]
        # 5 µm are zero for every purpose, and zero has no place on this axis.
        low = [max(row.rms_cm or 0.0, 5e-4) for _, row in places]
        below = [value - max(row.rms_cm_min or 0.0, 5e-4) for value, (_, row) in zip(low, places, strict=True)]
        above = [max(row.rms_cm_max or 0.0, 5e-4) - value for value, (_, row) in zip(low, places, strict=True)]
        panel.errorbar([x for x, _ in places], low, yerr=[below, above], label=name, **look)
        for row in mine:
            if row.rms_cm is None:
                where = scenarios.index(row.scenario) + offset
                panel.annotate(
                    "crash", (where, crash), rotation=90, ha="center", va="top", fontsize=7, color=style["color"]
                )
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.set_xticks(range(len(scenarios)), scenarios)
    panel.set_xlim(-0.5, len(scenarios) - 0.5)
    for edge in range(1, len(scenarios)):
        panel.axvline(edge - 0.5, color="0.85", linewidth=0.8)
    panel.set_ylabel("RMS position error [cm]")
    seeds = max(row.flights for row in rows)
    of_them = f"median, smallest and largest of {seeds} flights" if seeds > 1 else "one flight each"
    panel.set_title(f"Position error from {STEADY_S:g} s on: {of_them}", fontsize=11)
    panel.grid(axis="y", which="major", color="0.85", linewidth=0.8)
    panel.legend(ncols=3, fontsize=9, loc="upper left", bbox_to_anchor=(0.0, -0.1), frameon=False)


def _over_time(panel: Any, traced: Sequence[ComparedFlight], styles: dict[str, dict[str, Any]]) -> None:
    for one in traced:
        trace = one.trace or []
        style = {key: value for key, value in styles[one.case.controller].items() if key in ("color", "linestyle")}
        width = 2.2 if one.case.controller == "adaptive" else 1.5
        times = [TRACE_S * i for i in range(len(trace))]
        panel.plot(times, [max(value, 1e-3) for value in trace], label=one.case.controller, linewidth=width, **style)
    when = SCENARIOS[GUST].world.wind_step_time_s
    north = SCENARIOS[GUST].world.wind_step[0]
    panel.axvline(when, color="0.4", linewidth=0.8)
    panel.annotate(f" the wind steps by {north:g} m/s²", (when, 0.02), xycoords=("data", "axes fraction"), fontsize=9)
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    end = max(TRACE_S * len(one.trace or []) for one in traced)
    if end > SHOWN_S[0]:
        panel.set_xlim(SHOWN_S[0], min(SHOWN_S[1], end))
    panel.set_xlabel("time since release [s]")
    panel.set_ylabel("position error [cm]")
    panel.set_title(f"{GUST}, seed 0: error over time", fontsize=11)
    panel.grid(axis="y", which="major", color="0.85", linewidth=0.8)
    panel.legend(ncols=6, fontsize=9, loc="upper left", bbox_to_anchor=(0.0, -0.14), frameon=False)
