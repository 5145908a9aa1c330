"""A campaign in a few figures: how many flights survived, how well they flew, and which to look at first."""

import math
import shlex
from collections.abc import Sequence
from statistics import median
from typing import Any

from sim.studies.campaign.campaign import Campaign
from sim.studies.campaign.draws import drawn, overrides
from sim.studies.campaign.folder import Row

PERCENTILES = (50, 90, 99)
LIMITS_CM = (8, 4)
"""RMS that 99 % of the flights must and should stay below [cm]."""
WORST = 5
STEP_S = 0.0025
"""A vehicle-step of the plant, with its share of the law's [s]."""


def report(campaign: Campaign, rows: list[Row], *, flown: int, wall_s: float, workers: int) -> dict[str, Any]:
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
            "violated_max": max(_known([row.certificate_violated for row in rows]), default=None),
            "suspended": _middle([row.certificate_suspended for row in rows]),
            "b_hat_share_max": max(_known([row.b_hat_share_max for row in rows]), default=None),
            "thrust_margin_n": min(_known([row.thrust_margin_n for row in rows]), default=None),
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
    for override in campaign.overrides + overrides(drawn(campaign.world, seed, campaign.draws), campaign.draws):
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
        lines.append(_verified(verified))
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


def _verified(facts: dict[str, Any]) -> str:
    count, apart = facts["flights"], facts["apart"]
    if apart:
        return f"{'flown again':24}{len(apart)} of {count} DO NOT AGREE with fly: seeds {', '.join(map(str, apart))}"
    apart_cm = facts["largest_cm"]
    largest = "all of them crashed" if apart_cm is None else f"RMS at most {apart_cm:.1e} cm apart"
    return f"{'flown again':24}{count} agree with fly: {largest} (limit {facts['limit_cm']:g})"


def _middle(values: Sequence[float | None]) -> float | None:
    known = _known(values)
    return median(known) if known else None


def _known(values: Sequence[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _badness(row: Row) -> tuple[float, int]:
    return (math.inf if row.rms_cm is None else row.rms_cm, -row.seed)


def _cm(value: float | None) -> str:
    return "crashed" if value is None else f"{value:.2f} cm"
