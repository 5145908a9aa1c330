"""What PX4 1.15 and ArduPilot 4.6-dev would fuse of the ODOMETRY that they are sent."""

import math
from collections import Counter

import msgspec

from groundstation.core.geometry import Quat, Vec3
from links.mavlink.protocol import ARDUPILOT, EstimatorKind, MavFrame, MavlinkCodec, Message
from sim.runs import Stage

FUSED_BY_PX4 = (EstimatorKind.UNKNOWN, EstimatorKind.VISION, EstimatorKind.VIO)


class Fused(msgspec.Struct, frozen=True):
    """One pose that the estimator has taken."""

    arrival_s: float
    stamp_s: float
    """Time stamp on the sender's clock [s]."""
    position: Vec3
    attitude: Quat
    velocity_body: Vec3 | None
    variance: tuple[float, float]
    """Variance of position [m²] and attitude [rad²], the first axis of each."""
    resets: int


class ExternalPoses:
    """Poses that one simulated autopilot's estimator would fuse."""

    def __init__(self, kind: int) -> None:
        """Fuse poses as the autopilot ``kind`` (HEARTBEAT.autopilot) does."""
        self._kind = kind
        self.fused: list[Fused] = []
        self.left: Counter[str] = Counter()
        """Number of rejected poses by reason: frame, estimator, not_finite."""

    @classmethod
    def of(cls, stage: Stage) -> "ExternalPoses":
        """Return those that come to the autopilot of ``stage`` from now on."""
        poses, codec = cls(stage.autopilot.kind), MavlinkCodec(1, 1)

        def overhear(time_s: float, data: bytes) -> None:
            for message in codec.feed(data, "station"):
                if message.get_type() == "ODOMETRY":
                    poses.take(message, time_s)

        stage.peer.overhear = overhear
        return poses

    def take(self, m: Message, now_s: float) -> None:
        """One message."""
        velocity: Vec3 | None = (m.vx, m.vy, m.vz)
        if self._kind == ARDUPILOT:
            if (m.frame_id, m.child_frame_id) != (MavFrame.LOCAL_FRD, MavFrame.BODY_FRD):
                self.left["frame"] += 1
                return
        elif m.estimator_type not in FUSED_BY_PX4:
            self.left["estimator"] += 1
            return
        elif m.frame_id not in (MavFrame.LOCAL_NED, MavFrame.LOCAL_FRD):
            self.left["frame"] += 1
            return
        elif not all(map(math.isfinite, (m.vx, m.vy, m.vz))):
            velocity = None
        if not all(map(math.isfinite, (m.x, m.y, m.z, *m.q, *(velocity or ())))):
            self.left["not_finite"] += 1  # ArduPilot would not notice
            return
        variance = m.pose_covariance[0], m.pose_covariance[15]
        pose = (m.x, m.y, m.z), tuple(m.q)
        stamp_s = m.time_usec * 1e-6
        self.fused.append(Fused(now_s, stamp_s, *pose, velocity, variance, m.reset_counter))
