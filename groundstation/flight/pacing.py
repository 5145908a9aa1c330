"""Pacing: when the next command leaves, and how late it is. Sans-IO.

It leaves at the link's frames, or as poses come, and always before a deadline passes. So it is late for its link's
frame, or, where commands follow the poses, after its pose.
"""

import asyncio
import math

from links.core import CommandLink

LAST_CHANCE_S = 0.004
"""So long before a command's deadline does the next one leave [s]."""

AT_ONCE_S = 1e-6
"""Timers fire a clock's tick early: an instant nearer than this has come [s], or in virtual time it never would."""


class Pacing:
    """One link's frames. Times are on the event loop's clock [s].

    A command leaves every period; or, where the link follows poses, as soon as a pose has come (but not within half a
    period of the last one), and one and a half periods after the last one where none came. In both cases one more
    leaves just before the last one's deadline: a gap between poses must not seem longer than it is by waiting for the
    next frame, and where it is too long, what is flown without a pose begins then.
    """

    def __init__(self, link: CommandLink) -> None:
        """Nothing leaves before :meth:`begin`."""
        self._link = link
        self._frame_s = 0.0
        self._waiting: asyncio.Future[None] | None = None
        self._from_s = 0.0

    def begin(self) -> None:
        """The first frame is now."""
        self._frame_s = asyncio.get_running_loop().time()

    async def next(self, left_s: float, deadline_s: float) -> None:
        """Wait for the next frame; the last command left at ``left_s``, and its deadline is ``deadline_s``."""
        period, chance = self._link.period_s, deadline_s - LAST_CHANCE_S
        if chance <= left_s + AT_ONCE_S:
            chance = math.inf  # it is taken
        if self._link.follows_poses:
            await self._pose(min(left_s + 0.5 * period, chance), min(left_s + 1.5 * period, chance))
            return
        if left_s > self._frame_s - 0.5 * period:  # else it left early, and this frame is still to come
            self._frame_s += period
        if self._frame_s < left_s:  # late frames are left out; the rest keep their distance to the link's own
            self._frame_s += math.ceil((left_s - self._frame_s) / period) * period
        await self._pose(min(chance, self._frame_s), min(chance, self._frame_s))

    def pose(self, arrival_s: float) -> None:
        """A pose has come."""
        if self._waiting is None:
            return
        if arrival_s >= self._from_s:
            _wake(self._waiting)
        else:
            asyncio.get_running_loop().call_at(self._from_s, _wake, self._waiting)

    async def _pose(self, from_s: float, until_s: float) -> None:
        """Wait for a pose, but not past ``until_s``; one that comes before ``from_s`` counts at that instant."""
        loop = asyncio.get_running_loop()
        self._waiting, self._from_s = loop.create_future(), from_s
        timer = loop.call_at(until_s, _wake, self._waiting)
        try:
            await self._waiting
        finally:
            timer.cancel()
            self._waiting = None


def _wake(waiting: "asyncio.Future[None]") -> None:
    if not waiting.done():
        waiting.set_result(None)


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
