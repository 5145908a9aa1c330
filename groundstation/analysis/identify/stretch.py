"""Flight stretch: what identification needs of a recording, the commands that left and the poses of
steady flight.
"""

import math
from base64 import b64decode
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundstation.config import ConfigError
from groundstation.core.health import PoseLatency
from groundstation.core.messages import Pose, notice
from groundstation.core.mission import State
from groundstation.recording import Recording
from groundstation.settings import Config, FlightConfig, read_flown_config
from links.mavlink.protocol import (
    LONGEST_TRAVEL_S,
    TRIPS_KEPT,
    MavlinkCodec,
    RoundTrip,
    attitude_of,
)

Column = NDArray[np.float64]

LEAST_S = 8.0
"""Shorter flights tell nothing [s]."""
SETTLING_S = 0.5
"""The first instants are left out [s]: what the actuators did before is not known as well, and a
filter settles."""
COMMAND_GAP_S = FlightConfig().coast_s
"""Where commands are further apart [s], the link may have brought the vehicle down by its own: the
stretch ends."""
POSE_GAP_S = 0.5
"""Largest gap between poses within a stretch [s]; after a longer one a filter begins anew."""


def components(rows: Column) -> Any:
    """The columns of ``rows`` (N, k), as functions that run on floats and on arrays take them."""
    return tuple(rows.T)


class StretchTooShort(Exception):
    """The recording is too short, or holds no flight; the text says so."""


@dataclass(frozen=True)
class FlightStretch:
    """One stretch of flight on the trajectory."""

    path: Path
    config: Config
    """Configuration of the controller."""
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
    late_s: tuple[float, float] | None = None
    """Latency of poses beyond the configured one by the vehicle's own attitude, and one deviation
    [s]; None without its attitude, or where that serves as the poses."""
    about: dict[str, str] = field(default_factory=dict)
    """First record of the recording, which describes it."""
    trouble: str = ""
    """Why not all of the recording could be read; empty where it could."""

    @property
    def length_s(self) -> float:
        """Length of the stretch [s]."""
        return float(self.at_s[-1] - self.at_s[0])


def read_stretch(path: Path) -> FlightStretch:
    """The longest stretch on the trajectory in the recording at ``path``, up to its damage where it
    is cut off.

    Raises:
        NoRecording, OSError: see :class:`Recording`.
        NotEnough: it holds too little flight.
    """
    recording = Recording(path)
    vehicle = _OwnAttitude()
    sent, seen = _read_messages(recording, vehicle)
    if not len(sent) or not len(seen):
        what = "poses" if len(sent) else "commands"
        raise StretchTooShort(
            notice("identify.no_flight", path=path, what=what, remark=recording.remark)
        )
    chosen = seen[find_stretch(sent[:, 0], seen)]
    length_s = float(chosen[-1, 0] - chosen[0, 0]) if len(chosen) else 0.0
    if length_s < LEAST_S:
        says = notice(
            "identify.short",
            path=path,
            length_s=length_s,
            least_s=LEAST_S,
            remark=recording.remark,
        )
        raise StretchTooShort(says)
    try:
        config = read_flown_config(recording.about, path).config
    except ConfigError as error:
        raise StretchTooShort(notice("identify.other_config", path=path, why=error)) from None
    parts = (sent[:, 0], sent[:, 1], sent[:, 2:5], chosen[:, 0], chosen[:, 3:6], chosen[:, 6:10])
    late = None if config.pose.by_autopilot else vehicle.find_lateness()
    return FlightStretch(path, config, *parts, late, recording.about, recording.trouble)


def _read_messages(recording: Recording, vehicle: "_OwnAttitude") -> tuple[Column, Column]:
    """Read the commands (M, 5) and the poses (N, 10), and show ``vehicle`` the poses and its bytes.

    Of a command: time [s], thrust [N] and body rates [rad/s]. Of a pose: time stamp [s], count of
    resets, whether it is on the trajectory, position [m] and attitude.
    """
    commands: list[tuple[float, ...]] = []
    poses: list[tuple[float, ...]] = []
    state, on = "idle", False
    for entry in recording.entries(("/command", "/idle", "/measured", "/mission", "/raw/received")):
        value = entry.value()
        match entry.topic:
            case "/mission":
                state = value["state"]
            case "/measured":
                p, q = value["position_ned"], value["attitude"]
                place = (p["x"], p["y"], p["z"], q["w"], q["x"], q["y"], q["z"])
                poses.append((value["time_s"], value["reset_count"], on, *place))
                vehicle.latency.add_pose(
                    Pose(0, value["time_s"], value["arrival_s"], place[:3], place[3:])
                )
            case "/raw/received":
                vehicle.receive(
                    value["time_s"], value["wire"], value["peer"] or None, b64decode(value["data"])
                )
            case _:
                on = (
                    entry.topic == "/command"
                    and state == State.TRACKING
                    and value["flight_time_s"] >= 0.0
                )
                w = value["rates_rad_s"]
                commands.append((value["time_s"], value["thrust_n"], w["x"], w["y"], w["z"]))
    return np.array(commands), np.array(poses)


class _OwnAttitude:
    """Comparison of the vehicle's own attitude, on any wire, with the poses."""

    def __init__(self) -> None:
        self.latency = PoseLatency(math.inf)
        self._codecs: dict[int, MavlinkCodec] = {}
        self._trips: deque[RoundTrip] = deque(maxlen=TRIPS_KEPT)

    def find_lateness(self) -> tuple[float, float] | None:
        """See :attr:`FlightStretch.late_s`: the way there takes any part of a round trip."""
        found, trip = self.latency.estimate, min(self._trips, default=None)
        if found is None:
            return None
        # Deviation of a uniform number in that width.
        unknown_s = 0.0 if trip is None else trip.rtt_s / math.sqrt(12.0)
        return found[0], math.hypot(found[1], unknown_s)

    def receive(self, time_s: float, wire: int, peer: str | None, data: bytes) -> None:
        """Bytes that came at ``time_s`` [s] by ``wire``.

        ``peer`` is the sender's address, None on a stream.
        """
        if wire not in self._codecs:
            self._codecs[wire] = MavlinkCodec()
        for message in self._codecs[wire].feed(data, peer):
            if message.get_type() == "TIMESYNC" and message.tc1 > 0:
                trip_s = max(time_s - 1e-9 * message.ts1, 0.0)
                if trip_s <= LONGEST_TRAVEL_S:  # it answers us
                    self._trips.append(
                        RoundTrip(trip_s, 1e-9 * message.tc1 - (time_s - 0.5 * trip_s))
                    )
                continue
            told = attitude_of(message, time_s, min(self._trips, default=None))
            if told is not None:
                self.latency.add_attitude(told)


def find_stretch(sent_s: Column, poses: Column) -> slice:
    """The poses of the longest stretch on the trajectory without a gap.

    Of each of ``poses`` (N, >= 3): its time stamp [s], its count of resets, and above 0 where it is
    on the trajectory.
    """
    at, resets, on = poses[:, 0], poses[:, 1], poses[:, 2] > 0.0
    # The commands that moved a pose lie before it: the one just before must not be older than a
    # gap.
    last = np.searchsorted(sent_s, at) - 1
    gaps = np.flatnonzero(np.diff(sent_s) > COMMAND_GAP_S)
    quiet = np.zeros(len(at), dtype=bool)
    for i in gaps:
        quiet |= (at > sent_s[i] + COMMAND_GAP_S) & (at < sent_s[i + 1] + SETTLING_S)
    good = on & ~quiet & (last >= 0)
    joined = (
        good[1:]
        & good[:-1]
        & (np.diff(at) > 0.0)
        & (np.diff(at) < POSE_GAP_S)
        & (np.diff(resets) == 0.0)
    )
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
