"""When a stand-by may believe that its pacer stands still. Sans-IO."""

LOOK_S = 0.01
"""Time between a look that finds the sign of life too old and the next [s]."""
LATE_S = 0.005
"""A look that comes later than this after its instant says nothing: the watcher itself may have stood still [s]."""
OLD_S = 0.06
"""A sign of life older than this is too old [s]; where frames are far apart, than one and a half periods."""


class Watch:
    """Two looks in a row, both in time and :data:`LOOK_S` apart, must find the sign of life too old."""

    def __init__(self, period_s: float) -> None:
        """The sign comes every ``period_s`` [s]."""
        self._old_s = max(OLD_S, 1.5 * period_s)
        self.wait_s = self._old_s + 0.5 * period_s
        """How long after a sign of life it is looked for the next [s]: half-way between two frames, which no look then
        delays."""
        self._suspects = False
        self.next_s = 0.0
        """When to look next."""

    def look(self, now_s: float, vouched_s: float) -> bool:
        """Look at ``now_s`` at a sign of life that was good at ``vouched_s``; whether the pacer stands still."""
        late = now_s > self.next_s + LATE_S
        old = vouched_s > 0.0 and now_s - vouched_s >= self._old_s
        convicted = old and not late and self._suspects
        self._suspects = old and not late
        fresh = vouched_s > 0.0 and not old and not late
        # A pacer may vouch in advance for what takes long, and then be done with it earlier.
        self.next_s = min(vouched_s, now_s) + self.wait_s if fresh else now_s + LOOK_S
        return convicted
