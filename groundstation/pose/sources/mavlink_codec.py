"""MAVLink pose messages: an autopilot's estimate in its own numbers, and a motion-capture bridge's.

Sans-IO.

PX4 sends ODOMETRY. ArduPilot has none: there each LOCAL_POSITION_NED is joined with the newest
ATTITUDE_QUATERNION, which is propagated by its own body rates if its stamp (time_boot_ms) differs.
On ArduCopter 4.8 at 100 Hz the stamps are always the same, and the pose is exact.

Bridges send VISION_POSITION_ESTIMATE (MAVLink 102), which has no frame field: by its definition x,
y, z and roll, pitch, yaw are NED and FRD; bridges that send other axes exist, and the config then
names them. One datagram may hold several frames, of several senders. Source: message definitions of
pymavlink 2.4.50; frames and stamps as sent by PX4 1.16-alpha and ArduCopter 4.8-dev.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import NamedTuple

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose
from groundstation.pose.sources.intake import Intake, PoseReader
from links.mavlink.protocol import ARDUPILOT, MavFrame, MavlinkCodec, Message

OLDEST_ATTITUDE_S = 0.05
"""Largest time between a position and the attitude that is propagated to it [s]."""


class PoseDecoder(ABC):
    """Makes poses of the messages of one autopilot."""

    messages: tuple[str, ...]
    """Names of the needed messages."""

    def __init__(self, latency_s: float, *, recorded: bool = False) -> None:
        """``latency_s`` is the time from the instant of a pose to its earliest arrival here [s].

        ``recorded``: clocks are not exchanged, and a simulated autopilot may have run at another
        pace than real time. So the rate of its stamps is measured, as that of numbered frames.
        """
        self.intake = Intake(latency_s, frame_s=1.0 if recorded else None)
        """Intake of the poses; adds the reasons wrong_frame, failed and no_attitude for drops."""

    @abstractmethod
    def decode(self, message: Message, arrival_s: float) -> Pose | None:
        """Return the pose that ``message`` completes.

        It arrived at ``arrival_s`` [s, our clock].
        """


class OdometryDecoder(PoseDecoder):
    """Poses of ODOMETRY."""

    messages: tuple[str, ...] = ("ODOMETRY",)

    def decode(self, message: Message, arrival_s: float) -> Pose | None:
        """Return the pose in ``message``, or None."""
        if message.get_type() != "ODOMETRY":
            return None
        if message.frame_id not in (MavFrame.LOCAL_NED, MavFrame.LOCAL_FRD):
            return self.intake.drop("wrong_frame")
        if message.quality < 0:
            return self.intake.drop("failed")
        w, x, y, z = message.q
        velocity: Vec3 = (message.vx, message.vy, message.vz)
        match message.child_frame_id:
            case MavFrame.BODY_FRD | MavFrame.BODY_NED:
                velocity = so3.to_world((w, x, y, z), velocity)
            case c if c != message.frame_id:
                return self.intake.drop("wrong_frame")
        position = (message.x, message.y, message.z)
        return self.intake.pose(
            message.time_usec * 1e-6,
            arrival_s,
            position,
            (w, x, y, z),
            velocity,
            resets=message.reset_counter,
        )


class LocalPositionDecoder(PoseDecoder):
    """Poses of LOCAL_POSITION_NED, each with the newest ATTITUDE_QUATERNION."""

    messages: tuple[str, ...] = ("LOCAL_POSITION_NED", "ATTITUDE_QUATERNION")

    _attitude: Message | None = None

    def decode(self, message: Message, arrival_s: float) -> Pose | None:
        """Return the pose of a LOCAL_POSITION_NED ``message`` with an attitude near it."""
        name = message.get_type()
        if name == "ATTITUDE_QUATERNION":
            self._attitude = message
        if name != "LOCAL_POSITION_NED":
            return None
        turned = self._attitude
        apart_s = (
            (message.time_boot_ms - turned.time_boot_ms) * 1e-3 if turned is not None else math.inf
        )
        if turned is None or abs(apart_s) > OLDEST_ATTITUDE_S:
            return self.intake.drop("no_attitude")
        attitude: Quat = (turned.q1, turned.q2, turned.q3, turned.q4)
        rates = (turned.rollspeed, turned.pitchspeed, turned.yawspeed)
        if apart_s and math.isfinite(sum(rates) + sum(attitude)) and any(attitude):
            attitude = so3.rotate(
                attitude, (apart_s * rates[0], apart_s * rates[1], apart_s * rates[2])
            )
        position = (message.x, message.y, message.z)
        velocity = (message.vx, message.vy, message.vz)
        return self.intake.pose(
            message.time_boot_ms * 1e-3, arrival_s, position, attitude, velocity
        )


POSE_MESSAGES = frozenset((*OdometryDecoder.messages, *LocalPositionDecoder.messages))
"""Messages that give an autopilot's poses."""


def decoder_for(autopilot: int, latency_s: float, *, recorded: bool = False) -> PoseDecoder:
    """Make the decoder for the messages of an autopilot (HEARTBEAT.autopilot)."""
    kind = LocalPositionDecoder if autopilot == ARDUPILOT else OdometryDecoder
    return kind(latency_s, recorded=recorded)


VISION = "VISION_POSITION_ESTIMATE"


class VisionEstimate(NamedTuple):
    """One message, by its own axes."""

    time_s: float
    """The sender's clock [s]."""
    position: Vec3
    """[m]"""
    attitude: Quat


def encode_vision(codec: MavlinkCodec, vision: VisionEstimate) -> bytes:
    """Return the frame, for simulators and tests."""
    d = codec.dialect
    angles = so3.euler_zyx(vision.attitude)
    return codec.pack(
        d.MAVLink_vision_position_estimate_message(
            round(vision.time_s * 1e6), *vision.position, *angles, [float("nan")] * 21
        )
    )


class VisionReader(PoseReader):
    """Reads VISION_POSITION_ESTIMATE; each sender's bytes are one stream.

    Reasons for drops beside those of codec and intake: other_message, other_system,
    other_component.
    """

    def __init__(
        self, intake: Intake, system_id: int | None = None, component_id: int | None = None
    ) -> None:
        """Read the messages of that MAVLink system and component; None: of any."""
        super().__init__(intake)
        self._codec = MavlinkCodec()
        self._codec.dropped = intake.dropped  # one account for both
        self._system, self._component = system_id, component_id

    def read(self, data: bytes, arrival_s: float) -> Sequence[Pose]:
        """Return the poses in the datagram ``data``."""
        poses = (self._pose(message, arrival_s) for message in self._codec.feed(data, self.sender))
        return [pose for pose in poses if pose is not None]

    def _pose(self, m: Message, arrival_s: float) -> Pose | None:
        if m.get_type() != VISION:
            return self.intake.drop("other_message")
        if self._system not in (None, m.get_srcSystem()):
            return self.intake.drop("other_system")
        if self._component not in (None, m.get_srcComponent()):
            return self.intake.drop("other_component")
        if self.is_second(arrival_s):
            return None
        angles = (m.roll, m.pitch, m.yaw)
        if not math.isfinite(sum(angles)):
            return self.intake.drop("not_finite")
        attitude = so3.from_euler_zyx(*angles)
        resets = getattr(m, "reset_counter", 0)
        return self.intake.pose(m.usec * 1e-6, arrival_s, (m.x, m.y, m.z), attitude, resets=resets)
