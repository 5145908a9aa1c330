"""A replay in numbers: the fields of ``groundstation replay --json``, all but the verdict."""

import math
from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np
import numpy.typing as npt

from groundstation.analysis.shadow.path import UNKNOWN, FlownPath
from groundstation.analysis.shadow.recording import Recording
from groundstation.analysis.shadow.replay import Compared, Replayed
from groundstation.core.geometry import conjugate, multiply, rotation_vector
from groundstation.core.messages import Pose
from groundstation.settings import Config

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


class Facts(msgspec.Struct, frozen=True, kw_only=True):
    """Everything measured. None: the recording does not tell."""

    file: str
    autopilot: str
    pose_source: str
    poses: int
    dropped: dict[str, int]
    """Bytes, frames, log times, poses and set-points not used, by reason."""
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
    """Estimated velocity against how fast the recorded positions move (path.py), in flight: as above [m/s]."""
    own_velocity_path_rms_m_s: float | None
    """The autopilot's own velocity against the same: how far its velocity and its positions disagree [m/s]."""
    innovation_rms_m: float | None
    """How far each pose was from where the model expected it, in flight [m]."""
    commands: Commands | None


def measured(
    file: str, recording: Recording, replayed: Replayed, path: FlownPath, config: Config, hover: float | None
) -> Facts:
    """The numbers of one replay with ``config``; ``hover``: see flight.py."""
    known = replayed.known
    air = [each for each in known if each.flying]
    intervals = np.array([b.pose.arrival_s - a.pose.arrival_s for a, b in pairwise(known) if a.flying or not air])
    usual = float(np.median(intervals)) if len(intervals) else 0.0
    total = float(intervals.sum())
    own = np.array([each.pose.velocity_ned or UNKNOWN for each in air]).reshape(-1, 3)
    ours = np.array([each.velocity_ned for each in air]).reshape(-1, 3)
    moved = np.array([path.velocity_of_positions(each.pose.time_s) or UNKNOWN for each in air]).reshape(-1, 3)
    from_own = _lengths(ours - own)
    resets = [(a, b) for a, b in pairwise(known) if a.pose.reset_count != b.pose.reset_count]
    return Facts(
        file=file,
        autopilot=recording.autopilot,
        pose_source=recording.pose_source,
        poses=len(recording.poses),
        dropped=recording.dropped | ({"not_newer": replayed.ignored} if replayed.ignored else {}),
        rate_hz=len(intervals) / total if total > 0.0 else None,
        gaps=Gaps(
            int(np.count_nonzero(intervals > GAP * usual)),
            float(intervals.max(initial=0.0)),
            config.flight.coast_s,
        ),
        resets=len(resets),
        resets_in_flight=[
            Reset(b.pose.time_s, b.innovation_m, _turned_rad(a.pose, b.pose)) for a, b in resets if b.flying
        ],
        flights=sum(b.flying and not a.flying for a, b in pairwise(known)) + known[0].flying,
        flight_s=total if air else 0.0,
        hover_thrust=hover,
        hover_configured=config.vehicle.mass_kg * config.controller.gravity / config.full_thrust_n,
        velocity_rms_m_s=_rms(from_own),
        velocity_max_m_s=float(from_own.max()) if len(from_own) else None,
        velocity_path_rms_m_s=_rms(_lengths(ours - moved)),
        own_velocity_path_rms_m_s=_rms(_lengths(own - moved)),
        innovation_rms_m=_rms(np.array([each.innovation_m for each in air])),
        commands=_commands(replayed.compared),
    )


def _turned_rad(before: Pose, after: Pose) -> float:
    return math.hypot(*rotation_vector(multiply(conjugate(before.attitude), after.attitude)))


def _lengths(vectors: Array) -> Array:
    """Lengths (M,) of those of the vectors (N, 3) that are known."""
    lengths: Array = np.linalg.norm(vectors, axis=1)
    return lengths[np.isfinite(lengths)]


def _rms(values: Array) -> float | None:
    return float(np.sqrt(np.mean(values * values))) if len(values) else None


def _commands(compared: Sequence[Compared]) -> Commands | None:
    if not compared:
        return None
    sent = np.array([(each.sent.thrust, *each.sent.rates) for each in compared])
    shadow = np.array([(each.shadow.thrust, *each.shadow.rates) for each in compared])
    thrust, roll, pitch, yaw = (_pair(sent[:, i], shadow[:, i]) for i in range(4))
    saturated = sum(each.saturated for each in compared) / len(compared)
    return Commands(len(compared), thrust, roll, pitch, yaw, saturated)


def _pair(sent: Array, shadow: Array) -> Pair:
    deviation = float(sent.std()), float(shadow.std())
    return Pair(
        float(sent.mean()),
        float(shadow.mean()),
        *deviation,
        float(np.sqrt(np.mean((shadow - sent) ** 2))),
        float(np.corrcoef(sent, shadow)[0, 1]) if min(deviation) > 0.0 else None,
    )
