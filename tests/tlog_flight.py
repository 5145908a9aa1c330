"""A made-up flight as a .tlog: a vehicle without lag that follows a circle exactly."""

import math
import struct
from collections.abc import Callable

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from links.mavlink.protocol import MavCommand, MavlinkCodec

GRAVITY = 9.81
POSE_PERIOD_S = 0.02
SENT_PERIOD_S = 0.01
HOVER = 0.4
"""Share of full thrust that carries it."""
START_US = 1_790_000_000_000_000
VEHICLE = MavlinkCodec(1, 1)
D = VEHICLE.dialect
NOTHING = [0.0] * 21


class Flight(msgspec.Struct, frozen=True, kw_only=True):
    """On the ground for 1 s, once around a circle of 1 m, on the ground for 2 s, still armed."""

    duration_s: float = 8.0
    """In the air [s]."""
    velocity_error: Vec3 = (0.0, 0.0, 0.0)
    """Added to the velocity that it says it has [m/s]; not a number: it says that it has none."""
    stamp_us: Callable[[int], int] = lambda us: us
    """The stamp of a pose that is true at a time [µs]."""
    poses: Callable[[float], bool] = lambda t: True
    """Whether the pose at a time is sent."""
    moved: Callable[[float], tuple[float, int]] = lambda t: (0.0, 0)
    """By how much the source moved its north [m], and its reset counter, at a time."""
    ground: tuple[int, int] = (255, 190)
    """System and component of the station that steers it."""
    bridge: tuple[int, int] | None = None
    """System and component of a motion-capture bridge, whose ODOMETRY is 3 m aside."""

    def motion(self, t: float) -> tuple[Vec3, Vec3, Quat, float]:
        """Position, velocity, attitude and thrust (share of full) at ``t`` [s]."""
        x = (t - 1.0) / self.duration_s
        if not 0.0 <= x < 1.0:
            return (1.0, 0.0, -1.0), (0.0, 0.0, 0.0), so3.IDENTITY, 0.2 * HOVER
        angle = math.tau * x**3 * (10.0 - 15.0 * x + 6.0 * x * x)  # starts and ends at rest
        turning = math.tau / self.duration_s * 30.0 * x * x * (1.0 - x) ** 2
        turning_dot = math.tau / self.duration_s**2 * 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
        c, s = math.cos(angle), math.sin(angle)
        # g e3 - p¨
        force = (turning_dot * s + turning**2 * c, -turning_dot * c + turning**2 * s, GRAVITY)
        length = math.hypot(*force)
        # No yaw: tilt about x and y so that R e3 points along the force.
        pitch = math.atan2(force[0], force[2])
        roll = -math.asin(force[1] / length)
        velocity, attitude = (-turning * s, turning * c, 0.0), so3.from_euler_zyx(roll, pitch, 0.0)
        return (c, s, -1.0), velocity, attitude, HOVER * length / GRAVITY

    def tlog(self) -> bytes:
        """The file."""
        return b"".join(struct.pack(">Q", START_US + us) + frame for us, frame in self.frames())

    def frames(self) -> list[tuple[int, bytes]]:
        """Each with its log time since the start [µs]."""
        ground = MavlinkCodec(*self.ground)
        bridge = None if self.bridge is None else MavlinkCodec(*self.bridge)
        end = self.duration_s + 3.0
        events: list[tuple[int, bytes]] = []
        for second in range(int(end) + 1):
            mode = 128 if second else 0
            heartbeat = D.MAVLink_heartbeat_message(2, 12, mode, 0, 4, 3)
            events.append((1_000_000 * second, VEHICLE.pack(heartbeat)))
        events.append((200_000, ground.command(1, 1, MavCommand.ARM_DISARM, 1.0)))
        acknowledgement = D.MAVLink_command_ack_message(MavCommand.ARM_DISARM, 0)
        events.append((210_000, VEHICLE.pack(acknowledgement)))
        for tenth in range(int(10 * end)):
            aground = not 10 <= tenth < 10 * (1.0 + self.duration_s)
            state = D.MAVLink_extended_sys_state_message(0, 1 if aground else 2)
            events.append((100_000 * tenth, VEHICLE.pack(state)))
        for k in range(round(end / SENT_PERIOD_S)):
            t = k * SENT_PERIOD_S
            events.append((round(1e6 * t), self._set_point(t, ground)))
        for k in range(round(end / POSE_PERIOD_S)):
            t = k * POSE_PERIOD_S
            if self.poses(t):
                events.append((round(1e6 * t) + 10_000, self._odometry(t, VEHICLE)))
            if bridge is not None:
                events.append((round(1e6 * t) + 11_000, self._odometry(t, bridge, 3.0)))
        events.sort(key=lambda event: event[0])
        return events

    def _set_point(self, t: float, ground: MavlinkCodec) -> bytes:
        *_, before, share = self.motion(t)
        after = self.motion(t + 1e-4)[2]
        turn = so3.rotation_vector(so3.multiply(so3.conjugate(before), after))
        rates = (1e4 * turn[0], 1e4 * turn[1], 1e4 * turn[2])
        if max(map(abs, rates)) > 10.0:  # take-off and landing are at once
            rates = (0.0, 0.0, 0.0)
        return ground.attitude_target(t, 1, 1, share, rates)

    def _odometry(self, t: float, sender: MavlinkCodec, aside_m: float = 0.0) -> bytes:
        (x, y, z), velocity, attitude, _ = self.motion(t)
        moved, counter = self.moved(t)
        v = [a + b for a, b in zip(velocity, self.velocity_error, strict=True)]
        stamp = self.stamp_us(round(1e6 * t))
        place, rates = (x + moved, y + aside_m, z), (0.0, 0.0, 0.0)
        message = D.MAVLink_odometry_message(
            stamp, 1, 1, *place, attitude, *v, *rates, NOTHING, NOTHING, counter, 8, 0
        )
        return sender.pack(message)
