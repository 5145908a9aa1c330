"""Pacing: when the next command leaves: at the link's frames, or as poses come, and always before a deadline passes."""

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
