"""Clocks: waiting on the event loop's clock, exactly and without drift.

Its idle moments; and the time of day.

asyncio's own timers, on epoll(7), are up to a millisecond late; those of the loop that is made here
are punctual.
"""

import asyncio
import os
import select
import selectors
import sys
import time
from collections import deque
from collections.abc import Awaitable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

CANCEL_AGAIN_S = 1.0
"""Time after which a cancelled task that has not ended is cancelled again [s]."""


async def sleep_until(when_s: float) -> None:
    """Sleep until ``when_s`` on the event loop's clock [s].

    If that has passed, let others run once.
    """
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
    """Await ``work`` to its end even if this task is cancelled meanwhile.

    The cancellation is raised after it.
    """
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


async def wait_at_most(work: Awaitable[object], within_s: float | None) -> None:
    """Await ``work``, for ``within_s`` at most [s]; None for as long as it takes."""
    with suppress(TimeoutError):
        async with asyncio.timeout(within_s):
            await work


async def cancel_task(task: "asyncio.Task[None]") -> None:
    """Cancel ``task`` again and again until it has ended, and raise its exception.

    Before Python 3.12 ``asyncio.wait_for``, ours or a library's, loses a cancellation at the end of
    its wait.
    """
    while not task.done():
        task.cancel()
        await asyncio.wait({task}, timeout=CANCEL_AGAIN_S)
    if not task.cancelled():
        task.result()


if sys.platform == "linux":

    class PreciseSelector(selectors.EpollSelector):
        """As epoll, but waits by the microsecond.

        The timeout of epoll is in whole milliseconds. Its own descriptor is readable when it has an
        event: so select(2), whose timeout is finer, waits for that one descriptor, whatever the
        number of those behind it.
        """

        def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
            """Return the ready events, after ``timeout`` [s] at most."""
            if timeout is not None and timeout > 0.0:
                select.select((self.fileno(),), (), (), timeout)
                timeout = 0.0
            return super().select(timeout)


def precise_loop() -> asyncio.AbstractEventLoop:
    """Make an event loop for :class:`asyncio.Runner`.

    Outside of Linux (kqueue on macOS) asyncio's own is precise.
    """
    return asyncio.SelectorEventLoop(PreciseSelector() if sys.platform == "linux" else None)


def wall_ms() -> int:
    """Return the time of day, since 1970 [ms]: by it two machines see whether a request expired."""
    return time.time_ns() // 1_000_000


NICE = 5
"""Nice value of programs beside a flight (nice(2)): a key still gets through on a busy machine."""
WITHIN_S = 0.05
"""Longest wait for an idle slot while no command leaves [s]."""


class IdleSlots:
    """Slots for work that can wait: just after a command has left, farthest from the next pose.

    For one flight, or one after the other, on one event loop.
    """

    def __init__(self) -> None:
        self._waiting: deque[asyncio.Future[None]] = deque()

    def begin(self) -> None:
        """A command has just left: begin the oldest waiting slot, one a command."""
        while self._waiting:
            moment = self._waiting.popleft()
            if not moment.done():
                moment.set_result(None)
                return

    def moment(self) -> asyncio.Future[None]:
        """Return the next free slot, no later than ``WITHIN_S`` from now.

        Await it, or cancel it.
        """
        loop = asyncio.get_running_loop()
        moment: asyncio.Future[None] = loop.create_future()
        timer = loop.call_later(WITHIN_S, wake, moment)
        moment.add_done_callback(lambda _: timer.cancel())
        while self._waiting and self._waiting[0].done():  # on the ground no command takes them out
            self._waiting.popleft()
        self._waiting.append(moment)
        return moment


def uptime_s() -> float:
    """Time since the start of the machine, whether it slept or not [s]."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def begin_of_process_s() -> float:
    """Time from the start of the machine to that of this process, by proc_pid_stat(5) [s]."""
    behind_name = Path("/proc/self/stat").read_text("utf-8").rpartition(")")[2].split()
    return int(behind_name[19]) / os.sysconf("SC_CLK_TCK")
