"""A source's own time stamps on our clock, without any exchange of clocks. Sans-IO.

A message can only arrive late, never early: the smallest difference between arrival and stamp seen so far tells
where the source's zero lies on our clock, and a message that was held up still gets the time that it is true for.
The minimum slowly forgets, so that it follows clocks that drift apart: simulated autopilots by 1 % and more,
real ones by some 10 µs a second.
"""

CREEP = 0.01
"""The offset may rise by this share of the time that passes, whatever arrives."""
FORGET_S = 1.0
"""Above that it approaches later arrivals with this time constant [s]."""
RESTART_S = 1.0
"""A source that sends only old stamps for this long has started its clock anew [s]."""


class SourceClock:
    """The clock of one source."""

    def __init__(self) -> None:
        """Nothing seen yet."""
        self.restarts = 0
        """How often the source's clock began anew."""
        self._stamp_s: float | None = None
        self._offset_s = 0.0
        self._old_since_s: float | None = None

    def stale(self, stamp_s: float, arrival_s: float) -> str:
        """Why a message stamped ``stamp_s`` [s, source] must be dropped; an empty string where it must not.

        ``duplicate`` or ``out_of_order``; ``arrival_s`` is on our clock [s].
        """
        if self._stamp_s is None or stamp_s > self._stamp_s:
            return ""
        if stamp_s == self._stamp_s:
            return "duplicate"
        if self._old_since_s is None:
            self._old_since_s = arrival_s
        if arrival_s - self._old_since_s <= RESTART_S:
            return "out_of_order"
        self._stamp_s = None
        self.restarts += 1
        return ""

    def time_s(self, stamp_s: float, arrival_s: float) -> float:
        """When a message that is not stale left its source [s, our clock]: ``arrival_s`` or earlier."""
        offset = arrival_s - stamp_s
        if self._stamp_s is not None:
            late = offset - self._offset_s
            if late > 0.0:
                elapsed = stamp_s - self._stamp_s
                offset = min(offset, self._offset_s + elapsed * (CREEP + late / FORGET_S))
        self._stamp_s, self._offset_s, self._old_since_s = stamp_s, offset, None
        return stamp_s + offset
