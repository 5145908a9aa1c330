"""Sends what the dead man's switch lets leave, whatever becomes of whoever commands.

It lives on timers of the event loop, not in a task: a controller that raised, waits for ever, was cancelled or no
longer ticks does not touch it. A process that stands still is told by the clock: what is due then is asked anew.
"""

import asyncio
from collections.abc import Callable

from links.core.deadman import Deadman, Phase
from links.core.port import Command, Segment

REPEAT_AFTER = 2.0
"""A command is first repeated after this many periods; before, the next one may just be late."""
MARGIN_S = 1e-6
"""So far behind the instant of a change does its turn come [s]: timers fire a clock's tick early."""


class Transmitter:
    """One link's timer. Times are on the event loop's clock [s]."""

    def __init__(self, deadman: Deadman, period_s: float, leave: Callable[[Command | Segment, float], None]) -> None:
        """``leave(what, now_s)`` puts it on the wire."""
        self._deadman = deadman
        self._period = period_s
        self._leave = leave
        self._timer: asyncio.TimerHandle | None = None
        self._due_s = 0.0
        self._loop: asyncio.AbstractEventLoop | None = None
        self._silent = asyncio.Event()
        self._silent.set()
        self.repeated = 0
        """Commands that left once more because no newer one came."""
        self.failed = 0
        """Times that nothing left because ``leave`` raised."""

    def start(self) -> None:
        """Somebody has armed: let commands count, and keep watch from now on."""
        self._deadman.arm()
        self._loop = asyncio.get_running_loop()
        self._silent.clear()
        self._due_s = self._loop.time() + self._period
        self._set()

    def stop(self) -> None:
        """Nothing that lifts from now on: killed, disarmed, or closed."""
        self._deadman.stop()
        self._end()

    def left(self, now_s: float) -> None:
        """A command has just been taken and has left."""
        self._due_s = self._next(now_s, REPEAT_AFTER * self._period)
        if self._timer is None:
            self._set()

    async def silent(self) -> None:
        """Return once nothing that lifts may leave any more without a new arming."""
        await self._silent.wait()

    def _next(self, now_s: float, wait_s: float) -> float:
        return min(now_s + wait_s, self._deadman.changes_s(now_s) + MARGIN_S)

    def _set(self) -> None:
        if self._loop is not None:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = self._loop.call_at(self._due_s, self._turn)

    def _turn(self) -> None:
        self._timer = None
        if self._loop is None:
            return
        now = self._loop.time()
        if now < self._due_s - MARGIN_S:  # a newer command has moved it
            self._set()
            return
        phase, leaves = self._deadman.phase(now), self._deadman.at(now)
        if phase is Phase.OVER:
            self._end()
            return
        self._due_s = self._next(now, self._period)
        self._set()  # before anything that may raise
        if leaves is None:
            return
        try:
            self._leave(leaves, now)
        except Exception:  # noqa: BLE001  # whatever it is, the next turn must come
            self.failed += 1
        else:
            self.repeated += phase is Phase.FRESH

    def _end(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._silent.set()
