"""Event loop's clock: waiting until an instant of it, exactly and without drift, and to an end, come what may.

asyncio's own timers, on epoll(7), are up to a millisecond late; those of the loop that is made here come on time.
"""

import asyncio
import select
import selectors
from collections.abc import Awaitable
from typing import TypeVar

T = TypeVar("T")


async def sleep_until(when_s: float) -> None:
    """Sleep until ``when_s`` on the event loop's clock [s]; give way once where that has passed."""
    loop = asyncio.get_running_loop()
    if when_s <= loop.time():
        await asyncio.sleep(0)
        return
    future: asyncio.Future[None] = loop.create_future()
    handle = loop.call_at(when_s, _wake, future)
    try:
        await future
    finally:
        handle.cancel()


def _wake(future: "asyncio.Future[None]") -> None:
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


class PreciseSelector(selectors.EpollSelector):
    """As epoll, but waits by the microsecond.

    epoll counts its longest wait in whole milliseconds. Its own descriptor is readable when it has something to tell:
    so select(2), which counts finer, waits for that one descriptor, whatever the number of those behind it.
    """

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """What is ready, after ``timeout`` [s] at most."""
        if timeout is not None and timeout > 0.0:
            select.select((self.fileno(),), (), (), timeout)
            timeout = 0.0
        return super().select(timeout)


def precise_loop() -> asyncio.AbstractEventLoop:
    """An event loop for :class:`asyncio.Runner`."""
    return asyncio.SelectorEventLoop(PreciseSelector())
