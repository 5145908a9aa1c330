"""Uplink: do set-points reach the autopilot, and in time? TIMESYNC questions leave beside them, and
the autopilot answers each. Sans-IO.
"""

import math
from collections import deque

from links.core import NEWS_S, SILENCE_S, UPLINK_LOST_S, Arrival
from links.mavlink.protocol.codec import Message

QUESTION_S = 0.05
"""Period of the TIMESYNC questions that leave beside set-points [s]."""
SLOW_QUESTION_S = 0.1
"""Period of the same on slow serial ports [s]."""


class Uplink:
    """Arrival of our frames in time, by the answers to TIMESYNC questions.

    Times are on the event loop's clock [s].
    """

    def __init__(self, period_s: float) -> None:
        """Ask once in ``period_s`` [s] at most."""
        self._period = period_s
        self._asked: deque[int] = deque()
        """TIMESYNC.ts1 of the questions without an answer [ns]."""
        self._heard_s = -math.inf
        """Newest message of the autopilot [s]."""
        self.begin(-math.inf)

    def begin(self, now_s: float) -> None:
        """Forget the questions so far: the operator arms at ``now_s``."""
        self._asked.clear()
        self._next_s = self._since_s = now_s
        self._late_s, self._late_since_s = 0.0, math.inf
        self._answers = False

    def ask(self, now_s: float) -> int | None:
        """Return the TIMESYNC.ts1 of a question that leaves with a set-point at ``now_s`` [ns].

        None where none is due.
        """
        if now_s < self._next_s:
            return None
        self._next_s = now_s + self._period
        asked_ns = int(now_s * 1e9)
        self._asked.append(asked_ns)
        while self._asked[0] < asked_ns - NEWS_S * 1e9:
            self._asked.popleft()
        return asked_ns

    def take_message(self, message: Message, now_s: float, usual_s: float) -> None:
        """Take one message of the autopilot; a round trip usually takes ``usual_s`` [s]."""
        if now_s - self._heard_s > SILENCE_S:  # its answers so far say nothing: see arrival()
            self._since_s = now_s
        self._heard_s = now_s
        if message.get_type() != "TIMESYNC" or message.tc1 == 0 or message.ts1 not in self._asked:
            return
        while self._asked.popleft() != message.ts1:
            pass
        asked_s = message.ts1 * 1e-9
        self._since_s, self._answers = max(self._since_s, asked_s), True
        self._late_s = now_s - asked_s - usual_s
        self._late_since_s = (
            min(self._late_since_s, now_s) if self._late_s > UPLINK_LOST_S else math.inf
        )

    def arrival(self, now_s: float, usual_s: float) -> Arrival:
        """Return whether commands arrive, by the answers; ``usual_s`` is the usual round trip
        [s].
        """
        if not self._answers or now_s - self._heard_s > SILENCE_S:
            return Arrival()  # nobody can tell: the downlink may be lost
        late_s = self._late_s if now_s - self._late_since_s > SILENCE_S else 0.0
        return Arrival(max(now_s - self._since_s - usual_s - self._period, 0.0), late_s)
