"""Whose turn it is to write to a port, and signs of life: a page of memory that a pacer and its stand-by share.

    byte 0        generation: number of the process whose turn it is to write, 1 for the pacer
    byte 8        instant up to which the pacer vouches that it lives [ns]; 0 before its first frame
    byte 16       the same of its stand-by

Each word is written by one process at a time and by one store. A generation only rises; whoever writes to the port
looks at it immediately before, and one that is not its own ends it.
"""

import mmap
import os

PACER, STANDBY = 1, 2
"""Words of those who live."""
FIRST = 1
"""The pacer's generation; whoever takes over has the next."""


class Superseded(Exception):
    """Another process writes now."""


class Lease:
    """One end; whoever makes it hands ``fd`` to the other process. Times are on one clock, the commands' [s]."""

    def __init__(self, fd: int | None = None) -> None:
        """Map the memory behind ``fd``, or make it.

        Raises:
            OSError: there is none.
        """
        self.fd = os.memfd_create("lease") if fd is None else fd
        """File descriptor of the memory."""
        if fd is None:
            os.ftruncate(self.fd, mmap.PAGESIZE)
        self._words = memoryview(mmap.mmap(self.fd, mmap.PAGESIZE)).cast("Q")
        if fd is None:
            self._words[0] = FIRST

    def ensure(self, generation: int) -> None:
        """Go on only if it is the turn of ``generation``.

        Raises:
            Superseded: it is not.
        """
        if self._words[0] != generation:
            raise Superseded

    @property
    def generation(self) -> int:
        """Whose turn it is."""
        return self._words[0]

    def take(self) -> None:
        """From now on it is the turn of the next generation, which is the caller."""
        self._words[0] += 1

    def vouch(self, who: int, until_s: float) -> None:
        """``who`` lives, and says so up to ``until_s`` [s]."""
        self._words[who] = int(1e9 * until_s)

    def vouched_s(self, who: int) -> float:
        """Up to when ``who`` has said that it lives [s]; 0.0 where it never has."""
        return 1e-9 * self._words[who]
