"""The figures of a report: one PNG each; two flights stand side by side, on the same scales."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from groundstation.analysis.report import figures_control as control
from groundstation.analysis.report import figures_flight as flight
from groundstation.analysis.report.flown import Flown

DPI = 140
LONG_S = 120.0
"""From this length on curves hide each other [s]."""
CLOSE_S = 20.0
STYLE: Any = {
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
        flight.path,
        is_3d=True,
        in_time=False,
    ),
    Figure(
        "error",
        "Position error",
        "Distance from the reference in time, and how often it was how large from the fifth second on the trajectory.",
        2,
        5.2,
        flight.error,
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
        flight.latency_budget,
        in_time=False,
    ),
    Figure(
        "lateness",
        "Lateness",
        "How late commands were computed: for their frame, or where they follow the poses, after their pose came. With "
        "a radio also how late its pacer let frames go. Shown from 1 µs: what is sooner is in the first bar.",
        1,
        3.0,
        flight.lateness,
        in_time=False,
    ),
    Figure(
        "events",
        "Events",
        "Mission states, requests, gaps of the recording and the link's word, in time.",
        1,
        3.4,
        flight.events,
        in_time=False,
    ),
    Figure(
        "saturation",
        "Saturation",
        "Share of the commands of each second that met a limit, and how much of the thrust's range was used.",
        2,
        4.6,
        flight.saturation,
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
    with rc_context(STYLE):
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
