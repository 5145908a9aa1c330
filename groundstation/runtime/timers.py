"""An event loop whose timers come on time: asyncio's own, on epoll(7), are up to a millisecond late."""

import asyncio
import select
import selectors


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
