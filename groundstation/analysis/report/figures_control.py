"""Figures of control: the paper's 3 to 6, and the Lyapunov function with its certificate."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from groundstation.analysis.report.flown import Column, Flown
from groundstation.analysis.report.numbers import limits

# M. Okabe, K. Ito: a palette that the colour-blind can tell apart; dashes differ too, for print without colour.
BLUE, ORANGE, GREEN, RED, GREY, PURPLE = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#555555", "#CC79A7"
AXES = (("north", BLUE, "-"), ("east", ORANGE, "--"), ("down", GREEN, "-."))
TIME = "time [s]"
V_FLOOR = 1e-8
"""V below this is drawn as this [m²/s²]."""


def position(panels: Sequence[Any], flown: Flown) -> None:
    """Estimate and reference, an axis a panel."""
    for i, (panel, (name, colour, _)) in enumerate(zip(panels, AXES, strict=True)):
        panel.plot(flown.t, flown.vectors["position_ned"][:, i], color=colour, linewidth=1.6, label="estimate")
        panel.plot(flown.t, flown.vectors["reference_ned"][:, i], "--", color="black", linewidth=0.9, label="reference")
        panel.set_ylabel(f"{name} [m]")
        _at_least(panel, 0.1)
    _finished(panels)


def disturbance(panels: Sequence[Any], flown: Flown) -> None:
    """b̂ and d̂, an axis a panel."""
    for i, (panel, (name, colour, _)) in enumerate(zip(panels, AXES, strict=True)):
        panel.plot(flown.t, flown.vectors["b_hat_m_s2"][:, i], color=colour, label="b̂ (adaptation)")
        panel.plot(flown.t, flown.vectors["d_hat_m_s2"][:, i], color="black", linewidth=0.7, label="d̂ (observer)")
        panel.set_ylabel(f"{name} [m/s²]")
    _finished(panels)


def actuation(panels: Sequence[Any], flown: Flown) -> None:
    """Thrust and three body rates, with the commands that met a limit."""
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
            panel.axhline(bound, color=RED, linestyle=(0, (4, 3)), linewidth=0.9, label=None if k else "limit")
        if clamped.any():
            label = "a limit was met (any of the four)"
            panel.plot(flown.t[clamped], values[clamped], "x", color=RED, markersize=4, label=label)
        panel.set_ylabel(f"{name}{'' if name == 'thrust' else ' rate'} [{unit}]")
    _finished(panels)


def backstepping(panels: Sequence[Any], flown: Flown) -> None:
    """z1, z2 and z3, three axes a panel. The scale is that of the flight, not that of its first instants."""
    for panel, (key, name) in zip(
        panels, (("z1_m", "z1 [m]"), ("z2_m_s", "z2 [m/s]"), ("z3_m_s2", "z3 [m/s²]")), strict=True
    ):
        values = flown.vectors[key]
        for i, (axis, colour, dash) in enumerate(AXES):
            panel.plot(flown.t, values[:, i], dash, color=colour, linewidth=1.0, label=axis)
        panel.set_ylabel(name)
        _linear_near_zero(panel, values)
    _finished(panels, columns=3)


def lyapunov(panels: Sequence[Any], flown: Flown) -> None:
    """V with its terms, its excess, and the watch's word as a band."""
    over, excess, word = panels
    for key, label, colour, dash in (
        ("v_sigma", "position term", BLUE, "--"),
        ("v_omega", "speed term", ORANGE, "-."),
        ("v_z3", "acceleration term", GREEN, ":"),
        ("v", "V", "black", "-"),
    ):
        over.plot(flown.t, np.maximum(flown.scalars[key], V_FLOOR), dash, color=colour, linewidth=1.0, label=label)
    if not np.nanmax(flown.scalars["v"], initial=0.0) > 0.0:
        over.annotate("this controller has no Lyapunov function", (0.5, 0.5), xycoords="axes fraction", ha="center")
    over.set_yscale("log")
    over.set_ylabel("V and its terms\n[m²/s²]")
    excess.plot(flown.t, flown.scalars["excess"], color=RED)
    excess.set_ylabel("V above its\nbound [m²/s²]")
    names = ("holds", "suspended", "violated", "none")
    for row, (name, colour) in enumerate(zip(names, (GREEN, ORANGE, RED, GREY), strict=True)):
        at = np.array([state == name for state in flown.certificates])
        share = 100.0 * float(at.mean())
        word.plot(flown.t[at], np.full(int(at.sum()), row), "|", color=colour, markersize=11)
        word.annotate(f"{share:.2f} %", (1.01, row), xycoords=("axes fraction", "data"), va="center", fontsize=8)
    word.set_yticks(range(4), names)
    word.set_ylim(3.6, -0.6)
    word.set_ylabel("certificate")
    _finished(panels, columns=4)


def _finished(panels: Sequence[Any], columns: int = 3) -> None:
    """The legend above the first panel, where no curve is; the time below the last."""
    handles, labels = panels[0].get_legend_handles_labels()
    if handles:
        panels[0].legend(handles, labels, ncols=columns, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    panels[-1].set_xlabel(TIME)
    for panel in panels:
        panel.margins(x=0.01)


def _at_least(panel: Any, span: float) -> None:
    """A millimetre must not fill the panel: show ``span`` at least, in the unit of the axis."""
    low, high = panel.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        panel.set_ylim(middle - 0.5 * span, middle + 0.5 * span)


def _linear_near_zero(panel: Any, values: Column) -> None:
    """Linear up to what 99 % of the flight keeps to, logarithmic above, where the start would dwarf the rest."""
    from matplotlib.ticker import SymmetricalLogLocator

    usual = float(np.percentile(np.abs(values[np.isfinite(values)]), 95)) if np.isfinite(values).any() else 0.0
    if usual > 0.0 and np.nanmax(np.abs(values)) > 10.0 * usual:
        threshold = 10.0 ** np.ceil(np.log10(usual))
        panel.set_yscale("symlog", linthresh=threshold, linscale=2.0)
        panel.yaxis.set_major_locator(SymmetricalLogLocator(base=10.0, linthresh=threshold))
        panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
