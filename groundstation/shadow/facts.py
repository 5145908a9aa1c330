"""A replay in numbers: the fields of ``groundstation replay --json`` but for the verdict."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from groundstation.poses.port import Pose
from groundstation.shadow.path import Path
from groundstation.shadow.recording import Recording
from groundstation.shadow.replay import Compared, Known, Replayed
from groundstation.so3 import conjugate, multiply, rotation_vector

GAP = 3.0
"""An interval this many times the usual one is a gap."""

Array = npt.NDArray[np.float64]


class Gaps(msgspec.Struct, frozen=True):
    """Intervals between the arrivals of two poses, in flight (in the whole recording where nothing flies)."""

    count: int
    """How many are longer than three times the usual one."""
    longest_s: float
    """[s]"""
    limit_s: float
    """How long commands may rest on one pose (flight.coast_s) [s]."""


class Reset(msgspec.Struct, frozen=True):
    """The source moved its origin or its attitude in flight."""

    time_s: float
    """Since the recording began [s]."""
    moved_m: float
    """How far from where the model expected it the next pose was [m]."""
    turned_rad: float
    """Between the attitudes before and after it [rad]."""


class Pair(msgspec.Struct, frozen=True):
    """One number of the commands, as sent and as the shadow would have sent it, in flight."""

    sent_mean: float
    shadow_mean: float
    sent_std: float
    shadow_std: float
    difference_rms: float
    correlation: float | None
    """None where one of the two never changed."""


class Commands(msgspec.Struct, frozen=True):
    """The set-points that were sent in flight, beside those of the shadow."""

    compared: int
    thrust_n: Pair
    roll_rate_rad_s: Pair
    pitch_rate_rad_s: Pair
    yaw_rate_rad_s: Pair
    saturated_fraction: float
    """Share of the shadow's commands of which a part was at a limit."""


class Facts(msgspec.Struct, frozen=True):
    """Everything measured. None: the recording does not tell."""

    file: str
    autopilot: str
    pose_source: str
    poses: int
    dropped: dict[str, int]
    """Bytes, frames, poses and set-points not used, by reason."""
    rate_hz: float | None
    """Poses a second, in flight (in the whole recording where nothing flies)."""
    gaps: Gaps
    resets: int
    """Changes of the source's reset counter in the whole recording."""
    resets_in_flight: list[Reset]
    flights: int
    flight_s: float
    """Time in the air on set-points [s]."""
    hover_thrust: float | None
    """Share of full thrust that carries the vehicle, as flown."""
    hover_configured: float
    """The same by the configuration: m g / thrust_max."""
    velocity_rms_m_s: float | None
    """Estimated velocity against the autopilot's own, in flight: length of the difference [m/s]."""
    velocity_max_m_s: float | None
    velocity_path_rms_m_s: float | None
    """Estimated velocity against the derivative of the recorded path (path.py) [m/s]."""
    own_velocity_path_rms_m_s: float | None
    """The autopilot's own velocity against the same: how far its velocity and its positions disagree [m/s]."""
    innovation_rms_m: float | None
    """How far each pose was from where the model expected it, in flight [m]."""
    commands: Commands | None


def facts(
    file: str,
    recording: Recording,
    replayed: Replayed,
    path: Path,
    *,
    hover: float | None,
    hover_configured: float,
    coast_s: float,
) -> Facts:
    """The numbers of one replay."""
    known = replayed.known
    air = [each for each in known if each.flying]
    intervals = _intervals(known, in_flight=bool(air))
    usual = float(np.median(intervals)) if len(intervals) else 0.0
    own, estimated, followed = _velocities(air, path)
    dropped = dict(recording.dropped)
    if replayed.ignored:
        dropped["not_newer"] = replayed.ignored
    return Facts(
        file=file,
        autopilot=recording.autopilot,
        pose_source=recording.pose_source,
        poses=len(recording.poses),
        dropped=dropped,
        rate_hz=len(intervals) / float(intervals.sum()) if intervals.sum() > 0.0 else None,
        gaps=Gaps(int((intervals > GAP * usual).sum()), float(intervals.max(initial=0.0)), coast_s),
        resets=sum(b.pose.reset_count != a.pose.reset_count for a, b in zip(known, known[1:], strict=False)),
        resets_in_flight=[
            Reset(b.pose.time_s, b.innovation_m, _turn(a.pose, b.pose))
            for a, b in zip(known, known[1:], strict=False)
            if b.flying and a.pose.reset_count != b.pose.reset_count
        ],
        flights=sum(b and not a for a, b in zip([False, *(e.flying for e in known)], [e.flying for e in known], strict=False)),
        flight_s=float(intervals.sum()) if air else 0.0,
        hover_thrust=hover,
        hover_configured=hover_configured,
        velocity_rms_m_s=_rms(estimated - own),
        velocity_max_m_s=_max(estimated - own),
        velocity_path_rms_m_s=_rms(estimated - followed),
        own_velocity_path_rms_m_s=_rms(own - followed),
        innovation_rms_m=_rms(np.array([[each.innovation_m] for each in air])),
        commands=_commands(replayed.compared),
    )
