"""Flight stretch: what identification needs of a recording, the commands that left and the poses of steady flight."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.config import ConfigError, from_dict, parse_toml
from groundstation.core.mission import State
from groundstation.recording import Recording
from groundstation.settings import Config

Column = NDArray[np.float64]

LEAST_S = 8.0
"""Shorter flights tell nothing [s]."""
SETTLING_S = 0.5
"""The first instants are left out [s]: what the actuators did before is not known as well."""
COMMAND_GAP_S = 0.25
"""Where commands are further apart [s], the link may have brought the vehicle down by its own: the stretch ends."""
POSE_GAP_S = 0.5
"""The same for poses [s]."""


def components(rows: Column) -> Any:
    """The columns of ``rows`` (N, k), as functions that run on floats and on arrays take them."""
    return tuple(rows.T)


class StretchTooShort(Exception):
    """The recording is too short, or holds no flight; the text says so."""


@dataclass(frozen=True)
class FlightStretch:
    """One stretch of flight on the trajectory."""

    path: Path
    recording: Recording
    config: Config
    """What the controller was told."""
    sent_s: Column
    """When each command left, (M,) [s]; those before the stretch too."""
    thrust_n: Column
    """Thrust as commanded, (M,) [N]."""
    rates_rad_s: Column
    """Body rates as commanded, (M, 3) [rad/s, FRD]."""
    at_s: Column
    """Time stamps of the poses, (N,) [s], rising."""
    position_ned: Column
    """(N, 3) [m]"""
    attitude: Column
    """Body to world, w first, (N, 4)."""

    @property
    def length_s(self) -> float:
        """Of the stretch [s]."""
        return float(self.at_s[-1] - self.at_s[0])


def read_stretch(path: Path) -> FlightStretch:
    """The longest stretch on the trajectory in the recording at ``path``, up to its damage where it is cut off.

    Raises:
        NoRecording, OSError: see :class:`Recording`.
        NotEnough: it holds too little flight.
    """
    recording = Recording(path)
    commands: list[tuple[float, ...]] = []
    poses: list[tuple[float, ...]] = []
    state, on = "idle", False
    for entry in recording.entries(("/command", "/idle", "/measured", "/mission")):
        value = entry.value()
        match entry.topic:
            case "/mission":
                state = value["state"]
            case "/measured":
                p, q = value["position_ned"], value["attitude"]
                place = (p["x"], p["y"], p["z"], q["w"], q["x"], q["y"], q["z"])
                poses.append((value["time_s"], value["reset_count"], on, *place))
            case _:
                on = entry.topic == "/command" and state == State.TRACKING and value["flight_time_s"] >= 0.0
                w = value["rates_rad_s"]
                commands.append((value["time_s"], value["thrust_n"], w["x"], w["y"], w["z"]))
    if not commands or not poses:
        raise StretchTooShort(f"{path} holds no flight: there are no {'poses' if commands else 'commands'} in it")
    sent, seen = np.array(commands), np.array(poses)
    chosen = seen[find_stretch(sent[:, 0], seen)]
    length_s = float(chosen[-1, 0] - chosen[0, 0]) if len(chosen) else 0.0
    if length_s < LEAST_S:
        raise StretchTooShort(
            f"{path} holds {length_s:.1f} s of unbroken flight on its trajectory, and {LEAST_S:g} s are the least: "
            "fly trajectory.kind = 'excitation'"
        )
    config = _config(recording.about.get("config", ""), path)
    parts = (sent[:, 0], sent[:, 1], sent[:, 2:5], chosen[:, 0], chosen[:, 3:6], chosen[:, 6:10])
    return FlightStretch(path, recording, config, *parts)


def find_stretch(sent_s: Column, poses: Column) -> slice:
    """The poses of the longest stretch on the trajectory without a gap.

    Of each of ``poses`` (N, >= 3): its time stamp [s], its count of resets, and above 0 where it is on the trajectory.
    """
    at, resets, on = poses[:, 0], poses[:, 1], poses[:, 2] > 0.0
    # The commands that moved a pose lie before it: the one just before must not be older than a gap.
    last = np.searchsorted(sent_s, at) - 1
    gaps = np.flatnonzero(np.diff(sent_s) > COMMAND_GAP_S)
    quiet = np.zeros(len(at), dtype=bool)
    for i in gaps:
        quiet |= (at > sent_s[i] + COMMAND_GAP_S) & (at < sent_s[i + 1] + SETTLING_S)
    good = on & ~quiet & (last >= 0)
    joined = good[1:] & good[:-1] & (np.diff(at) > 0.0) & (np.diff(at) < POSE_GAP_S) & (np.diff(resets) == 0.0)
    best, start = slice(0, 0), 0
    for end in [*np.flatnonzero(~joined).tolist(), len(joined)]:
        if at[end] - at[start] > (at[best][-1] - at[best][0] if best.stop else 0.0):
            best = slice(start, end + 1)
        start = end + 1
        if start >= len(at):
            break
    if best.stop:
        first = int(np.searchsorted(at[best], at[best.start] + SETTLING_S))
        best = slice(best.start + first, best.stop)
    return best


def _config(text: str, path: Path) -> Config:
    try:
        return from_dict(parse_toml(text), Config)
    except (ValueError, ConfigError) as error:
        raise StretchTooShort(f"{path} was flown with a configuration that this version cannot read: {error}") from None
