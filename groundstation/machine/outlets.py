"""Outlets that never block: lines to a file descriptor, and a value to any number of readers.

A line that is not accepted at once is lost, and counted. Quoted text can neither break the line nor
control the terminal. A stopped terminal (Ctrl-S), a full pipe or a closed one delays nothing, least
of all a command.

Of a broadcast value only the newest is kept, without a queue: a slow reader misses values and
delays nobody.
"""

import asyncio
import locale
import os
import select
import stat
from collections.abc import AsyncIterator, Callable
from typing import Generic, TypeVar

from links.text import printable


class NonBlockingWriter:
    """A file descriptor, written to without waiting."""

    def __init__(
        self,
        number: int,
        describe_lost: Callable[[int], str] = "{} lines were lost: nobody read them".format,
    ) -> None:
        """Write to ``number``, whose flags are not changed, in the encoding of this locale.

        ``describe_lost`` is the line that tells how many were lost before.
        """
        self._describe_lost = describe_lost
        self._number = _own(number)
        self._encoding = locale.getencoding()
        self._rest = b""
        self.lost = 0
        """Number of lines lost since the last accepted one."""

    def say(self, text: str) -> None:
        """Write ``text`` as one line, after the number of lines lost before it."""
        if self.lost and self.write(self._describe_lost(self.lost)):
            self.lost = 0
        if not self.write(text):
            self.lost += 1

    def write(self, text: str) -> bool:
        """Write ``text`` as one line; return whether it was accepted at once.

        A longer line than a pipe accepts at once or not at all is cut (pipe(7), PIPE_BUF).
        """
        line = (
            printable(text.rstrip("\n")).encode(self._encoding, "replace")[: select.PIPE_BUF - 1]
            + b"\n"
        )
        try:
            if self._rest:
                self._rest = self._rest[self._write_now(self._rest) :]
            if self._rest:
                return False
            taken = self._write_now(line)
        except OSError:
            return False
        self._rest = line[taken:] if taken else b""  # a line that was cut is ended before the next
        return taken > 0

    def _write_now(self, data: bytes) -> int:
        poll = select.poll()
        poll.register(self._number, select.POLLOUT)
        events = poll.poll(0)
        if not events or not events[0][1] & select.POLLOUT:
            return 0
        try:
            return os.write(self._number, data)
        except BlockingIOError:
            return 0


def _own(number: int) -> int:
    """Open a nonblocking descriptor of our own: a flag of the shared one would affect the shell."""
    try:
        if stat.S_ISREG(os.fstat(number).st_mode):
            return number  # a file accepts everything, and its offset is shared
        return os.open(
            f"/proc/self/fd/{number}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
        )
    except OSError:
        return number  # a socket, or no descriptor at all: it is polled before each line


T = TypeVar("T")


class Latest(Generic[T]):
    """One value on one event loop.

    ``put`` never waits, and costs the same for any number of readers.
    """

    newest: tuple[int, T] | None = None
    """Running number (from 1) and value of the newest; None before the first."""
    _waiting: "asyncio.Future[None] | None" = None

    def put(self, value: T) -> None:
        """Replace the value and wake its readers."""
        self.newest = (1 if self.newest is None else self.newest[0] + 1, value)
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set_result(None)

    async def newer(self, number: int = 0) -> tuple[int, T]:
        """Return the newest value and its number, once it is above ``number``."""
        while self.newest is None or self.newest[0] <= number:
            if self._waiting is None:
                self._waiting = asyncio.get_running_loop().create_future()
            # All readers share it: one that is cancelled must not cancel it.
            await asyncio.shield(self._waiting)
        return self.newest

    async def values(self, period_s: float = 0.0) -> AsyncIterator[T]:
        """Yield the newest value, then each newer one, never two within ``period_s`` [s]."""
        number = 0
        while True:
            number, value = await self.newer(number)
            yield value
            await asyncio.sleep(period_s)
