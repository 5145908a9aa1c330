"""A comparison as a picture: RMS error by scenario, and the error through the gust front over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from groundstation.config import ConfigError
from groundstation.runtime import require_matplotlib
from sim.runs import STEADY_S
from sim.scenarios import SCENARIOS
from sim.studies.compare.compare import GUST, TRACE_S, WITHOUT_ADAPTATION, Flown, Row

# M. Okabe, K. Ito: a palette that the colour-blind can tell apart; markers and dashes differ too.
STYLES: dict[str, dict[str, Any]] = {
    "adaptive": {"color": "#0072B2", "marker": "o"},
    WITHOUT_ADAPTATION: {"color": "#0072B2", "marker": "*", "linestyle": ":", "markerfacecolor": "white"},
    "uncompensated": {"color": "#000000", "marker": "x", "linestyle": (0, (1, 1))},
    "geometric": {"color": "#E69F00", "marker": "s", "linestyle": "--"},
    "pid": {"color": "#CC79A7", "marker": "^", "linestyle": "-."},
    "indi": {"color": "#009E73", "marker": "D", "linestyle": (0, (5, 1, 1, 1, 1, 1))},
}
OTHERS: tuple[dict[str, Any], ...] = (
    {"color": "#D55E00", "marker": "v"},
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
    require_matplotlib(
        "--plot", "needs matplotlib, which is not installed: pip install 'quadrotor-groundstation[plot]'"
    )
    from matplotlib.figure import Figure

    if not path.absolute().parent.is_dir():
        raise ConfigError("--plot", f"cannot write {path}: there is no such folder")
    if path.is_dir():
        raise ConfigError("--plot", f"cannot write {path}: it is a folder")
    kinds = Figure().canvas.get_supported_filetypes()
    if path.suffix and path.suffix[1:].lower() not in kinds:
        raise ConfigError("--plot", f"cannot write {path}: expected a name that ends in one of {sorted(kinds)}")


def plot(path: Path, rows: Sequence[Row], flights: Sequence[Flown]) -> None:
    """Draw ``rows``, and the traced ones of ``flights``, into ``path`` (.png, .svg or .pdf).

    Raises:
        ConfigError: the file can't be written.
    """
    from matplotlib.figure import Figure

    traced = [one for one in flights if one.trace]
    names = list(dict.fromkeys(row.controller for row in rows))
    free = iter(OTHERS * len(names))
    styles = {name: STYLES.get(name) or next(free) for name in names}
    figure = Figure(figsize=(9.5, 8.2 if traced else 4.6), layout="constrained")
    panels = figure.subplots(2 if traced else 1, 1, squeeze=False)[:, 0]
    _by_scenario(panels[0], rows, styles)
    if traced:
        _over_time(panels[1], traced, styles)
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise ConfigError("--plot", f"cannot write {path}: {error}") from None


def _by_scenario(panel: Any, rows: Sequence[Row], styles: dict[str, dict[str, Any]]) -> None:
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


def _over_time(panel: Any, traced: Sequence[Flown], styles: dict[str, dict[str, Any]]) -> None:
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
