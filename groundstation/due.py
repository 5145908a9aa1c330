"""How late a command is, of a link whose frames come in equal steps. Sans-IO."""


class Due:
    """When the next frame is due; a late one is skipped, never made up for (pacing.py has the same rule)."""

    def __init__(self, period_s: float) -> None:
        """``period_s``: from frame to frame [s]; 0 where commands follow the poses, and none is ever late."""
        self._period = period_s
        self.follows_poses = period_s <= 0.0
        """True where there are no frames."""
        self._due_s: float | None = None

    def begin(self) -> None:
        """The next command is the first."""
        self._due_s = None

    def late_s(self, now_s: float) -> float | None:
        """How late the command of this instant is [s]; None for one in between, that is no frame's."""
        if self.follows_poses:
            return None
        if self._due_s is None:
            self._due_s = now_s
        late = now_s - self._due_s
        if late < -0.5 * self._period:
            return None
        self._due_s += self._period
        if self._due_s < now_s:
            self._due_s = now_s + self._period
        return late
