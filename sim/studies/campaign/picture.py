"""Report of a campaign: how many flights survived and how well they flew, as figures and as a picture.

It names those to look at first, and draws what of the world goes with an error.
"""

import math
import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from groundstation.config import ConfigError
from sim.studies.campaign.campaign import Campaign, CampaignRow, draw_world, overrides

PERCENTILES = (50, 90, 99)
LIMITS_CM = (8, 4)
"""RMS that 99 % of the flights must and should stay below [cm]."""
WORST = 5
STEP_S = 0.0025
"""A vehicle-step of the plant, with its share of the law's [s]."""


def report(campaign: Campaign, rows: list[CampaignRow], *, flown: int, wall_s: float, workers: int) -> dict[str, Any]:
    """The figures of ``rows`` as JSON has them. A crash counts as an error beyond all others (null).

    Of ``rows``, ``flown`` took ``wall_s`` [s] on ``workers`` processes; the rest was there already.
    Percentiles are the smallest RMS that so many percent of the flights do not exceed.
    """
    count = len(rows)
    worst = sorted(rows, key=_badness, reverse=True)
    vehicle_steps = flown * campaign.duration_s / STEP_S
    return {
        "scenario": campaign.scenario,
        "flights": count,
        "flown_now": flown,
        "duration_s": campaign.duration_s,
        "survived": sum(row.survived for row in rows) / count,
        "rms_cm": {
            **{f"p{p}": worst[count - math.ceil(p * count / 100)].rms_cm for p in PERCENTILES},
            "max": worst[0].rms_cm,
        },
        "under_cm": {
            str(limit): sum(row.rms_cm is not None and row.rms_cm < limit for row in rows) / count
            for limit in LIMITS_CM
        },
        "certificate": {
            "lyapunov_floor": _middle([row.lyapunov_floor for row in rows]),
            "violated": _middle([row.certificate_violated for row in rows]),
            "violated_max": max(_drop_unknown([row.certificate_violated for row in rows]), default=None),
            "suspended": _middle([row.certificate_suspended for row in rows]),
            "b_hat_share_max": max(_drop_unknown([row.b_hat_share_max for row in rows]), default=None),
            "thrust_margin_n": min(_drop_unknown([row.thrust_margin_n for row in rows]), default=None),
        },
        "worst": [
            {
                "seed": row.seed,
                "survived": row.survived,
                "rms_cm": row.rms_cm,
                "max_cm": row.max_cm,
                "command": command(campaign, row.seed),
            }
            for row in worst[:WORST]
        ],
        "workers": workers,
        "wall_s": wall_s,
        "ns_per_vehicle_step": wall_s * workers / vehicle_steps * 1e9 if flown else None,
    }


def command(campaign: Campaign, seed: int) -> str:
    """The shell command that flies the flight of ``seed`` alone, through wire bytes."""
    words = ["groundstation-sim", "fly", "--scenario", campaign.scenario, "--seed", str(seed)]
    words += ["--duration", repr(campaign.duration_s)]
    for override in campaign.overrides + overrides(draw_world(campaign.world, seed, campaign.draws), campaign.draws):
        words += ["--set", override]
    return shlex.join(words)


def text(facts: dict[str, Any]) -> str:
    """``report`` for people."""
    rms = facts["rms_cm"]
    lines = [
        f"{facts['scenario']}: {facts['flights']} flights of {facts['duration_s']:g} s, {facts['flown_now']} flown now",
        "",
        f"{'survived':24}{100.0 * facts['survived']:.2f} %",
        *(f"{f'RMS error, {p} %':24}{_cm(rms[f'p{p}'])}" for p in PERCENTILES),
        f"{'RMS error, worst':24}{_cm(rms['max'])}",
        *(f"{f'RMS under {limit} cm':24}{100.0 * facts['under_cm'][str(limit)]:.2f} %" for limit in LIMITS_CM),
        *_certificate(facts["certificate"]),
        f"{'wall time':24}{facts['wall_s']:.1f} s on {facts['workers']} processes",
    ]
    if facts["ns_per_vehicle_step"] is not None:
        lines.append(f"{'plant, law, observer':24}{facts['ns_per_vehicle_step']:.0f} ns per vehicle-step of 2.5 ms")
    if (verified := facts.get("verified")) is not None:
        lines.append(_describe_verification(verified))
    lines += ["", "worst flights, and how to fly each again:"]
    for row in facts["worst"]:
        lines.append(f"seed {row['seed']}: RMS {_cm(row['rms_cm'])}, largest {_cm(row['max_cm'])}")
        lines.append(f"    {row['command']}")
    return "\n".join(lines)


def _certificate(facts: dict[str, Any]) -> list[str]:
    if None in facts.values():
        return []
    return [
        f"{'V, floor':24}{facts['lyapunov_floor']:.3g} (median)",
        f"{'V above its bound':24}{100.0 * facts['violated']:.2f} % of the commands (median), "
        f"{100.0 * facts['violated_max']:.2f} % at most; suspended {100.0 * facts['suspended']:.2f} % (median)",
        f"{'|b̂| / (B + ε), most':24}{facts['b_hat_share_max']:.2f}",
        f"{'thrust margin, least':24}{facts['thrust_margin_n']:.3f} N",
    ]


def _describe_verification(facts: dict[str, Any]) -> str:
    count, apart = facts["flights"], facts["apart"]
    if apart:
        return f"{'flown again':24}{len(apart)} of {count} DO NOT AGREE with fly: seeds {', '.join(map(str, apart))}"
    apart_cm = facts["largest_cm"]
    largest = "all of them crashed" if apart_cm is None else f"RMS at most {apart_cm:.1e} cm apart"
    return f"{'flown again':24}{count} agree with fly: {largest} (limit {facts['limit_cm']:g})"


def _middle(values: Sequence[float | None]) -> float | None:
    known = _drop_unknown(values)
    return median(known) if known else None


def _drop_unknown(values: Sequence[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _badness(row: CampaignRow) -> tuple[float, int]:
    return (math.inf if row.rms_cm is None else row.rms_cm, -row.seed)


def _cm(value: float | None) -> str:
    return "crashed" if value is None else f"{value:.2f} cm"


# M. Okabe, K. Ito: a palette that the colour-blind can tell apart; markers and dashes differ too.
BLUE, RED, ORANGE = "#0072B2", "#D55E00", "#E69F00"
LIMITS = tuple(zip(LIMITS_CM, ("must", "aim"), (RED, ORANGE), ("-", "--"), strict=True))
FROM_CM = 0.01
"""Smaller errors are drawn as this [cm]."""


class Factor(NamedTuple):
    """Something drawn, as a number."""

    draw: str
    label: str
    value: Callable[[Campaign, CampaignRow], float]


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


def plot(path: Path, campaign: Campaign, rows: Sequence[CampaignRow]) -> None:
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
