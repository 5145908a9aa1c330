"""What an autopilot makes of ODOMETRY that it is sent: what its estimator would fuse, and what it leaves. Sans-IO.

As in PX4 v1.15 (mavlink_receiver.cpp) and ArduPilot 4.6-dev (GCS_Common.cpp).
"""

import math
from collections import Counter

import msgspec

from groundstation.core.geometry.ops import Quat, Vec3
from links.mavlink.protocol.codec import ARDUPILOT, Message

NED, BODY_FRD, LOCAL_FRD = 1, 12, 20
UNKNOWN, VISION, VIO = 0, 2, 3


class Fused(msgspec.Struct, frozen=True):
    """One pose that the estimator has taken."""

    arrival_s: float
    stamp_s: float
    """By the sender's clock [s]."""
    position: Vec3
    attitude: Quat
    velocity_body: Vec3 | None
    variance: tuple[float, float]
    """Of position [m²] and attitude [rad²], the first axis of each."""
    resets: int


class ExternalPoses:
    """Those of one autopilot."""

    def __init__(self, kind: int) -> None:
        """Of the autopilot ``kind`` (HEARTBEAT.autopilot)."""
        self._kind = kind
        self.fused: list[Fused] = []
        self.left: Counter[str] = Counter()
        """By reason: frame, estimator, not_finite."""

    def take(self, m: Message, now_s: float) -> None:
        """One message."""
        velocity: Vec3 | None = (m.vx, m.vy, m.vz)
        if self._kind == ARDUPILOT:
            if (m.frame_id, m.child_frame_id) != (LOCAL_FRD, BODY_FRD):
                self.left["frame"] += 1
                return
        elif m.estimator_type not in (UNKNOWN, VISION, VIO):
            self.left["estimator"] += 1
            return
        elif m.frame_id not in (NED, LOCAL_FRD):
            self.left["frame"] += 1
            return
        elif not all(map(math.isfinite, (m.vx, m.vy, m.vz))):
            velocity = None
        if not all(map(math.isfinite, (m.x, m.y, m.z, *m.q, *(velocity or ())))):
            self.left["not_finite"] += 1  # ArduPilot would not notice
            return
        variance = m.pose_covariance[0], m.pose_covariance[15]
        pose = (m.x, m.y, m.z), tuple(m.q)
        self.fused.append(Fused(now_s, m.time_usec * 1e-6, *pose, velocity, variance, m.reset_counter))
