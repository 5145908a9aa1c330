"""A flight in virtual time whose loop also serves real sockets, pipes and threads, and yet flies
the same each time.

What comes from outside comes at any turn of the loop, and never at an instant of its own: virtual
time stands still meanwhile. What it sets off runs between the flight's own callbacks, and leaves
their order and their instants alone, which takes more than :class:`VirtualTimeLoop` promises:
timers of one instant run in the order in which they were made, time goes exactly to each of them,
and two that are a nanosecond apart are two.
"""

import math
import selectors
import time
from asyncio import TimerHandle
from collections.abc import Callable
from contextvars import Context
from heapq import heappush
from typing import Any

from sim.time import VirtualTimeLoop
from sim.time.virtual_time import SimulationStuck

OUTSIDE_S = 20.0
"""Longest wait for something from outside where nothing is scheduled, in real time [s]."""


class _Timer(TimerHandle):
    __slots__ = ("number",)
    number: int

    def __lt__(self, other: Any) -> bool:
        return (self._when, self.number) < (other._when, other.number)  # type: ignore[attr-defined]  # asyncio's own


class _Open(selectors.BaseSelector):
    """Watches what is real, without waiting unless virtual time would run ahead of its pace."""

    def __init__(self, next_s: Callable[[], float]) -> None:
        super().__init__()
        self.now = 0.0
        self.pace = math.inf
        self._next_s = next_s
        self._real = selectors.DefaultSelector()
        self._went_s = time.monotonic()

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._real.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._real.unregister(fileobj)

    def get_map(self) -> Any:
        return self._real.get_map()

    def close(self) -> None:
        self._real.close()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            if not (came := self._real.select(OUTSIDE_S)):
                raise SimulationStuck(
                    "the simulation is stuck: nothing is scheduled, and nothing comes from outside"
                )
            return came
        if (came := self._real.select(0.0)) or timeout == 0.0:
            return came
        due_s = self._went_s + timeout / self.pace
        while (wait_s := due_s - time.monotonic()) > 0.0:
            if came := self._real.select(wait_s):
                return came
        self._went_s = time.monotonic()
        self.now = self._next_s()
        return []


class OpenLoop(VirtualTimeLoop):
    """Serves what is outside, too; see above."""

    _selector: selectors.BaseSelector  # asyncio's own, as the next, of which typeshed does not tell
    _scheduled: list[TimerHandle]

    def __init__(self) -> None:
        super().__init__()
        self._open = _Open(self._next_s)
        for key in list(self._selector.get_map().values()):  # what asyncio wakes itself by
            self._open.register(key.fileobj, key.events, key.data)
        self._selector = self._open
        self._timers = 0
        self._clock_resolution = math.ulp(0.0)

    def time(self) -> float:
        """Virtual time [s]."""
        return self._open.now

    @property
    def pace(self) -> float:
        """At most so many seconds pass here in a real one."""
        return self._open.pace

    @pace.setter
    def pace(self, pace: float) -> None:
        self._open.pace = pace

    def _next_s(self) -> float:
        when: float = self._scheduled[0]._when  # type: ignore[attr-defined]  # asyncio's own
        self._clock_resolution = math.ulp(when)
        return when

    def call_at(  # type: ignore[override]  # its own way to say the same
        self,
        when: float,
        callback: Callable[..., object],
        *args: Any,
        context: Context | None = None,
    ) -> TimerHandle:
        timer = _Timer(when, callback, args, self, context)
        self._timers += 1
        timer.number = self._timers
        timer._scheduled = True  # type: ignore[attr-defined]  # as asyncio does
        heappush(self._scheduled, timer)
        return timer

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:  # noqa: ASYNC109  # asyncio's own
        """Join the threads, not within a virtual time, which would end before they do."""
        await super().shutdown_default_executor()
