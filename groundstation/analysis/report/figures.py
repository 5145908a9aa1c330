"""Figures of a report: one PNG each; two flights stand side by side, on the same scales.

Here are those of the flight as a whole: path, error, latency, lateness, events, saturation.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from groundstation.analysis.report import figures_control as control
from groundstation.analysis.report.figures_control import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, TIME
from groundstation.analysis.report.flown import Column, Flown
from groundstation.analysis.report.numbers import PAPER, known, latency, limits
from groundstation.recording import STEADY_S

STATES = (
    ("connecting", "0.80"),
    ("ready", "#56B4E9"),
    ("arming", ORANGE),
    ("takeoff", PURPLE),
    ("hold", "#F0E442"),
    ("tracking", GREEN),
    ("returning", "#56B4E9"),
    ("landing", BLUE),
    ("descent", RED),
    ("disarming", ORANGE),
    ("landed", "0.60"),
    ("handed_over", "0.40"),
    ("aborted", RED),
    ("killed", RED),
)
FLOOR_CM = 0.01
"""Smaller errors are drawn as this [cm]."""
LABELS = 14
"""So many lines of text find room beside the events; the table below has them all."""


def path(panels: Sequence[Any], flown: Flown) -> None:
    """Path and reference in space, on the same scale along each axis."""
    (panel,) = panels
    for key, colour, dash, name in (
        ("position_ned", BLUE, "-", "estimate"),
        ("reference_ned", "black", "--", "reference"),
    ):
        p = flown.vectors[key]
        panel.plot(p[:, 1], p[:, 0], -p[:, 2], dash, color=colour, linewidth=1.0, label=name)
    both = np.concatenate([flown.vectors["position_ned"], flown.vectors["reference_ned"]])
    spans = np.ptp(both, axis=0)
    spans = np.maximum(spans, max(0.2, 0.4 * float(spans.max())))
    for i, (axis, sign) in enumerate((("y", 1.0), ("x", 1.0), ("z", -1.0))):
        middle = sign * 0.5 * (both[:, i].min() + both[:, i].max())
        getattr(panel, f"set_{axis}lim")(middle - 0.53 * spans[i], middle + 0.53 * spans[i])
    panel.set_box_aspect((spans[1], spans[0], spans[2]), zoom=0.9)
    panel.set_xlabel("east [m]")
    panel.set_ylabel("north [m]")
    panel.set_zlabel("up [m]")
    panel.locator_params(nbins=5)
    panel.legend(loc="upper left")


def error(panels: Sequence[Any], flown: Flown) -> None:
    """The error in time, and its histogram."""
    over, shares = panels
    cm = 100.0 * flown.scalars["error_m"]
    over.plot(flown.t, np.maximum(cm, FLOOR_CM), color=BLUE, linewidth=0.9, label="error")
    over.axhline(PAPER["rms_cm"], color=GREY, linestyle="--", linewidth=1.0, label="the paper's RMS, 4.61 cm")
    over.axhline(PAPER["max_cm"], color=RED, linestyle=":", linewidth=1.2, label="the paper's largest, 7.6 cm")
    over.set_yscale("log")
    over.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    over.set_xlabel(TIME)
    over.set_ylabel("position error [cm]")
    over.margins(x=0.01)
    over.legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    steady = cm[flown.tracking & (flown.scalars["flight_time_s"] >= STEADY_S)]
    shares.set_xlabel(f"position error from {STEADY_S:g} s on [cm]")
    shares.set_ylabel("share of commands [%]")
    if not len(steady):
        shares.annotate("the flight ended before it was steady", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return
    shares.hist(steady, bins=50, weights=np.full(len(steady), 100.0 / len(steady)), color=BLUE, alpha=0.75)
    rms = float(np.sqrt(np.mean(steady**2)))
    for value, name, dash in (
        (rms, "RMS", "-"),
        (float(np.percentile(steady, 99)), "99 %", "--"),
        (float(steady.max()), "largest", ":"),
    ):
        shares.axvline(value, color="black", linestyle=dash, linewidth=1.1, label=f"{name} {value:.2f} cm")
    shares.legend()


def latency_budget(panels: Sequence[Any], flown: Flown) -> None:
    """Percentiles of each part, and the pose's age in time."""
    bars, over = panels
    parts = latency(flown)
    for row, column in enumerate(parts.values()):
        ms = 1e3 * column
        if not len(ms):
            bars.annotate(" not in this recording", (0.0, row), va="center", fontsize=8, color=GREY)
            continue
        p50, p99, top = float(np.median(ms)), float(np.percentile(ms, 99)), float(ms.max())
        bars.barh(row, p50, height=0.5, color=BLUE, label="median" if row == 0 else None)
        bars.plot([p50, p99], [row, row], color="black", linewidth=1.2)
        bars.plot(p99, row, "|", color="black", markersize=12, label="99 %" if row == 0 else None)
        bars.plot(top, row, "x", color=RED, markersize=6, label="largest" if row == 0 else None)
        bars.annotate(f"   {p50:.2f} | {p99:.2f} | {top:.2f} ms", (top, row), va="center", fontsize=8)
    bars.set_yticks(range(len(parts)), [name.replace("_", " ") for name in parts])
    bars.set_ylim(len(parts) - 0.4, -0.6)
    bars.set_xlim(0.0, 1.35 * bars.get_xlim()[1])
    bars.set_xlabel("[ms]")
    bars.legend(ncols=3, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    over.plot(flown.t, 1e3 * flown.scalars["pose_age_s"], ".", color=BLUE, markersize=1.5)
    over.set_ylim(bottom=0.0)
    over.set_xlabel(TIME)
    over.set_ylabel("pose age at the\ncommand [ms]")
    over.margins(x=0.01)


def lateness(panels: Sequence[Any], flown: Flown) -> None:
    """Histograms over decades: the tail is what counts."""
    (panel,) = panels
    late = 1e3 * known(flown.scalars["lateness_s"])
    octaves = flown.looks[-1].get("late_octaves", ()) if flown.looks else ()
    panel.set_xlabel("lateness [ms]")
    panel.set_ylabel("commands, frames")
    if not len(late) and not any(octaves):
        panel.annotate("not recorded", (0.5, 0.5), xycoords="axes fraction", ha="center")
        return
    if any(octaves):
        _octaves(panel, octaves)
    if len(late):
        _spread(panel, late)
    panel.set_xscale("log")
    panel.set_yscale("log")
    panel.set_ylim(bottom=0.5)
    panel.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02))


def _octaves(panel: Any, octaves: Sequence[int]) -> None:
    """The frames of a pacer, by octaves of microseconds; those before 1 µs are in the first bar."""
    last = max(k for k, count in enumerate(octaves) if count)
    counts = [sum(octaves[:2]), *octaves[2 : max(last, 1) + 1]]
    label = f"the pacer's {sum(octaves)} frames,\nall within {1e-3 * 2**last:g} ms"
    panel.stairs(
        counts, [1e-3 * 2**k for k in range(len(counts) + 1)], color=ORANGE, linewidth=1.4, zorder=3, label=label
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


def events(panels: Sequence[Any], flown: Flown) -> None:
    """A band of mission states, and a numbered mark for each event; words where there is room."""
    (panel,) = panels
    colours = dict(STATES)
    end = float(flown.t[-1])
    middle = 0.5 * (min(flown.events[0][0], 0.0) + end) if flown.events else 0.0
    told = [event for event in flown.events if event[1] not in ("request", "lost")]
    for i, (time_s, state, _) in enumerate(told):
        until = told[i + 1][0] if i + 1 < len(told) else max(end, time_s)
        colour = colours.get(state, GREY)
        panel.barh(0.0, until - time_s, left=time_s, height=0.8, color=colour, edgecolor="white", linewidth=0.5)
    shown = flown.events[:LABELS]
    for i, (time_s, kind, text) in enumerate(shown):
        row = 1.0 + i
        words = f"{time_s:.1f} s  {kind}: {text}"
        words = words if len(words) <= 60 else f"{words[:59]}…"
        alert = kind in ("request", "lost", "descent", "aborted", "killed")
        panel.plot([time_s, time_s], [-0.4, row], color="0.6", linewidth=0.6)
        panel.plot(time_s, row, "D" if alert else "o", color=RED if alert else GREY, markersize=4, clip_on=False)
        late = time_s > middle
        panel.annotate(
            words, (time_s, row), (-6 if late else 6, 0), textcoords="offset points", va="center",
            ha="right" if late else "left", fontsize=7.5, in_layout=False,
        )  # fmt: skip
    panel.set_ylim(len(shown) + 0.8, -0.6)
    panel.set_yticks([0.0], ["mission"])
    panel.grid(visible=False)
    panel.set_xlabel(TIME)
    left = len(flown.events) - len(shown)
    if left:
        panel.set_title(f"{left} more events stand in the table below", loc="right", fontsize=8)


def saturation(panels: Sequence[Any], flown: Flown) -> None:
    """Commands at a limit by second, and the distribution of the thrust between its limits."""
    over, use = panels
    t, clamped = flown.t, flown.scalars["saturated"]
    seconds = np.floor(t - t[0]).astype(int)
    counts = np.bincount(seconds)
    hits = np.bincount(seconds, weights=clamped)
    share: Column = 100.0 * hits / np.maximum(counts, 1)
    edges_s = t[0] + np.arange(len(share) + 1)
    over.stairs(share, edges_s, fill=True, color=RED, alpha=0.8)
    over.set_ylim(0.0, max(5.0, 1.1 * float(share.max())))
    over.set_xlabel(TIME)
    over.set_ylabel("commands at\na limit [%]")
    over.set_title(f"{100.0 * float(clamped.mean()):.2f} % of all commands", loc="right")
    thrust = flown.scalars["thrust_n"]
    least, most = limits(flown).get("thrust", (float(thrust.min()), float(thrust.max()) + 1e-3))
    share_each, edges = np.full(len(thrust), 100.0 / len(thrust)), list(np.linspace(least, most, 81))
    use.hist(thrust, bins=edges, weights=share_each, color=BLUE, alpha=0.75)
    for k, bound in enumerate(limits(flown).get("thrust", ())):
        use.axvline(bound, color=RED, linestyle="--", linewidth=1.1, label=None if k else "limits")
    if limits(flown):
        use.legend(loc="upper left")
    use.set_xlabel("commanded thrust [N]")
    use.set_ylabel("share of\ncommands [%]")


DPI = 140
LONG_S = 120.0
"""From this length on curves hide each other [s]."""
CLOSE_S = 20.0
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


class Figure(NamedTuple):
    """One figure of the page."""

    name: str
    """Of its file, without ``.png``."""
    title: str
    caption: str
    rows: int
    """Panels above each other."""
    height_in: float
    draw: Callable[[Sequence[Any], Flown], None]
    """Draws one flight into its panels."""
    is_3d: bool = False
    in_time: bool = True
    """Time is below every panel: a long flight's last seconds are shown beside it."""


FIGURES = (
    Figure(
        "position",
        "Position and reference",
        "Estimated position and reference in time, world NED; the paper's figure 3.",
        3,
        5.2,
        control.position,
    ),
    Figure(
        "disturbance",
        "Disturbance estimate",
        "Adaptive estimate b̂ and the observer's d̂ in time; the paper's figure 4.",
        3,
        5.2,
        control.disturbance,
    ),
    Figure(
        "actuation",
        "Actuation",
        "Commanded thrust and body rates, with the vehicle's limits; the paper's figure 5.",
        4,
        6.2,
        control.actuation,
    ),
    Figure(
        "backstepping",
        "Backstepping errors",
        "z1 (position), z2 (speed) and z3 (acceleration) in time; the paper's figure 6. Scales are linear "
        "near zero, and logarithmic beyond where the start would dwarf the rest.",
        3,
        5.2,
        control.backstepping,
    ),
    Figure(
        "path",
        "Path",
        "Estimated path and reference in space. Up is drawn up: the vertical axis is −down.",
        1,
        5.0,
        path,
        is_3d=True,
        in_time=False,
    ),
    Figure(
        "error",
        "Position error",
        "Distance from the reference in time, and how often it was how large from the fifth second on the trajectory.",
        2,
        5.2,
        error,
        in_time=False,
    ),
    Figure(
        "lyapunov",
        "Lyapunov function and certificate",
        "V without its unknown b̃ term, its excess above the bound that the theory gives it, and what the watch said.",
        3,
        5.6,
        control.lyapunov,
    ),
    Figure(
        "latency",
        "Latency budget",
        "From a pose to the vehicle. Transport: from a pose's instant to its arrival. Pose age: from that to the "
        "command, waiting included. Compute: from the command's instant until its bytes left. Link: half a round trip.",
        2,
        5.2,
        latency_budget,
        in_time=False,
    ),
    Figure(
        "lateness",
        "Lateness",
        "How late commands were computed: for their frame, or where they follow the poses, after their pose came. With "
        "a radio also how late its pacer let frames go. Shown from 1 µs: what is sooner is in the first bar.",
        1,
        3.0,
        lateness,
        in_time=False,
    ),
    Figure(
        "events",
        "Events",
        "Mission states, requests, gaps of the recording and the link's word, in time.",
        1,
        3.4,
        events,
        in_time=False,
    ),
    Figure(
        "saturation",
        "Saturation",
        "Share of the commands of each second that met a limit, and how much of the thrust's range was used.",
        2,
        4.6,
        saturation,
        in_time=False,
    ),
)


def drawn(folder: Path, flights: Sequence[Flown]) -> list[tuple[Figure, Path]]:
    """Draw every figure of ``flights`` into ``folder``; returns each with its file.

    Raises:
        OSError: a file can't be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Canvas

    made = []
    with rc_context(PLOT_STYLE):
        for one in FIGURES:
            close_up = one.in_time and len(flights) == 1 and flights[0].t[-1] > LONG_S
            columns = [flights[0]] * 2 if close_up else flights
            canvas = Canvas(figsize=(7.4 if len(columns) == 1 else 11.0, one.height_in), layout="constrained")
            panels: Any = canvas.subplots(
                one.rows,
                len(columns),
                squeeze=False,
                sharex=False if one.is_3d else _shared(one, close_up=close_up),
                sharey=False if one.is_3d else "row",
                subplot_kw={"projection": "3d"} if one.is_3d else {},
            )
            for i, flown in enumerate(columns):
                one.draw(panels[:, i], flown)
                if close_up:
                    _titled(panels[0, i], ("the whole flight", f"its last {CLOSE_S:g} s")[i])
                elif len(flights) > 1:
                    _titled(panels[0, i], f"{'AB'[i]}: {flown.path.parent.name}/{flown.path.name}")
            for panel in panels[:, 1:].flat:
                panel.set_ylabel("" if not one.is_3d else panel.get_ylabel())
            if close_up:
                panels[0, 1].set_xlim(columns[1].t[-1] - CLOSE_S, columns[1].t[-1])
                if panels[0, 0].get_legend() is not None and (legend := panels[0, 1].get_legend()) is not None:
                    legend.remove()
            path = folder / f"{one.name}.png"
            canvas.savefig(path, dpi=DPI)
            made.append((one, path))
    return made


def _shared(one: Figure, *, close_up: bool) -> Literal["all", "col", "row"]:
    """Which panels have the same horizontal axis."""
    if one.in_time:
        return "col" if close_up else "all"
    return "row"


def _titled(panel: Any, text: str) -> None:
    """On the left, above where a legend may be on the right."""
    panel.set_title(text, loc="left", pad=20.0, fontweight="bold")
