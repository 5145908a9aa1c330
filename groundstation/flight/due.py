"""How late a command is: for its link's frame, or where commands follow the poses, after its pose. Sans-IO."""

from links.core.port import CommandLink


class Due:
    """When the next frame is due; a late one is skipped, never made up for (pacing.py has the same rule)."""

    def __init__(self, link: CommandLink) -> None:
        """Nothing is asked of ``link`` before the first command: some tell their period only once connected."""
        self._link = link
        self._due_s: float | None = None
        self._pose_id: int | None = None

    def begin(self) -> None:
        """The next command is the first."""
        self._due_s = None

    def late_s(self, now_s: float, pose_id: int, arrival_s: float) -> float | None:
        """How late the command of this instant is [s]; None for one in between, that is no frame's and no new pose's.

        It rests on the pose ``pose_id``, which came at ``arrival_s`` [s].
        """
        if not self._link.follows_poses:
            return self._late_for_frame(now_s, self._link.period_s)
        new, self._pose_id = pose_id != self._pose_id, pose_id
        return now_s - arrival_s if new else None

    def _late_for_frame(self, now_s: float, period_s: float) -> float | None:
        if self._due_s is None:
            self._due_s = now_s
        late = now_s - self._due_s
        if late < -0.5 * period_s:
            return None
        self._due_s += period_s
        if self._due_s < now_s:
            self._due_s = now_s + period_s
        return late
