"""A campaign in a few figures: how many flights survived, how well they flew, and which to look at first."""

import math
import shlex
from typing import Any

from sim.campaign import Campaign
from sim.campaign_draws import drawn, overrides
from sim.campaign_folder import Row

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
    for override in campaign.overrides + overrides(drawn(campaign.world, seed)):
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
        f"{'wall time':24}{facts['wall_s']:.1f} s on {facts['workers']} processes",
    ]
    if facts["ns_per_vehicle_step"] is not None:
        lines.append(f"{'plant, law, observer':24}{facts['ns_per_vehicle_step']:.0f} ns per vehicle-step of 2.5 ms")
    lines += ["", "worst flights, and how to fly each again:"]
    for row in facts["worst"]:
        lines.append(f"seed {row['seed']}: RMS {_cm(row['rms_cm'])}, largest {_cm(row['max_cm'])}")
        lines.append(f"    {row['command']}")
    return "\n".join(lines)


def _badness(row: Row) -> tuple[float, int]:
    return (math.inf if row.rms_cm is None else row.rms_cm, -row.seed)


def _cm(value: float | None) -> str:
    return "crashed" if value is None else f"{value:.2f} cm"
