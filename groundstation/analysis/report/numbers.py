"""The numbers of a flight: what ``--json`` prints and the tables of the page show."""

from typing import Any

import numpy as np

from groundstation.analysis.report.flown import Column, Flown
from groundstation.config import parse_toml
from groundstation.recording import STEADY_S

PAPER = {"rms_cm": 4.61, "max_cm": 7.6, "settle_s": 5.0}
"""What the paper reports of its own flight."""
SETTLED_M = 0.10
"""Settled once the error stays below this [m]."""
ABOUT = ("vehicle", "controller", "trajectory", "scenario", "seed", "clock", "started")
PROGRAM = ("version", "git", "python", "system", "packages")


def numbers(flown: Flown) -> dict[str, Any]:
    """Everything as one object for JSON; what is not known is None."""
    about, headline = flown.recording.about, flown.recording.result
    tracking, t = flown.tracking, flown.scalars["flight_time_s"]
    steady = tracking & (t >= STEADY_S)
    error = flown.scalars["error_m"]
    last = flown.scalars["time_s"] > flown.scalars["time_s"][-1] - 1.0
    return {
        "file": str(flown.path),
        "whole": flown.recording.whole,
        "damaged_at": flown.recording.damaged_at,
        "lost_records": flown.lost,
        "flight": {key: about.get(key, "") for key in ABOUT},
        "program": {key: about.get(key, "") for key in PROGRAM},
        "config": about.get("config", ""),
        "ended": {
            "state": headline.get("state", flown.events[-1][1] if flown.events else ""),
            "reason": headline.get("reason", f"the recording {flown.recording.trouble}"),
        },
        "flown_s": _value(t[tracking].max()) if tracking.any() else 0.0,
        "commands": len(t),
        "error": {
            "against": "estimate",
            "steady_from_s": STEADY_S,
            "rms_cm": _value(100.0 * np.sqrt(np.mean(error[steady] ** 2))) if steady.any() else None,
            "max_cm": _value(100.0 * error[steady].max()) if steady.any() else None,
            "settle_s": settled_s(t[tracking], error[tracking]),
            **_percentiles(100.0 * error[steady], (50, 95, 99), "p{}_cm"),
        },
        "paper": PAPER,
        "disturbance": {
            "b_hat_m_s2": [_value(v) for v in flown.vectors["b_hat_m_s2"][last].mean(axis=0)],
            "d_hat_m_s2": [_value(v) for v in flown.vectors["d_hat_m_s2"][last].mean(axis=0)],
            "effectiveness": _value(flown.scalars["effectiveness"][last].mean()),
            "over": "the last second of commands",
        },
        "actuation": {
            "thrust_min_n": _value(flown.scalars["thrust_n"].min()),
            "thrust_max_n": _value(flown.scalars["thrust_n"].max()),
            "saturated_fraction": _value(flown.scalars["saturated"].mean()),
            "saturated_fraction_steady": _value(flown.scalars["saturated"][steady].mean()) if steady.any() else None,
        },
        "certificate": {
            "fractions": {
                state: flown.certificates.count(state) / len(flown.certificates)
                for state in sorted(set(flown.certificates))
            },
            "v_start": _value(flown.scalars["v"][0]),
            **_percentiles(known(flown.scalars["v"]), (50, 99), "v_p{}"),
            "excess_max": _value(np.max(known(flown.scalars["excess"]), initial=0.0)),
        },
        "latency_ms": {name: _spread(1e3 * part) for name, part in latency(flown).items()},
        "lateness_ms": _spread(1e3 * known(flown.scalars["lateness_s"])),
        "link": {key: value for key, value in (flown.looks[-1] if flown.looks else {}).items() if key != "time_s"},
        "source": flown.source,
        "events": [{"time_s": time_s, "kind": kind, "text": text} for time_s, kind, text in flown.events],
    }


def latency(flown: Flown) -> dict[str, Column]:
    """The parts of the way from a pose to the vehicle [s], each with all its samples; empty where it is not known.

    ``pose_age`` is what ``transport`` and the wait for the next command make together.
    """
    trips = np.array([look["rtt_s"] for look in flown.looks if look["rtt_s"] is not None])
    age = known(flown.scalars["pose_age_s"])
    return {"transport": flown.arrivals_s[:, 1], "pose_age": age, "compute": flown.compute_s, "link": 0.5 * trips}


def limits(flown: Flown) -> dict[str, tuple[float, float]]:
    """Least and largest thrust [N] and body rates [rad/s] of the vehicle as told; empty where the config lacks them."""
    try:
        vehicle = parse_toml(flown.recording.about["config"])["vehicle"]
        rates = [float(np.radians(rate)) for rate in vehicle["rate_limits_deg_s"]]
        thrust = float(vehicle["thrust_min_n"]), float(vehicle["thrust_max_n"])
    except (KeyError, ValueError, TypeError):
        return {}
    return {
        "thrust": thrust,
        "roll": (-rates[0], rates[0]),
        "pitch": (-rates[1], rates[1]),
        "yaw": (-rates[2], rates[2]),
    }


def settled_s(t: Column, error: Column) -> float | None:
    """The first of the times ``t`` [s] from which on ``error`` [m] stays below 10 cm; None if there is none."""
    far = np.flatnonzero(~(error < SETTLED_M))
    first = far[-1] + 1 if len(far) else 0
    return _value(t[first]) if first < len(t) else None


def known(column: Column) -> Column:
    """Without what was not recorded."""
    return column[np.isfinite(column)]


def _spread(column: Column) -> dict[str, float | None]:
    """Percentiles and the largest."""
    spread = _percentiles(column, (50, 99, 99.9), "p{}")
    return {**spread, "max": _value(column.max()) if len(column) else None, "samples": len(column)}


def _percentiles(column: Column, which: tuple[float, ...], name: str) -> dict[str, float | None]:
    return {name.format(p): _value(np.percentile(column, p)) if len(column) else None for p in which}


def _value(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
