"""The autopilot's own attitude and body rates out of its messages. Sans-IO.

ATTITUDE_QUATERNION and ATTITUDE both are FRD to NED with body rates, stamped by milliseconds since boot.
Source: message definitions of pymavlink 2.4.50; the stamp and TIMESYNC count from one zero on PX4 1.16 and
ArduCopter 4.8-dev.
"""

import math

from links.core import Attitude
from links.mavlink.protocol.codec import Message
from links.mavlink.protocol.timesync import Trip

ATTITUDES = ("ATTITUDE_QUATERNION", "ATTITUDE")
"""The messages that tell it; the first is tried first."""
ATTITUDE_HZ = 50.0
"""How often it is asked for: 2 kB a second [1/s]."""
SLOW_BAUD, SLOW_HZ = 115_200, 12.5
"""Serial ports up to that speed [bit/s] may lead to a telemetry radio; there it comes so often [1/s]."""
EARLY_S, LATE_S = 0.1, 1.0
"""A stamp further before or after its arrival comes from another clock than TIMESYNC's [s]."""
_UNIT = 0.01
"""A quaternion whose squared length is farther from one is none."""


def attitude_of(message: Message, arrival_s: float, clock: Trip | None) -> Attitude | None:
    """What ``message``, which arrived at ``arrival_s`` [s, our clock], tells; None where that is nothing.

    ``clock`` is the autopilot's against ours. Without it, or where the stamp contradicts it, the arrival is the time.
    """
    match message.get_type():
        case "ATTITUDE_QUATERNION":
            q = (message.q1, message.q2, message.q3, message.q4)
        case "ATTITUDE" if math.isfinite(message.roll + message.pitch + message.yaw):
            q = _quaternion(message.roll, message.pitch, message.yaw)
        case _:
            return None
    rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
    w, x, y, z = q
    n = w * w + x * x + y * y + z * z
    if not (abs(n - 1.0) < _UNIT and math.isfinite(sum(rates))):  # not a number is never less
        return None
    time_s = arrival_s
    if clock is not None:
        stamp_s = message.time_boot_ms * 1e-3 - clock.offset_s
        if -EARLY_S < arrival_s - stamp_s < LATE_S:
            time_s = stamp_s
    return Attitude(time_s, q, rates)


def _quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Of angles [rad] about z, then y, then x."""
    cr, sr, cp, sp = math.cos(0.5 * roll), math.sin(0.5 * roll), math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
