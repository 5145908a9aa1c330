"""Recorded flight, as a report has it: columns with one row a command, and the numbers that follow
from them.

The numbers are what ``--json`` prints and the tables of the page show.
"""

import base64
import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from groundstation.config import parse_toml
from groundstation.core.messages import (
    FLOWN,
    MEAN_S,
    PAPER,
    SATURATION_FROM_S,
    SETTLED_M,
    STEADY_S,
    DisturbanceMeter,
    begin_of_steady_part,
    notice,
)
from groundstation.core.mission import State
from groundstation.recording import Entry, Recording, tabulate

Column = NDArray[np.float64]

SCALARS = {
    "time_s": ("/command", "time_s"),
    "flight_time_s": ("/command", "flight_time_s"),
    "thrust_n": ("/command", "thrust_n"),
    "saturated": ("/command", "saturated"),
    "error_m": ("/errors", "error_m"),
    "effectiveness": ("/adaptation", "effectiveness"),
    "effectiveness_deviation": ("/adaptation", "effectiveness_deviation"),
    "modelled_thrust_n": ("/estimate", "thrust_n"),
    "v": ("/lyapunov", "v_known"),
    "v_sigma": ("/lyapunov", "v_sigma"),
    "v_omega": ("/lyapunov", "v_omega"),
    "v_z3": ("/lyapunov", "v_z3"),
    "excess": ("/lyapunov", "excess"),
    "pose_age_s": ("/timing", "pose_age_s"),
    "lateness_s": ("/timing", "lateness_s"),
    "true_error_m": ("/truth", "error_m"),
}
"""Column → topic and field."""
VECTORS = {
    "rates_rad_s": ("/command", "rates_rad_s"),
    "reference_ned": ("/reference", "position_ned"),
    "reference_velocity_ned": ("/reference", "velocity_ned"),
    "position_ned": ("/estimate", "position_ned"),
    "velocity_ned": ("/estimate", "velocity_ned"),
    "attitude": ("/estimate", "attitude"),
    "z1_m": ("/errors", "z1_m"),
    "z2_m_s": ("/errors", "z2_m_s"),
    "z3_m_s2": ("/errors", "z3_m_s2"),
    "b_hat_m_s2": ("/adaptation", "b_hat_m_s2"),
    "d_hat_m_s2": ("/adaptation", "d_hat_m_s2"),
    "true_position_ned": ("/truth", "position_ned"),
    "true_velocity_ned": ("/truth", "velocity_ned"),
    "true_attitude": ("/truth", "attitude"),
    "true_wind_m_s2": ("/truth", "wind_m_s2"),
}
"""Channels and fields of vectors, three components each; an attitude has four: w, x, y, z."""
_PARTS = ("/command", "/reference", "/estimate", "/errors", "/adaptation", "/lyapunov", "/timing")
"""Channels recorded with each command; in simulation the truth follows."""
_TRUTH = "/truth"
_OTHERS = (
    "/measured",
    "/mission",
    "/request",
    "/lost",
    "/link",
    "/source",
    "/raw/sent",
    "/lyapunov",
)
_ATTITUDE_TARGET = (82).to_bytes(3, "little")
"""MAVLink's SET_ATTITUDE_TARGET, bytes 7 to 9 of a frame: others leave by the same wire."""


class NoCommand(Exception):
    """The recording holds no command; the text says so."""


@dataclass
class FlightColumns:
    """One flight."""

    path: Path
    recording: Recording
    scalars: dict[str, Column] = field(default_factory=dict)
    """Each of shape (commands,)."""
    vectors: dict[str, Column] = field(default_factory=dict)
    """Each of shape (commands, 3), or (commands, 4)."""
    compute_s: Column = field(default_factory=lambda: np.empty(0))
    """Time from a command's instant until its bytes left [s]; only of a recorded wire."""
    arrivals_s: Column = field(default_factory=lambda: np.empty((0, 2)))
    """Arrival of each pose, and its latency then [s]."""
    begun_s: float = 0.0
    """When the trajectory began, on the event loop's clock, else the first command [s]."""
    states: list[str] = field(default_factory=list)
    """The mission's state at each command."""
    certificates: list[str] = field(default_factory=list)
    """Whether V kept to its bound, at each command."""
    events: list[tuple[float, str, str]] = field(default_factory=list)
    """Mission states, requests and lost records: time since ``begun_s`` [s], kind, text."""
    looks: list[dict[str, Any]] = field(default_factory=list)
    """Status reports of the link."""
    source: dict[str, Any] = field(default_factory=dict)
    """Last status report of the pose source."""
    lost: int = 0
    budget: dict[str, Any] = field(default_factory=dict)
    """Its error budget (:class:`sim.studies.budget.ErrorBudget`), where one was asked for."""

    @property
    def t(self) -> Column:
        """Time since the trajectory began, of each command [s]."""
        return self.scalars["time_s"] - self.begun_s

    @cached_property
    def config(self) -> dict[str, Any]:
        """The configuration in the recording; empty where it is none."""
        with suppress(ValueError):
            told = parse_toml(self.recording.about.get("config", ""))
            return {name: table for name, table in told.items() if isinstance(table, dict)}
        return {}

    @property
    def is_papers(self) -> bool:
        """Whether this is the flight of the paper, its law in its wind: then the paper's figures
        stand beside it.
        """
        about = self.recording.about
        return (about.get("scenario"), about.get("controller")) == ("paper", "adaptive")

    @property
    def name(self) -> str:
        """As a legend has it: its controller and where it flew, or its file."""
        about = self.recording.about
        # Of a script's or a notebook's own.
        controller = about.get("controller", "").removeprefix("__main__:")
        return ", ".join(filter(None, (controller, about.get("scenario")))) or self.path.stem

    @property
    def knows_truth(self) -> bool:
        """Whether the truth is recorded, as of a simulated flight."""
        return bool(np.isfinite(self.scalars["true_error_m"]).any())

    @property
    def tracking(self) -> NDArray[np.bool_]:
        """True for commands on the trajectory: not on the way to it, and before the way back."""
        return np.array([state == State.TRACKING for state in self.states]) & (
            self.scalars["flight_time_s"] >= 0.0
        )


def read_columns(path: Path) -> FlightColumns:
    """Read the recording at ``path``, up to its damage where it is cut off.

    Raises:
        NoRecording, OSError: see :class:`Recording`.
        NoCommand: nothing was commanded in it.
    """
    recording = Recording(path)
    flown = FlightColumns(path, recording)
    entries = list(recording.entries((*_PARTS, _TRUTH, *_OTHERS)))
    tables = tabulate(entries, (*_PARTS, _TRUTH))
    count = min(len(tables[part].get("time_s", ())) for part in _PARTS)  # the last may be cut off
    if not count:
        raise NoCommand(notice("report.no_command", path=path, remark=recording.remark).text)
    time_s = tables["/command"]["time_s"][:count]
    for name, (topic, key) in SCALARS.items():
        flown.scalars[name] = _at_commands(tables[topic], key, time_s)
    for name, (topic, key) in VECTORS.items():
        components = "wxyz" if key == "attitude" else "xyz"
        columns = [_at_commands(tables[topic], f"{key}.{part}", time_s) for part in components]
        flown.vectors[name] = np.stack(columns, axis=1)
    _read_others(flown, entries, count)
    on = np.flatnonzero(flown.tracking)
    flown.begun_s = float(
        time_s[on[0]] - flown.scalars["flight_time_s"][on[0]] if len(on) else time_s[0]
    )
    flown.events = [(time_s - flown.begun_s, kind, text) for time_s, kind, text in flown.events]
    return flown


def _at_commands(table: Mapping[str, Column], key: str, time_s: Column) -> Column:
    """The column ``key`` at the commands of ``time_s`` (N,) [s]; what was not recorded is NaN."""
    if key not in table:
        return np.full(len(time_s), np.nan)
    at = np.clip(np.searchsorted(table["time_s"], time_s), 0, len(table["time_s"]) - 1)
    return np.where(table["time_s"][at] == time_s, table[key][at], np.nan)


def _read_others(flown: FlightColumns, entries: list[Entry], count: int) -> None:
    """Read what is no column: states, certificates, events, and when the bytes of ``count``
    commands left.
    """
    arrivals: list[tuple[float, float]] = []
    compute: list[float] = []
    by_mavlink = bool(flown.recording.about.get("mavlink"))
    state, waiting_s = "idle", math.nan
    for entry in entries:
        if entry.topic not in _OTHERS:
            continue
        value = entry.value()
        match entry.topic:
            case "/raw/sent":
                if not (by_mavlink and base64.b64decode(value["data"])[7:10] != _ATTITUDE_TARGET):
                    compute.append(value["time_s"] - waiting_s)
                    waiting_s = math.nan
            case "/measured":
                arrivals.append((value["arrival_s"], value["arrival_s"] - value["time_s"]))
            case "/mission":
                state = value["state"]
                flown.events.append((value["time_s"], state, value["text"]))
            case "/request":
                flown.events.append(
                    (value["time_s"], "request", f"{value['what']}: {value['reason']}")
                )
            case "/lost":
                flown.lost += value["count"]
                flown.events.append(
                    (value["time_s"], "lost", f"{value['count']} records are missing")
                )
            case "/link":
                flown.looks.append({"time_s": value["time_s"], **value["status"]})
            case "/source":
                flown.source = value["status"]
            case _:
                if len(flown.states) < count:
                    flown.states.append(state)
                    flown.certificates.append(value["state"])
                    waiting_s = value["time_s"]
    flown.compute_s = drop_unknown(np.array(compute))
    flown.arrivals_s = np.array(arrivals).reshape(-1, 2)


ABOUT = ("vehicle", "controller", "trajectory", "scenario", "seed", "clock", "started")
PROGRAM = ("version", "git", "python", "system", "packages")


def numbers(flown: FlightColumns) -> dict[str, Any]:
    """Everything as one object for JSON; what is not known is None."""
    about, headline = flown.recording.about, flown.recording.result
    tracking, t = flown.tracking, flown.scalars["flight_time_s"]
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
        "error": _summarize_error(flown),
        "true_error": {
            "against": "truth",
            "rms_cm": _cm(headline.get("true_rms_m")),
            "max_cm": _cm(headline.get("true_max_m")),
        },
        "paper": PAPER if flown.is_papers else None,
        "disturbance": _summarize_disturbance(flown),
        "actuation": _summarize_actuation(flown),
        "certificate": _summarize_certificate(flown),
        "latency_ms": {name: _spread(1e3 * part) for name, part in latency(flown).items()},
        "lateness_ms": _spread(1e3 * drop_unknown(flown.scalars["lateness_s"])),
        "link": {
            key: value
            for key, value in (flown.looks[-1] if flown.looks else {}).items()
            if key != "time_s"
        },
        "source": flown.source,
        "budget": flown.budget or None,
        "events": [
            {"time_s": time_s, "clock_s": time_s + flown.begun_s, "kind": kind, "text": text}
            for time_s, kind, text in flown.events
        ],
    }


def _summarize_error(flown: FlightColumns) -> dict[str, Any]:
    """The estimated position error on the trajectory."""
    tracking, t = flown.tracking, flown.scalars["flight_time_s"]
    error = flown.scalars["error_m"]
    steady = error[tracking & (t >= begin_of_steady_part(t[tracking].max(initial=0.0)))]
    return {
        "against": "estimate",
        "steady_from_s": STEADY_S,
        "rms_cm": _value(100.0 * np.sqrt(np.mean(steady**2))) if len(steady) else None,
        "max_cm": _value(100.0 * steady.max()) if len(steady) else None,
        "settle_s": settled_s(t[tracking], error[tracking]),
        **_percentiles(100.0 * steady, (50, 95, 99), "p{}_cm"),
    }


def _summarize_disturbance(flown: FlightColumns) -> dict[str, Any]:
    """The disturbance at the end, as the law and the observer have it."""
    last = flown.scalars["time_s"] > flown.scalars["time_s"][-1] - 1.0
    return {
        "b_hat_m_s2": [_value(v) for v in flown.vectors["b_hat_m_s2"][last].mean(axis=0)],
        "d_hat_m_s2": [_value(v) for v in flown.vectors["d_hat_m_s2"][last].mean(axis=0)],
        "effectiveness": _value(flown.scalars["effectiveness"][last].mean()),
        **_read_disturbance(flown),
        "over": "the last second of commands",
    }


def _summarize_actuation(flown: FlightColumns) -> dict[str, Any]:
    """The commanded thrust, and how often a command was at its limits."""
    thrust, saturated = flown.scalars["thrust_n"], flown.scalars["saturated"]
    settled = saturated[flown.tracking & (flown.scalars["flight_time_s"] >= SATURATION_FROM_S)]
    return {
        "thrust_min_n": _value(thrust.min()),
        "thrust_max_n": _value(thrust.max()),
        "saturated_fraction": _value(saturated.mean()),
        "saturated_fraction_steady": _value(settled.mean()) if len(settled) else None,
    }


def _summarize_certificate(flown: FlightColumns) -> dict[str, Any]:
    """Whether V kept to its bound, and what it was."""
    states, v = flown.certificates, flown.scalars["v"]
    return {
        "fractions": {state: states.count(state) / len(states) for state in sorted(set(states))},
        "v_start": _value(v[0]),
        **_percentiles(drop_unknown(v), (50, 99), "v_p{}"),
        "excess_max": _value(np.max(drop_unknown(flown.scalars["excess"]), initial=0.0)),
    }


def _read_disturbance(flown: FlightColumns) -> dict[str, Any]:
    """The observable disturbance and its split, as screens last showed them in flight."""
    keys = ("time_s", "modelled_thrust_n", "effectiveness", "effectiveness_deviation")
    at_s, thrust, scale, deviation = (flown.scalars[key] for key in keys)
    away = np.flatnonzero(
        np.isfinite(scale) & np.array([state in FLOWN for state in flown.states], bool)
    )
    mass_kg = flown.config.get("vehicle", {}).get("mass_kg")
    if not len(away) or mass_kg is None:
        return {}
    meter, vectors = DisturbanceMeter(mass_kg), flown.vectors
    # The reading is a mean over so long.
    for i in away[at_s[away] > at_s[away[-1]] - MEAN_S].tolist():
        attitude, disturbance = (
            tuple(vectors["attitude"][i].tolist()),
            tuple(vectors["d_hat_m_s2"][i].tolist()),
        )
        meter.add_parts(
            float(at_s[i]),
            attitude,
            float(thrust[i]),
            disturbance,
            float(scale[i]),
            float(deviation[i]),
        )
    reading = meter.reading
    return {} if reading is None else msgspec.to_builtins(reading)


def _cm(metres: str | None) -> float | None:
    """Centimetres of what the recording's end says in metres, as text."""
    return 100.0 * float(metres) if metres else None


def latency(flown: FlightColumns) -> dict[str, Column]:
    """The parts of the way from a pose to the vehicle [s], each with all its samples.

    Empty where it is not known.

    ``pose_age`` is what ``transport`` and the wait for the next command make together.
    """
    trips = np.array([look["rtt_s"] for look in flown.looks if look["rtt_s"] is not None])
    age = drop_unknown(flown.scalars["pose_age_s"])
    return {
        "transport": flown.arrivals_s[:, 1],
        "pose_age": age,
        "compute": flown.compute_s,
        "link": 0.5 * trips,
    }


def limits(flown: FlightColumns) -> dict[str, tuple[float, float]]:
    """Least and largest thrust [N] and body rates [rad/s] of the vehicle as told.

    Empty where the config lacks them.
    """
    vehicle = flown.config.get("vehicle", {})
    if not {"rate_limits_deg_s", "thrust_min_n", "thrust_max_n"} <= vehicle.keys():
        return {}
    rates = np.radians(vehicle["rate_limits_deg_s"]).tolist()
    turns = {
        axis: (-rate, rate) for axis, rate in zip(("roll", "pitch", "yaw"), rates, strict=True)
    }
    return {"thrust": (vehicle["thrust_min_n"], vehicle["thrust_max_n"]), **turns}


def floor_z_m(flown: FlightColumns) -> float:
    """Down coordinate of the floor, from which heights count [m]; 0 where the config lacks it."""
    return float(flown.config.get("flight", {}).get("floor_z_m", 0.0))


def settled_s(t: Column, error: Column) -> float | None:
    """The first of the times ``t`` [s] from which on ``error`` [m] stays below 10 cm.

    None if there is none.
    """
    far = np.flatnonzero(~(error < SETTLED_M))
    first = far[-1] + 1 if len(far) else 0
    return _value(t[first]) if first < len(t) else None


def drop_unknown(column: Column) -> Column:
    """Without what was not recorded."""
    return column[np.isfinite(column)]


def _spread(column: Column) -> dict[str, float | None]:
    """Percentiles and the largest."""
    spread = _percentiles(column, (50, 99, 99.9), "p{}")
    return {**spread, "max": _value(column.max()) if len(column) else None, "samples": len(column)}


def _percentiles(column: Column, which: tuple[float, ...], name: str) -> dict[str, float | None]:
    return {
        name.format(p): _value(np.percentile(column, p)) if len(column) else None for p in which
    }


def _value(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None
