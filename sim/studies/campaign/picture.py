"""A campaign as a picture: how many flights had which error, and what of the drawn world goes with it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.config import ConfigError
from sim.studies.campaign.campaign import Campaign
from sim.studies.campaign.folder import Row
from sim.studies.campaign.summary import LIMITS_CM

# M. Okabe, K. Ito: a palette that the colour-blind can tell apart; markers and dashes differ too.
BLUE, RED, ORANGE = "#0072B2", "#D55E00", "#E69F00"
LIMITS = tuple(zip(LIMITS_CM, ("must", "aim"), (RED, ORANGE), ("-", "--"), strict=True))
FROM_CM = 0.01
"""Smaller errors are drawn as this [cm]."""


class Factor(NamedTuple):
    """Something drawn, as a number."""

    draw: str
    label: str
    value: Callable[[Campaign, Row], float]


FACTORS = (
    Factor(
        "gain",
        "true thrust over mass / told [-]",
        lambda c, row: row.thrust_gain * c.config.vehicle.mass_kg / row.mass_kg,
    ),
    Factor("mass", "true mass / told [-]", lambda c, row: row.mass_kg / c.config.vehicle.mass_kg),
    Factor("lags", "true thrust lag [ms]", lambda c, row: 1e3 * row.thrust_lag_s),
    Factor("lags", "true rate lag [ms]", lambda c, row: 1e3 * row.rate_lag_s),
    Factor("wind", "mean wind, down [m/s²]", lambda c, row: row.wind_down),
    Factor("latency", "true pose latency [ms]", lambda c, row: 1e3 * row.pose_latency_s),
    Factor("noise", "position noise [mm]", lambda c, row: 1e3 * row.pose_noise_m),
    Factor("noise", "attitude noise [mrad]", lambda c, row: 1e3 * row.attitude_noise_rad),
    Factor("losses", "poses lost [%]", lambda c, row: 100.0 * row.pose_loss),
    Factor("losses", "frames lost [%]", lambda c, row: 100.0 * row.frame_loss),
    Factor("losses", "length of the outages [ms]", lambda c, row: 1e3 * row.outage_s),
)


def plot(path: Path, campaign: Campaign, rows: Sequence[Row]) -> None:
    """Draw ``rows`` into ``path`` (.png, .svg or .pdf).

    Raises:
        ConfigError: the file can't be written.
    """
    from matplotlib.figure import Figure

    factors = [factor for factor in FACTORS if factor.draw in campaign.draws]
    columns = min(3, 1 + len(factors))
    lines = -(-(1 + len(factors)) // columns)
    figure = Figure(figsize=(4.4 * columns, 3.4 * lines), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    known = [row.rms_cm for row in rows if row.rms_cm is not None]
    crash = 1.6 * max([*known, LIMITS_CM[0]])
    errors = [crash if row.rms_cm is None else max(row.rms_cm, FROM_CM) for row in rows]
    _shares(panels[0], errors, crash)
    for panel, factor in zip(panels[1:], factors, strict=False):
        _against(panel, [factor.value(campaign, row) for row in rows], errors, crash)
        panel.set_xlabel(factor.label)
    for panel in panels[1 + len(factors) :]:
        panel.set_visible(False)
    survived = sum(row.survived for row in rows)
    figure.suptitle(f"{campaign.scenario}: {len(rows)} flights of {campaign.duration_s:g} s, {survived} survived")
    try:
        figure.savefig(path, dpi=150)
    except (OSError, ValueError) as error:
        raise ConfigError("--plot", f"cannot write {path}: {error}") from None


def _shares(panel: Any, errors: Sequence[float], crash: float) -> None:
    """The share of flights whose error is larger: the tail is what counts."""
    ordered = sorted(errors)
    shares = [100.0 * (len(ordered) - i) / len(ordered) for i in range(len(ordered))]
    panel.step(ordered, shares, where="pre", color=BLUE, linewidth=1.8)
    for limit, name, colour, dash in LIMITS:
        panel.axvline(limit, color=colour, linestyle=dash, linewidth=1.2, label=f"{name}: 99 % under {limit} cm")
    panel.axhline(1.0, color="0.6", linewidth=0.8)
    if ordered[-1] >= crash:
        panel.annotate("crashed ", (crash, shares[-1]), ha="right", va="bottom", fontsize=8, color=RED)
    panel.set_xscale("log")
    panel.set_yscale("log")
    for axis in (panel.xaxis, panel.yaxis):
        _plain(axis)
    panel.set_xlabel("RMS position error [cm]")
    panel.set_ylabel("flights with a larger error [%]")
    panel.grid(which="major", color="0.85", linewidth=0.8)
    panel.legend(fontsize=8, loc="lower left")


def _against(panel: Any, values: Sequence[float], errors: Sequence[float], crash: float) -> None:
    flown = [(x, y) for x, y in zip(values, errors, strict=True) if y < crash]
    lost = [x for x, y in zip(values, errors, strict=True) if y >= crash]
    panel.plot([x for x, _ in flown], [y for _, y in flown], ".", color=BLUE, markersize=3, alpha=0.6)
    if lost:
        panel.plot(lost, [crash] * len(lost), "x", color=RED, markersize=5, label="crashed")
        panel.legend(fontsize=8)
    for limit, _, colour, dash in LIMITS:
        panel.axhline(limit, color=colour, linestyle=dash, linewidth=1.2)
    panel.set_yscale("log")
    _plain(panel.yaxis)
    panel.set_ylabel("RMS [cm]")
    panel.grid(which="major", color="0.85", linewidth=0.8)


def _plain(axis: Any) -> None:
    """Numbers as people write them, at 1, 2 and 5 of every decade."""
    from matplotlib.ticker import LogLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(lambda value, _: f"{value:g}")
    axis.set_minor_formatter(lambda value, _: "")
