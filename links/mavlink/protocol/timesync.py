"""How far the autopilot's clock is from ours, by asking it the time (TIMESYNC). Sans-IO.

We send our time; it comes back with the autopilot's time in between. Half-way is the best guess for when that was,
and the shorter the round trip, the better the guess: so the one with the shortest of the newest trips counts.
Source: mavlink.io/en/services/timesync.html; the minimum filter as in NTP (RFC 5905, section 10).
"""

from collections import deque
from typing import NamedTuple

NEWEST = 16
"""Round trips remembered."""
LONGEST_S = 1.0
"""An answer that takes longer answers nothing any more [s]."""


class Trip(NamedTuple):
    """One question and its answer."""

    rtt_s: float
    """From the question's leaving to the answer's arrival [s]."""
    offset_s: float
    """The autopilot's clock less ours [s], wrong by at most half of ``rtt_s``."""


class Timesync:
    """Our questions, and what follows from the answers."""

    def __init__(self) -> None:
        """Nothing known."""
        self._trips: deque[Trip] = deque(maxlen=NEWEST)
        self._asked_ns = 0
        self.best: Trip | None = None
        """The shortest of the newest trips; None before the first answer."""

    def ask(self, now_s: float) -> int:
        """The time to send in a question (TIMESYNC.ts1) that leaves at ``now_s`` [ns]."""
        self._asked_ns = max(int(now_s * 1e9), self._asked_ns + 1)
        return self._asked_ns

    def answered(self, theirs_ns: int, ours_ns: int, now_s: float) -> bool:
        """Take an answer (TIMESYNC.tc1, .ts1) that arrived at ``now_s`` [s]; False where it is not to our question."""
        rtt_s = now_s - ours_ns * 1e-9
        if ours_ns != self._asked_ns or theirs_ns <= 0 or not 0.0 <= rtt_s + 1e-9 <= LONGEST_S:
            return False
        self._asked_ns += 1  # answered once
        rtt_s = max(rtt_s, 0.0)
        self._trips.append(Trip(rtt_s, theirs_ns * 1e-9 - (now_s - 0.5 * rtt_s)))
        self.best = min(self._trips)
        return True

    @property
    def newest(self) -> Trip | None:
        """The newest trip; None before the first answer."""
        return self._trips[-1] if self._trips else None
