"""Clocks: waiting on the event loop's, exactly and without drift; its quiet moments; and the time of day.

asyncio's own timers, on epoll(7), are up to a millisecond late; those of the loop that is made here come on time.
"""

import asyncio
import select
import selectors
import sys
import time
from collections import deque
from collections.abc import Awaitable
from typing import TypeVar

T = TypeVar("T")

CANCEL_AGAIN_S = 1.0
"""A task that has been cancelled may clean up for so long [s]."""


async def sleep_until(when_s: float) -> None:
    """Sleep until ``when_s`` on the event loop's clock [s]; give way once where that has passed."""
    loop = asyncio.get_running_loop()
    if when_s <= loop.time():
        await asyncio.sleep(0)
        return
    future: asyncio.Future[None] = loop.create_future()
    handle = loop.call_at(when_s, wake, future)
    try:
        await future
    finally:
        handle.cancel()


def wake(future: "asyncio.Future[None]") -> None:
    """Set ``future``, unless it is done."""
    if not future.done():
        future.set_result(None)


async def to_the_end(work: Awaitable[T]) -> T:
    """Await ``work`` to its end even if this task is cancelled meanwhile; the cancellation is raised after it."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError as error:
            cancelled = error
    if cancelled is not None:
        raise cancelled
    return task.result()


async def cancel_task(task: "asyncio.Task[None]") -> None:
    """Cancel ``task`` until it has ended, which nothing that it waits in can forget; what it fails with is raised.

    ``asyncio.wait_for``, ours or a library's, forgets a cancellation before Python 3.12 that comes as the wait ends.
    """
    while not task.done():
        task.cancel()
        await asyncio.wait({task}, timeout=CANCEL_AGAIN_S)
    if not task.cancelled():
        task.result()


if sys.platform == "linux":

    class PreciseSelector(selectors.EpollSelector):
        """As epoll, but waits by the microsecond.

        epoll counts its longest wait in whole milliseconds. Its own descriptor is readable when it has something to
        tell: so select(2), which counts finer, waits for that one descriptor, whatever the number of those behind it.
        """

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            """Return the ready events, after ``timeout`` [s] at most."""
            if timeout is not None and timeout > 0.0:
                select.select((self.fileno(),), (), (), timeout)
                timeout = 0.0
            return super().select(timeout)


def precise_loop() -> asyncio.AbstractEventLoop:
    """An event loop for :class:`asyncio.Runner`; elsewhere than on Linux (kqueue on macOS) asyncio's own is as fine."""
    return asyncio.SelectorEventLoop(PreciseSelector() if sys.platform == "linux" else None)


def wall_ms() -> int:
    """Time of day, since 1970 [ms]: by it two machines agree whether a request has expired."""
    return time.time_ns() // 1_000_000


WITHIN_S = 0.05
"""Where no command leaves, it is done after so long all the same [s]."""


class IdleSlots:
    """When work that can wait is done: just after a command has left, as the next pose is then farthest away.

    For one flight, or one after the other. Belongs to one event loop.
    """

    def __init__(self) -> None:
        self._waiting: deque[asyncio.Future[None]] = deque()

    def begin(self) -> None:
        """A command has just left: what has waited longest has its turn, and nothing else before the next command."""
        while self._waiting:
            moment = self._waiting.popleft()
            if not moment.done():
                wake(moment)
                return

    def moment(self) -> asyncio.Future[None]:
        """The next quiet moment that nobody has before, no later than ``WITHIN_S`` from now; await it, or cancel it."""
        loop = asyncio.get_running_loop()
        moment: asyncio.Future[None] = loop.create_future()
        timer = loop.call_later(WITHIN_S, wake, moment)
        moment.add_done_callback(lambda _: timer.cancel())
        while self._waiting and self._waiting[0].done():  # on the ground no command takes them out
            self._waiting.popleft()
        self._waiting.append(moment)
        return moment
