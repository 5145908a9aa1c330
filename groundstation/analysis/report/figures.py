"""Figures of a report: one PNG each; of several flights, positions and errors are overlaid.

First those of control, the paper's 3 to 6 and the Lyapunov function with its certificate; then
those of the flight as a whole: path, error, latency, lateness.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from io import BytesIO
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from groundstation.analysis.report.flight import (
    Column,
    FlightColumns,
    drop_unknown,
    floor_z_m,
    latency,
    limits,
    numbers,
)
from groundstation.config import ConfigError
from groundstation.core.messages import PAPER, STEADY_S, begin_of_steady_part, notice

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# M. Okabe, K. Ito: a palette that the colour-blind can tell apart; dashes differ too, for print
# without colour.
BLUE, ORANGE, GREEN, RED, GREY, PURPLE = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#555555",
    "#CC79A7",
)
AXES = (("north", BLUE, "-"), ("east", ORANGE, "--"), ("down", GREEN, "-."))
TIME = "time [s]"


def position(panels: Sequence[Any], flown: FlightColumns) -> None:
    """Estimated position, that of a simulated flight's truth, and reference, world NED.

    The paper's figure 3.
    """
    for i, (panel, (name, _, _)) in enumerate(zip(panels, AXES, strict=True)):
        for key, look, label in _curves(flown):
            panel.plot(flown.t, flown.vectors[key][:, i], label=label, **look)
        panel.set_ylabel(f"{name} [m]")
        _at_least(panel, 0.1)
    finish_panels(panels)


def _curves(flown: FlightColumns) -> list[tuple[str, dict[str, Any], str]]:
    """Reference, estimate and, where it is known, truth: each narrower than the one below, so that
    all stay visible.

    They lie millimetres apart, and lap upon lap, where dashes would close to a line. Colours as in
    the viewers.
    """
    from matplotlib import rcParams

    width = rcParams["lines.linewidth"]
    reference = (
        "reference_ned",
        {"color": "0.75", "linewidth": 4.4 * width, "solid_capstyle": "butt"},
        "reference",
    )
    estimate = ("position_ned", {"color": BLUE, "linewidth": 2.4 * width}, "estimate")
    truth = ("true_position_ned", {"color": ORANGE, "linewidth": 0.9 * width}, "truth")
    return [reference, estimate, truth] if flown.knows_truth else [reference, estimate]


def disturbance(panels: Sequence[Any], flown: FlightColumns) -> None:
    """Adaptive estimate b̂ and the observer's d̂ in time, with the true wind where known.

    The paper's figure 4.

    b̂ and d̂ differ from the wind by what thrust scale, mass and drag are off.
    """
    # They lie upon each other, so each is narrower than the one below, or dashed.
    curves: list[tuple[str, str, dict[str, Any]]] = [
        ("d_hat_m_s2", "d̂ (observer)", {"color": "0.72", "linewidth": 2.6}),
        ("b_hat_m_s2", "b̂", {"color": BLUE, "linewidth": 0.8}),
    ]
    if flown.knows_truth:
        dashes = {"color": "black", "linewidth": 1.5, "linestyle": (0, (6, 3))}
        curves.append(("true_wind_m_s2", "true wind", dashes))
    for i, (panel, (name, _, _)) in enumerate(zip(panels, AXES, strict=True)):
        for key, label, look in curves:
            panel.plot(flown.t, flown.vectors[key][:, i], label=label, **look)
        panel.set_ylabel(f"{name} [m/s²]")
        _at_least(panel, 0.1)
    finish_panels(panels)


def actuation(panels: Sequence[Any], flown: FlightColumns) -> None:
    """Commanded thrust and body rates, with the vehicle's limits; the paper's figure 5."""
    bounds = limits(flown)
    columns: tuple[tuple[str, str, str, Column], ...] = (
        ("thrust", "N", "black", flown.scalars["thrust_n"]),
        ("roll", "rad/s", BLUE, flown.vectors["rates_rad_s"][:, 0]),
        ("pitch", "rad/s", ORANGE, flown.vectors["rates_rad_s"][:, 1]),
        ("yaw", "rad/s", GREEN, flown.vectors["rates_rad_s"][:, 2]),
    )
    clamped = flown.scalars["saturated"] > 0.0
    for panel, (name, unit, colour, values) in zip(panels, columns, strict=True):
        panel.plot(flown.t, values, color=colour, linewidth=0.9)
        for k, bound in enumerate(bounds.get(name, ())):
            panel.axhline(
                bound, color=RED, linestyle=(0, (4, 3)), linewidth=0.9, label=None if k else "limit"
            )
        if clamped.any():
            label = "a limit was met (any of the four)"
            panel.plot(flown.t[clamped], values[clamped], "x", color=RED, markersize=4, label=label)
        panel.set_ylabel(f"{name}{'' if name == 'thrust' else ' rate'} [{unit}]")
    finish_panels(panels)


def backstepping(panels: Sequence[Any], flown: FlightColumns) -> None:
    """z1 (position), z2 (speed) and z3 (acceleration) in time; the paper's figure 6.

    Scales are linear near zero, and logarithmic beyond where the start would dwarf the rest.
    """
    for panel, (key, name) in zip(
        panels, (("z1_m", "z1 [m]"), ("z2_m_s", "z2 [m/s]"), ("z3_m_s2", "z3 [m/s²]")), strict=True
    ):
        values = flown.vectors[key]
        for i, (axis, colour, dash) in enumerate(AXES):
            panel.plot(flown.t, values[:, i], dash, color=colour, linewidth=1.0, label=axis)
        panel.set_ylabel(name)
        _linear_near_zero(panel, values)
    finish_panels(panels, columns=3)


def lyapunov(panels: Sequence[Any], flown: FlightColumns) -> None:
    """V without its unknown b̃ term, its excess above the bound that the theory gives it, and what
    the watch said.
    """
    over, excess, word = panels
    for key, label, colour, dash in (
        ("v_sigma", "position term", BLUE, "--"),
        ("v_omega", "speed term", ORANGE, "-."),
        ("v_z3", "acceleration term", GREEN, ":"),
        ("v", "V", "black", "-"),
    ):
        over.plot(
            flown.t,
            flown.scalars[key],
            dash,
            color=colour,
            linewidth=1.0,
            label=label,
        )
    if not np.nanmax(flown.scalars["v"], initial=0.0) > 0.0:
        _say_instead(over, "this controller has no Lyapunov function")
    over.set_yscale("log")
    over.set_ylabel("V and its terms\n[m²/s²]")
    excess.plot(flown.t, flown.scalars["excess"], color=RED)
    excess.set_ylabel("V above its\nbound [m²/s²]")
    names = ("holds", "suspended", "violated", "none")
    for row, (name, colour) in enumerate(zip(names, (GREEN, ORANGE, RED, GREY), strict=True)):
        at = np.array([state == name for state in flown.certificates])
        share = 100.0 * float(at.mean())
        word.plot(flown.t[at], np.full(int(at.sum()), row), "|", color=colour, markersize=11)
        word.annotate(
            f"{share:.2f} %",
            (1.01, row),
            xycoords=("axes fraction", "data"),
            va="center",
            fontsize="small",
        )
    word.set_yticks(range(4), names)
    word.set_ylim(3.6, -0.6)
    word.set_ylabel("certificate")
    finish_panels(panels, columns=4)


def finish_panels(panels: Sequence[Any], columns: int = 3, below: str = TIME) -> None:
    """The legend above the first panel, where no curve is.

    What the horizontal axis is ``below`` the last.
    """
    _legend_above(panels[0], columns)
    panels[-1].set_xlabel(below)
    for panel in panels:
        panel.margins(x=0.01)


def _legend_above(panel: Any, columns: int) -> None:
    """The legend above a panel; in a column of a journal two entries a line at most."""
    if panel.get_legend_handles_labels()[0]:
        columns = min(columns, 2) if panel.figure.get_figwidth() <= COLUMN_IN else columns
        panel.legend(ncols=columns, loc="lower right", bbox_to_anchor=(1.0, 0.98))


def _at_least(panel: Any, span: float) -> None:
    """A millimetre must not fill the panel: show ``span`` at least, in the unit of the axis."""
    low, high = panel.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        panel.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def _format_tick(value: float, _: int) -> str:
    """A number with the minus sign that matplotlib's own labels have."""
    return f"{value:g}".replace("-", "\u2212")


def _linear_near_zero(panel: Any, values: Column) -> None:
    """Linear up to what 95 % of the flight keeps to, logarithmic above, where the start would dwarf
    the rest.
    """
    known = np.abs(drop_unknown(values))
    usual = float(np.percentile(known, 95)) if len(known) else 0.0
    if usual > 0.0 and known.max() > 10.0 * usual:
        threshold = 10.0 ** np.ceil(np.log10(usual))
        panel.set_yscale("symlog", linthresh=threshold, linscale=2.0)
        # More would write one number over the other.
        panel.yaxis.get_major_locator().set_params(numticks=4)
        panel.yaxis.set_major_formatter(_format_tick)


def path(panels: Sequence[Any], flown: FlightColumns) -> None:
    """Estimated path, that of a simulated flight's truth, and reference in space.

    Heights count from the floor.
    """
    (panel,) = panels
    floor = floor_z_m(flown)
    for key, look, name in _curves(flown):
        p = flown.vectors[key]
        panel.plot(p[:, 1], p[:, 0], floor - p[:, 2], label=name, **look)
    both = np.concatenate([flown.vectors["position_ned"], flown.vectors["reference_ned"]])
    spans = np.ptp(both, axis=0)
    spans = np.maximum(spans, max(0.2, 0.4 * float(spans.max())))
    for i, (axis, sign, zero) in enumerate((("y", 1.0, 0.0), ("x", 1.0, 0.0), ("z", -1.0, floor))):
        middle = zero + sign * 0.5 * (both[:, i].min() + both[:, i].max())
        getattr(panel, f"set_{axis}lim")(middle - 0.53 * spans[i], middle + 0.53 * spans[i])
    panel.set_box_aspect((spans[1], spans[0], spans[2]), zoom=0.8)  # with room for "height [m]"
    panel.set_xlabel("east [m]")
    panel.set_ylabel("north [m]")
    panel.set_zlabel("height [m]")
    panel.locator_params(nbins=5)
    panel.legend(loc="upper left")


def error(panels: Sequence[Any], flown: FlightColumns) -> None:
    """Distance from the reference in time, and how often it was how large over the steady part (by
    truth, if known).
    """
    over, shares = panels
    _error_in_time(over, flown)
    _error_shares(shares, flown)


def _error_in_time(panel: Any, flown: FlightColumns) -> None:
    """Errors against estimate and truth, with the paper's figures where its flight is shown."""
    curves = [("error_m", BLUE, 0.9, "estimate")]
    if flown.knows_truth:
        curves.append(("true_error_m", ORANGE, 0.7, "truth"))
    for key, colour, width, name in curves:
        cm = 100.0 * flown.scalars[key]
        panel.plot(flown.t, cm, color=colour, linewidth=width, label=f"against the {name}")
    if flown.is_papers:
        for key, colour, dash, width, name in (
            ("rms_cm", GREY, "--", 1.0, "RMS"),
            ("max_cm", RED, ":", 1.2, "largest"),
        ):
            label = f"the paper's {name}, {PAPER[key]:g} cm"
            panel.axhline(PAPER[key], color=colour, linestyle=dash, linewidth=width, label=label)
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(_format_tick)
    panel.set_xlabel(TIME)
    panel.set_ylabel("position error [cm]")
    panel.margins(x=0.01)
    _legend_above(panel, 2)


def _error_shares(panel: Any, flown: FlightColumns) -> None:
    """Histogram of the steady part's errors, with the figures of the table."""
    against = "truth" if flown.knows_truth else "estimate"
    key = "true_error" if flown.knows_truth else "error"
    t = flown.scalars["flight_time_s"]
    is_steady = flown.tracking & (t >= begin_of_steady_part(t[flown.tracking].max(initial=0.0)))
    steady = drop_unknown(100.0 * flown.scalars[f"{key}_m"][is_steady])
    panel.set_xlabel(f"error against the {against}, from {STEADY_S:g} s on [cm]")
    panel.set_ylabel("share of commands [%]")
    if not len(steady):
        _say_instead(panel, "the flight ended before it was steady")
        return
    colour = ORANGE if flown.knows_truth else BLUE
    weights = np.full(len(steady), 100.0 / len(steady))
    panel.hist(steady, bins=50, weights=weights, color=colour, alpha=0.75)
    told = numbers(flown)[key]
    for value, name, dash in (
        (told["rms_cm"], "RMS", "-"),
        (float(np.percentile(steady, 99)), "99 %", "--"),
        (told["max_cm"], "largest", ":"),
    ):
        if value is not None:  # a recording that was cut off has no figures of the truth
            label = f"{name} {value:.2f} cm"
            panel.axvline(value, color="black", linestyle=dash, linewidth=1.1, label=label)
    _legend_above(panel, 3)


def _say_instead(panel: Any, text: str) -> None:
    """Write ``text`` into the middle of a panel that has nothing to show."""
    panel.annotate(text, (0.5, 0.5), xycoords="axes fraction", ha="center")


def latency_budget(panels: Sequence[Any], flown: FlightColumns) -> None:
    """Latency from a pose to the vehicle.

    Transport: from a pose's instant to its arrival. Pose age: from that to the command, waiting
    included. Compute: from the command's instant until its bytes left. Link: half a round trip.
    """
    bars, over = panels
    parts = latency(flown)
    for row, column in enumerate(parts.values()):
        ms = 1e3 * column
        if not len(ms):
            bars.annotate(
                " not in this recording", (0.0, row), va="center", fontsize="small", color=GREY
            )
            continue
        p50, p99, top = float(np.median(ms)), float(np.percentile(ms, 99)), float(ms.max())
        bars.barh(row, p50, height=0.5, color=BLUE, label="median" if row == 0 else None)
        bars.plot([p50, p99], [row, row], color="black", linewidth=1.2)
        bars.plot(p99, row, "|", color="black", markersize=12, label="99 %" if row == 0 else None)
        bars.plot(top, row, "x", color=RED, markersize=6, label="largest" if row == 0 else None)
        bars.annotate(
            f"   {p50:.2f} | {p99:.2f} | {top:.2f} ms", (top, row), va="center", fontsize="small"
        )
    bars.set_yticks(range(len(parts)), [name.replace("_", " ") for name in parts])
    bars.set_ylim(len(parts) - 0.4, -0.6)
    bars.set_xlim(0.0, 1.5 * bars.get_xlim()[1])
    bars.set_xlabel("duration [ms]")
    _legend_above(bars, 3)
    over.plot(flown.t, 1e3 * flown.scalars["pose_age_s"], ".", color=BLUE, markersize=1.5)
    over.set_ylim(bottom=0.0)
    over.set_xlabel(TIME)
    over.set_ylabel("pose age at the\ncommand [ms]")
    over.margins(x=0.01)


def lateness(panels: Sequence[Any], flown: FlightColumns) -> None:
    """Lateness of commands: after their frame was due, or, where they follow the poses, after their
    pose came.

    With a radio also how late its pacer let frames go. Shown from 1 µs: what is sooner is in the
    first bar.
    """
    (panel,) = panels
    late = 1e3 * drop_unknown(flown.scalars["lateness_s"])
    octaves = flown.looks[-1].get("late_octaves", ()) if flown.looks else ()
    panel.set_xlabel("lateness [ms]")
    panel.set_ylabel("commands, frames")
    if not len(late) and not any(octaves):
        _say_instead(panel, "not recorded")
        return
    if any(octaves):
        _octaves(panel, octaves)
    if len(late):
        _spread(panel, late)
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_ylim(bottom=0.5)
    panel.xaxis.set_major_formatter(_format_tick)
    panel.yaxis.set_major_formatter(_format_tick)
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))


def _octaves(panel: Any, octaves: Sequence[int]) -> None:
    """The frames of a pacer, by octaves of microseconds; those before 1 µs are in the first bar."""
    last = max(k for k, count in enumerate(octaves) if count)
    counts = [sum(octaves[:2]), *octaves[2 : max(last, 1) + 1]]
    label = f"the pacer's {sum(octaves)} frames,\nall within {1e-3 * 2**last:g} ms"
    panel.stairs(
        counts,
        [1e-3 * 2**k for k in range(len(counts) + 1)],
        color=ORANGE,
        linewidth=1.4,
        zorder=3,
        label=label,
    )


def _spread(panel: Any, late: Column) -> None:
    edges = np.geomspace(1e-3, max(10.0, 1.1 * float(late.max())), 49)
    panel.hist(np.maximum(late, 1.0001e-3), bins=list(edges), color=BLUE, label="commands")
    p50, p99, p999 = np.percentile(late, (50, 99, 99.9))
    for value, name, dash in ((p50, "median", "-"), (p99, "99 %", "--"), (p999, "99.9 %", ":")):
        shown = max(0.0, float(value))
        label = f"{name} {shown:.3f} ms"
        panel.axvline(max(shown, 1e-3), color="black", linestyle=dash, linewidth=1.1, label=label)
    panel.plot([], [], " ", label=f"largest {max(0.0, float(late.max())):.3f} ms")


DPI = 140
"""Resolution of pictures for the screen [dots per inch]."""
PLOT_STYLE: Any = {
    "font.size": 9.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9.5,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "agg.path.chunksize": 20000,
}


class ReportFigure(NamedTuple):
    """One figure of the page."""

    name: str
    """Name of its file, without ``.png``."""
    title: str
    rows: int
    """Panels above each other."""
    height_in: float
    draw: Callable[[Sequence[Any], Any], None]
    """Draws one flight (:class:`FlightColumns`), or an identified vehicle, into its panels."""
    is_3d: bool = False
    in_time: bool = True
    """Time is below every panel."""

    @property
    def caption(self) -> str:
        """Caption: the docstring of the function that draws it."""
        return " ".join((self.draw.__doc__ or "").split())


FIGURES = (
    ReportFigure("position", "Position and reference", 3, 5.2, position),
    ReportFigure("disturbance", "Disturbance estimate", 3, 5.2, disturbance),
    ReportFigure("actuation", "Actuation", 4, 6.2, actuation),
    ReportFigure("backstepping", "Backstepping errors", 3, 5.2, backstepping),
    ReportFigure("path", "Path", 1, 5.0, path, is_3d=True, in_time=False),
    ReportFigure("error", "Position error", 2, 5.2, error, in_time=False),
    ReportFigure("lyapunov", "Lyapunov function and certificate", 3, 5.6, lyapunov),
    ReportFigure("latency", "Latency budget", 2, 5.2, latency_budget, in_time=False),
    ReportFigure("lateness", "Lateness", 1, 3.0, lateness, in_time=False),
)


COLUMN_IN = 3.5
"""A column of a journal is so wide [in]."""
PRINT_STYLE: Any = {
    **PLOT_STYLE,
    "font.size": 7.0,
    "axes.titlesize": 7.0,
    "legend.fontsize": 6.0,
    "lines.linewidth": 0.8,
    "axes.linewidth": 0.6,
    "pdf.fonttype": 42,  # letters stay letters: some publishers take no others
    "svg.fonttype": "none",
}
OVERLAID = (
    ("-", BLUE),
    ("--", ORANGE),
    ("-.", GREEN),
    (":", RED),
    ((0, (5, 1, 1, 1, 1, 1)), PURPLE),
    ("-", GREY),
)


def flight_letters(count: int) -> list[str]:
    """Letters of several flights in tables and titles: A, B, and after Z AA."""
    return [chr(ord("A") + i % 26) * (1 + i // 26) for i in range(count)]


def _overlaid(flights: Sequence[FlightColumns]) -> list[tuple[FlightColumns, dict[str, Any]]]:
    """Each flight with its line, and its letter and name in the legend."""
    named = zip(flights, flight_letters(len(flights)), cycle(OVERLAID), strict=False)
    return [
        (flown, {"linestyle": dash, "color": colour, "label": f"{letter}: {flown.name}"})
        for flown, letter, (dash, colour) in named
    ]


def overlay_position(panels: Sequence[Any], flights: Sequence[FlightColumns]) -> None:
    """All flights in one axis, true where all were simulated, with the reference of the first."""
    truth = all(flown.knows_truth for flown in flights)
    for i, (panel, (name, _, _)) in enumerate(zip(panels, AXES, strict=True)):
        for flown, line in _overlaid(flights):
            panel.plot(
                flown.t,
                flown.vectors["true_position_ned" if truth else "position_ned"][:, i],
                **line,
            )
        # Drawn below the flights, which lie on it.
        reference = flights[0].vectors["reference_ned"][:, i]
        panel.plot(
            flights[0].t, reference, color="0.75", linewidth=2.5, zorder=1.0, label="reference"
        )
        panel.set_ylabel(f"{'true' if truth else 'estimated'}\n{name} [m]")
        _at_least(panel, 0.1)
    finish_panels(panels, columns=3)


def overlay_error(panels: Sequence[Any], flights: Sequence[FlightColumns]) -> None:
    """Distance from each flight's own reference."""
    (panel,) = panels
    truth = all(flown.knows_truth for flown in flights)
    for flown, line in _overlaid(flights):
        cm = 100.0 * flown.scalars["true_error_m" if truth else "error_m"]
        panel.plot(flown.t, cm, **line)
    panel.set_yscale("log")
    panel.yaxis.set_major_formatter(_format_tick)
    panel.set_ylabel(f"error against the\n{'truth' if truth else 'estimate'} [cm]")
    finish_panels(panels, columns=3)


OVERLAYS = (
    ReportFigure("overlaid-position", "Positions, overlaid", 3, 5.2, overlay_position),
    ReportFigure("overlaid-error", "Errors, overlaid", 1, 2.6, overlay_error),
)  # fmt: skip
"""Drawn of all flights at once."""


def save_figures(
    folder: Path, figures: Iterable[ReportFigure], shown: Any, form: str = ""
) -> list[tuple[ReportFigure, Path]]:
    """Draw ``figures`` of what is ``shown`` into ``folder``; see :func:`draw_figure`.

    Returns each with its file.

    Raises:
        OSError: a file can't be written.
    """
    made = []
    for one in figures:
        made.append((one, folder / f"{one.name}.{form or 'png'}"))
        draw_figure(one, shown, form).savefig(made[-1][1], dpi=DPI)
    return made


@cache
def figure_class() -> "type[Figure]":
    """matplotlib's figure, which a notebook shows by itself."""
    from matplotlib.figure import Figure

    class ShownFigure(Figure):
        def _repr_png_(self) -> bytes:
            picture = BytesIO()
            self.savefig(picture, dpi=DPI, format="png")
            return picture.getvalue()

    return ShownFigure


def find_figure(name: str) -> ReportFigure:
    """The figure of that name.

    Raises:
        ConfigError: there is none.
    """
    found = next((one for one in FIGURES if one.name == name), None)
    if found is None:
        raise ConfigError(
            "plot", notice("value.choice", choices=[one.name for one in FIGURES], found=name)
        )
    return found


def draw_figure(one: ReportFigure, shown: Any, form: str = "") -> "Figure":
    """Draw one figure of what is ``shown``: a flight, of an overlay several, of an identification
    its vehicle.

    Of a printed ``form`` (pdf, svg) it is as wide as a column of a journal.
    """
    from matplotlib import rc_context

    with rc_context(PRINT_STYLE if form else PLOT_STYLE):
        size = (COLUMN_IN, 0.62 * one.height_in) if form else (7.4, one.height_in)
        canvas = figure_class()(figsize=size, layout="constrained")
        subplot: dict[str, Any] = {"projection": "3d"} if one.is_3d else {}
        panels: Any = canvas.subplots(
            one.rows, 1, squeeze=False, sharex=one.in_time, subplot_kw=subplot
        )
        one.draw(panels[:, 0], shown)
        return canvas
