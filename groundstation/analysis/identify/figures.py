"""How well the identified vehicle fits the flight, drawn: one PNG a figure, in the style of a report's."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from groundstation.analysis.identify.stretch import Column
from groundstation.analysis.identify.thrust_fit import NAMES, full_n, thrust_n
from groundstation.analysis.identify.vehicle import WIDE, IdentifiedVehicle, accelerations
from groundstation.analysis.report import BLUE, DPI, GREEN, GREY, ORANGE, PLOT_STYLE, finish_panels
from links.core import signal

CLOSE_S = 5.0
"""Motions are shown over this time, where they are strongest [s]."""
LAGS = 60
"""Innovations are held against themselves so many poses later."""
TIME = "time since the first pose used [s]"


class FitFigure(NamedTuple):
    """One figure of the page."""

    name: str
    """Of its file, without ``.png``."""
    title: str
    caption: str
    rows: int
    height_in: float
    draw: Callable[[Sequence[Any], IdentifiedVehicle], None]


def _busiest(at_s: Column, values: Column) -> tuple[float, float]:
    """The stretch of :data:`CLOSE_S` in which ``values`` (N, k) move most [s]."""
    span = float(np.median(np.diff(at_s)))
    width = max(1, min(len(at_s), round(CLOSE_S / span)))
    squares = np.nan_to_num((values - np.nanmean(values, axis=0)) ** 2).sum(axis=1)
    strength = np.convolve(squares, np.ones(width), mode="valid")
    start = float(at_s[int(strength.argmax())])
    return start, start + CLOSE_S


def turns(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Body rates between poses: commanded, measured, modelled."""
    seen, turned = found.seen, found.turned
    spans = np.diff(seen.at_s)[:, None]
    begun = seen.at_s[0]
    middle = seen.at_s[:-1] + 0.5 * spans[:, 0]
    start, end = _busiest(middle, turned.modelled / spans)
    for axis, (panel, name) in enumerate(zip(panels, ("roll", "pitch", "yaw"), strict=True)):
        near = (seen.sent_s >= start - 0.1) & (seen.sent_s <= end)
        panel.step(
            seen.sent_s[near] - begun,
            seen.rates_rad_s[near, axis],
            where="post",
            color=GREY,
            linewidth=0.7,
            label="commanded",
        )
        near = (middle >= start) & (middle <= end)
        t = middle[near] - begun
        measured, model = turned.turns[near, axis] / spans[near, 0], turned.modelled[near, axis] / spans[near, 0]
        panel.plot(t, measured, ".", color=ORANGE, markersize=3.5, label="measured")
        panel.plot(t, model, color=BLUE, linewidth=1.4, label="model")
        panel.set_ylabel(f"{name} rate\n[rad/s]")
    finish_panels(panels, below=TIME)


def pushes(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Accelerations: measured and modelled, each less its mean."""
    at, measured, model = accelerations(found)
    start, end = _busiest(at, model)
    near = (at >= start) & (at <= end)
    t = at[near] - found.seen.at_s[0]
    for axis, (panel, name) in enumerate(zip(panels, ("north", "east", "down"), strict=True)):
        for values, style, colour, width, label in (
            (measured, ".", ORANGE, 1.2, "measured"),
            (model, "-", BLUE, 1.4, "model, without wind"),
        ):
            one = values[near, axis]
            panel.plot(t, one - np.nanmean(one), style, color=colour, linewidth=width, markersize=3.5, label=label)
        panel.set_ylabel(f"{name}\n[m/s²]")
    finish_panels(panels, below=TIME)


def curve(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Thrust by its signal, as told and as found, and how often which signal flew."""
    over, often = panels
    config, pushed = found.seen.config, found.pushed
    scale, f = (float(pushed.fit.values[NAMES.index(name)]) for name in ("scale", "curve"))
    signals = np.linspace(0.0, 1.0, 101)
    told = config.full_thrust_n * (config.thrust_curve * signals**2 + (1.0 - config.thrust_curve) * signals)

    def at(scale: float, f: float) -> Column:
        thrust: Column = scale * thrust_n(config, pushed.about, f, signals)
        return thrust

    slopes = np.stack([at(1.0, f), (at(scale, f + 1e-3) - at(scale, f)) / 1e-3], axis=1)
    which = [NAMES.index("scale"), NAMES.index("curve")]
    cover = pushed.fit.covariance[np.ix_(which, which)]
    spread = WIDE * np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slopes, cover, slopes), 0.0))
    over.fill_between(signals, at(scale, f) - spread, at(scale, f) + spread, color=BLUE, alpha=0.25, linewidth=0)
    over.plot(signals, at(scale, f), color=BLUE, label="found; band: 95 %")
    over.plot(signals, told, "--", color="black", linewidth=0.9, label="told")
    over.axhline(config.weight_n, color=GREEN, linestyle=":", linewidth=1.2, label="weight")
    over.set_ylabel("thrust [N]")
    over.set_ylim(0.0, 1.08 * max(told[-1], full_n(config, pushed.about, scale, f)))
    seen = found.seen
    flown = (seen.sent_s >= seen.at_s[0]) & (seen.sent_s <= seen.at_s[-1])
    sent = [signal(newtons / config.full_thrust_n, config.thrust_curve) for newtons in seen.thrust_n[flown].tolist()]
    often.hist(sent, bins=60, range=(0.0, 1.0), weights=np.full(len(sent), 100.0 / len(sent)), color=BLUE, alpha=0.75)
    often.set_ylabel("share of\ncommands [%]")
    finish_panels(panels, below="signal as sent, 0 to 1")


def whiteness(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """How what the models leave hangs together in time."""
    span = float(np.median(np.diff(found.seen.at_s)))
    groups = (
        (found.turned.fit.news, (("roll", BLUE, "-"), ("pitch", ORANGE, "--"), ("yaw", GREEN, "-."))),
        (found.pushed.fit.news, (("north", BLUE, "-"), ("east", ORANGE, "--"), ("down", GREEN, "-."))),
    )
    for panel, (news, axes), name in zip(panels, groups, ("turns", "positions"), strict=True):
        band = WIDE / np.sqrt(len(news))
        panel.axhspan(-band, band, color=GREY, alpha=0.18, linewidth=0, label="95 % of white noise")
        for axis, (label, colour, dash) in enumerate(axes):
            one = news[:, axis] - news[:, axis].mean()
            total = max(float(one @ one), 1e-12)
            shares = [float(one[lag:] @ one[:-lag]) / total for lag in range(1, LAGS + 1)]
            panel.plot(span * np.arange(1, LAGS + 1), shares, dash, color=colour, linewidth=1.0, label=label)
        panel.set_ylim(-0.5, 0.5)
        panel.set_ylabel(f"{name}:\nautocorrelation [-]")
        panel.legend(ncols=4, loc="upper right")
    panels[-1].set_xlabel("apart by [s]")


def shares(panels: Sequence[Any], found: IdentifiedVehicle) -> None:
    """Each parameter against what was told."""
    (panel,) = panels
    known = [one for one in found.parameters.values() if one.interval and one.value is not None and one.told]
    for row, one in enumerate(known):
        assert one.interval is not None
        assert one.value is not None
        assert one.told
        low, high, value = (100.0 * edge / one.told for edge in (*one.interval, one.value))
        panel.plot([low, high], [row, row], color=BLUE, linewidth=2.0, solid_capstyle="butt")
        panel.plot([value], [row], "o", color=BLUE, markersize=5)
    panel.axvline(100.0, color="black", linestyle="--", linewidth=0.9)
    panel.set_yticks(range(len(known)), [one.title for one in known])
    panel.set_ylim(len(known) - 0.5, -0.5)
    panel.set_xlabel("share of what was told [%]; bars: 95 %")


FIGURES = (
    FitFigure(
        "told",
        "Found against told",
        "Each parameter that the controller is told, and its 95 % interval, as a share of what it was told in this "
        "flight. What it was told as 0 is in the table only.",
        1,
        3.4,
        shares,
    ),
    FitFigure(
        "turns",
        "Body rates",
        "Commanded, measured (from one pose to the next) and modelled, over the 5 s in which they move most. Dots that "
        "lie beside the line all to one side speak of another lag or delay.",
        3,
        5.2,
        turns,
    ),
    FitFigure(
        "pushes",
        "Accelerations",
        "Second differences over 0.2 s of the measured positions and of the model's, each less its mean. What differs "
        "slowly is wind.",
        3,
        5.2,
        pushes,
    ),
    FitFigure(
        "curve",
        "Thrust curve",
        "Thrust by the signal that is sent, as told and as found; below, which signals this flight used. Beyond these "
        "the curve is a guess.",
        2,
        5.0,
        curve,
    ),
    FitFigure(
        "whiteness",
        "What is left",
        "Innovations of turns and positions against themselves, later. Far outside the band, the model lacks "
        "something; intervals are widened for it.",
        2,
        4.6,
        whiteness,
    ),
)


def draw_figures(folder: Path, found: IdentifiedVehicle) -> list[tuple[FitFigure, Path]]:
    """Draw every figure into ``folder``; returns each with its file.

    Raises:
        OSError: a file can't be written.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure as Canvas

    made = []
    with rc_context(PLOT_STYLE):
        for one in FIGURES:
            canvas = Canvas(figsize=(7.4, one.height_in), layout="constrained")
            panels: Any = canvas.subplots(one.rows, 1, squeeze=False, sharex=True)
            one.draw(panels[:, 0], found)
            path = folder / f"{one.name}.png"
            canvas.savefig(path, dpi=DPI)
            made.append((one, path))
    return made
