"""Time (TIMESYNC) and attitude of an autopilot, on our clock. Sans-IO.

We send our time; it comes back with the autopilot's. The autopilot's time is taken for that of the
middle of the round trip, and the shorter the trip, the better: of the newest trips the shortest
counts. ATTITUDE_QUATERNION and ATTITUDE both are FRD to NED with body rates,
stamped by milliseconds since boot. Source: mavlink.io/en/services/timesync.html; the minimum filter
as in NTP (RFC 5905, section 10); message definitions of pymavlink 2.4.50; the stamp and TIMESYNC
count from one zero on PX4 1.16 and ArduCopter 4.8-dev.
"""

import math
from collections import deque
from typing import NamedTuple

from links.core import UNIT_TOLERANCE, Attitude, from_euler_zyx
from links.mavlink.protocol.codec import Message

TRIPS_KEPT = 16
"""Number of round trips among which the shortest counts [-]. Chosen: 16 s of heartbeats."""
LONGEST_TRAVEL_S = 1.0
"""Longest travel time of a message [s]: a later answer is ignored, and an older stamp is of another
clock than TIMESYNC's."""


class RoundTrip(NamedTuple):
    """One question and its answer."""

    rtt_s: float
    """Round-trip time from question to answer [s]."""
    offset_s: float
    """The autopilot's clock less ours [s], wrong by at most half of ``rtt_s``."""


class Timesync:
    """Difference of the autopilot's clock from ours, by our questions and their answers."""

    def __init__(self) -> None:
        self._trips: deque[RoundTrip] = deque(maxlen=TRIPS_KEPT)
        self._asked_ns = 0
        self.best: RoundTrip | None = None
        """The shortest of the newest trips; None before the first answer."""

    def ask(self, now_s: float) -> int:
        """Return TIMESYNC.ts1 of a question that leaves at ``now_s`` [ns]."""
        self._asked_ns = max(int(now_s * 1e9), self._asked_ns + 1)
        return self._asked_ns

    def take_answer(self, theirs_ns: int, ours_ns: int, now_s: float) -> bool:
        """Take an answer (TIMESYNC.tc1, .ts1) that arrived at ``now_s`` [s].

        Return whether it is to our newest question.
        """
        rtt_s = now_s - ours_ns * 1e-9
        if (
            ours_ns != self._asked_ns
            or theirs_ns <= 0
            or not 0.0 <= rtt_s + 1e-9 <= LONGEST_TRAVEL_S
        ):
            return False
        self._asked_ns += 1  # answered once
        rtt_s = max(rtt_s, 0.0)
        self._trips.append(RoundTrip(rtt_s, theirs_ns * 1e-9 - (now_s - 0.5 * rtt_s)))
        self.best = min(self._trips)
        return True

    @property
    def newest(self) -> RoundTrip | None:
        """The newest trip; None before the first answer."""
        return self._trips[-1] if self._trips else None


ATTITUDES = ("ATTITUDE_QUATERNION", "ATTITUDE")
"""Messages with the attitude, in the order in which they are requested."""
ATTITUDE_HZ = 50.0
"""Requested attitude rate [1/s]: 2 kB a second."""
SLOW_BAUD = 115_200
"""Largest speed of a serial port that may lead to a telemetry radio [bit/s]."""
SLOW_HZ = 12.5
"""Requested attitude rate on such a port [1/s]: a quarter."""
EARLY_S = 0.1
"""Lead of a stamp over its arrival from which it is of another clock than TIMESYNC's [s].
Chosen."""


def attitude_of(message: Message, arrival_s: float, clock: RoundTrip | None) -> Attitude | None:
    """Return the attitude in ``message``; None where it has none.

    It arrived at ``arrival_s`` [s, our clock]. ``clock`` is the autopilot's against ours. Without
    it, or where the stamp contradicts it, the arrival is the time.
    """
    match message.get_type():
        case "ATTITUDE_QUATERNION":
            q = (message.q1, message.q2, message.q3, message.q4)
        case "ATTITUDE":
            angles = (message.roll, message.pitch, message.yaw)
            if not math.isfinite(sum(angles)):
                return None
            q = from_euler_zyx(*angles)
        case _:
            return None
    rates = (message.rollspeed, message.pitchspeed, message.yawspeed)
    is_unit = abs(math.hypot(*q) - 1.0) < UNIT_TOLERANCE  # not a number is never less
    if not (is_unit and math.isfinite(sum(rates))):
        return None
    time_s = arrival_s
    if clock is not None:
        stamp_s = message.time_boot_ms * 1e-3 - clock.offset_s
        if -EARLY_S < arrival_s - stamp_s < LONGEST_TRAVEL_S:
            time_s = stamp_s
    return Attitude(time_s, q, rates)
