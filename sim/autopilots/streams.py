"""The telemetry of a simulated autopilot: which message is due when, and what is in it. Sans-IO."""

import math
from collections.abc import Callable, Mapping

from links.mavlink.protocol import MavlinkCodec, Message
from sim.world import Airframe

LOCAL_NED = 1
"""MAV_FRAME_LOCAL_NED: PX4 sends position and, unlike most, also velocity in it."""
ESTIMATOR_AUTOPILOT = 8
"""MAV_ESTIMATOR_TYPE_AUTOPILOT."""

KNOWN, STILL = 831, 167
"""Flags of ESTIMATOR_STATUS and EKF_STATUS_REPORT of a real autopilot with GPS, and of one that has none: it takes its
position as constant."""
SAME_INSTANT_S = 1e-9
"""A timer may fire this much early [s]."""
SHORTEST_S = 0.001
"""Nothing is sent more often [s]."""

_TEXT_BYTES = 50
_UNKNOWN = (math.nan,) * 21


class Streams:
    """When each message is due; intervals change by SET_MESSAGE_INTERVAL."""

    def __init__(self, rates_hz: Mapping[int, float], start_s: float) -> None:
        """Messages by number with their default rates [Hz] (0: off), the first of each at ``start_s`` [s]."""
        self._defaults = {number: 1.0 / rate if rate else math.inf for number, rate in rates_hz.items()}
        self._intervals = dict(self._defaults)
        self._due = {number: start_s for number, interval in self._intervals.items() if interval < math.inf}
        self.next_due_s = start_s if self._due else math.inf
        """When the next message is due [s]."""

    def set(self, number: int, interval_us: float, now_s: float) -> bool:
        """Send message ``number`` every ``interval_us`` from ``now_s`` on; -1 stops it, 0 is its default.

        Returns False where there is no such message.
        """
        if number not in self._defaults or not math.isfinite(interval_us):
            return False
        if interval_us == 0.0:
            interval = self._defaults[number]
        else:
            interval = max(interval_us * 1e-6, SHORTEST_S) if interval_us > 0.0 else math.inf
        self._intervals[number] = interval
        self._due.pop(number, None)
        if interval < math.inf:
            self._due[number] = now_s
        self.next_due_s = min(self._due.values(), default=math.inf)
        return True

    def take(self, now_s: float) -> list[int]:
        """The messages that are due at ``now_s``; each is then due again one interval later."""
        limit = now_s + SAME_INSTANT_S
        if self.next_due_s > limit:
            return []
        numbers = [number for number, due in self._due.items() if due <= limit]
        for number in numbers:
            due = self._due[number] + self._intervals[number]
            self._due[number] = due if due > limit else now_s + self._intervals[number]
        self.next_due_s = min(self._due.values())
        return numbers


def builders(
    codec: MavlinkCodec, airframe: Airframe, own_estimate: bool
) -> dict[int, Callable[[float, float], Message]]:
    """For each message number that tells of the vehicle's motion: (now, time since boot) [s] → message."""
    d = codec.dialect
    flags = KNOWN if own_estimate else STILL
    odometry_message, timesync_message = d.MAVLink_odometry_message, d.MAVLink_timesync_message
    local_position_ned_message = d.MAVLink_local_position_ned_message
    attitude_quaternion_message = d.MAVLink_attitude_quaternion_message
    estimator_status_message, ekf_status_report_message = (
        d.MAVLink_estimator_status_message,
        d.MAVLink_ekf_status_report_message,
    )

    def odometry(now_s: float, boot_s: float) -> Message:
        seen = airframe.measured(now_s)
        return odometry_message(
            int(boot_s * 1e6), LOCAL_NED, LOCAL_NED, *seen.position_ned, seen.attitude, *seen.velocity_ned,
            *seen.rates_rad_s, _UNKNOWN, _UNKNOWN, seen.resets, ESTIMATOR_AUTOPILOT, 0,
        )  # fmt: skip

    def local_position(now_s: float, boot_s: float) -> Message:
        seen = airframe.measured(now_s)
        return local_position_ned_message(int(boot_s * 1e3), *seen.position_ned, *seen.velocity_ned)

    def attitude(now_s: float, boot_s: float) -> Message:
        turned, rates = airframe.felt(now_s)
        return attitude_quaternion_message(int(boot_s * 1e3), *turned, *rates)

    def timesync(now_s: float, boot_s: float) -> Message:
        return timesync_message(0, int(boot_s * 1e9))

    def px4_estimator(now_s: float, boot_s: float) -> Message:
        ratios = (0.1, 0.1, 0.1, 0.1, 0.0, 0.0)
        return estimator_status_message(int(boot_s * 1e6), flags, *ratios, 0.1, 0.1)

    def ardupilot_estimator(now_s: float, boot_s: float) -> Message:
        return ekf_status_report_message(flags, 0.1, 0.1, 0.1, 0.1, 0.0)

    return {
        d.MAVLINK_MSG_ID_ESTIMATOR_STATUS: px4_estimator,
        d.MAVLINK_MSG_ID_EKF_STATUS_REPORT: ardupilot_estimator,
        d.MAVLINK_MSG_ID_ODOMETRY: odometry,
        d.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position,
        d.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: attitude,
        d.MAVLINK_MSG_ID_TIMESYNC: timesync,
    }


def statustext(codec: MavlinkCodec, number: int, severity: int, text: str) -> list[Message]:
    """The ``number``-th STATUSTEXT; a ``text`` that does not fit comes in numbered pieces."""
    pieces = [text[i : i + _TEXT_BYTES] for i in range(0, len(text), _TEXT_BYTES)]
    message = codec.dialect.MAVLink_statustext_message
    return [message(severity, piece.encode("ascii"), number & 0xFFFF, n) for n, piece in enumerate(pieces)]
