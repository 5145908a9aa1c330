"""Poses out of VISION_POSITION_ESTIMATE (MAVLink 102), as motion-capture bridges send them to autopilots. Sans-IO.

The message has no frame field: by its definition x, y, z and roll, pitch, yaw are NED and FRD; bridges that send
other axes exist, and the config then names them. One datagram may hold several frames, of several senders.
Source: message definitions of pymavlink 2.4.50.
"""

from collections.abc import Sequence
from typing import NamedTuple

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.intake import Intake
from links.mavlink.protocol import MavlinkCodec

NAME = "VISION_POSITION_ESTIMATE"


class Vision(NamedTuple):
    """One message, by its own axes."""

    time_s: float
    """The sender's clock [s]."""
    position: Vec3
    """[m]"""
    attitude: Quat


def encode(codec: MavlinkCodec, vision: Vision, resets: int = 0) -> bytes:
    """The frame, for simulators and tests."""
    d = codec.dialect
    angles = so3.euler_zyx(vision.attitude)
    return codec.pack(
        d.MAVLink_vision_position_estimate_message(
            round(vision.time_s * 1e6), *vision.position, *angles, [float("nan")] * 21, resets
        )
    )


class VisionReader:
    """Implements :class:`groundstation.pose.intake.intake.Reader`."""

    def __init__(self, intake: Intake, system_id: int | None = None) -> None:
        """Read the messages of MAVLink system ``system_id``; None: whoever sends any."""
        self._codec = MavlinkCodec(255, 190)
        self._codec.dropped = intake.dropped  # one account for both
        self._intake = intake
        self._system = system_id

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now; other_message and other_system beside the codec's and the intake's reasons."""
        return self._intake.status

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The poses in ``datagram``."""
        poses = []
        for m in self._codec.feed_datagram(datagram):
            if m.get_type() != NAME:
                self._intake.drop("other_message")
            elif self._system not in (None, m.get_srcSystem()):
                self._intake.drop("other_system")
            elif not -1e3 < m.roll + m.pitch + m.yaw < 1e3:  # nan too
                self._intake.drop("not_finite")
            else:
                attitude = so3.from_euler_zyx(m.roll, m.pitch, m.yaw)
                resets = getattr(m, "reset_counter", 0)
                pose = self._intake.pose(m.usec * 1e-6, arrival_s, (m.x, m.y, m.z), attitude, resets=resets)
                if pose is not None:
                    poses.append(pose)
        return poses
