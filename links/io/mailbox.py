"""The newest of many values, from one process to another through shared memory. Neither side ever waits for the other.

    byte 0        number of the newest record, 0 before the first; written last
    byte 64       slot 0, then slot 1: number, size, CRC-32 of number and value (8 bytes each), and the value

Record n goes to slot n mod 2, so what is written never touches the newest whole record. A reader that takes so long
that its slot is written anew meanwhile sees it by the number, which it looks at before and after; the checksum holds
where a processor reorders what it writes. Half a record is thus never read, and a writer that dies in the midst of
one leaves the one before.
"""

import mmap
import os
from binascii import crc32

CAPACITY_BYTES = 16384
"""Largest value."""
_HEAD = 24
_SLOT = _HEAD + CAPACITY_BYTES
_SIZE = 64 + 2 * _SLOT
_WORD = 8
_TRIES = 3


class Mailbox:
    """One end; whoever makes it hands ``fd`` to the other process."""

    def __init__(self, fd: int | None = None) -> None:
        """Map the memory behind ``fd``, or make it.

        Raises:
            OSError: there is none.
        """
        self.fd = os.memfd_create("mailbox") if fd is None else fd
        """File descriptor of the memory."""
        if fd is None:
            os.ftruncate(self.fd, _SIZE)
        self._memory = mmap.mmap(self.fd, _SIZE)
        self._bytes = memoryview(self._memory)
        self._words = self._bytes.cast("Q")  # a word is written by one store
        self.newest = 0
        """Number of the record that was put or got last."""

    def put(self, value: bytes) -> None:
        """Make ``value`` the newest.

        Raises:
            ValueError: it is larger than :data:`CAPACITY_BYTES`.
        """
        if len(value) > CAPACITY_BYTES:
            raise ValueError(f"{len(value)} bytes are too many for a mailbox of {CAPACITY_BYTES}")
        number = self.newest + 1
        at = 64 + number % 2 * _SLOT
        self._words[at // _WORD] = number
        self._words[at // _WORD + 1] = len(value)
        self._words[at // _WORD + 2] = _checksum(number, value)
        self._bytes[at + _HEAD : at + _HEAD + len(value)] = value
        self._words[0] = self.newest = number

    def get(self) -> bytes | None:
        """The newest value; None where it was got before, or is being written over at this very moment."""
        for _ in range(_TRIES):
            number = self._words[0]
            if number == self.newest:
                return None
            at = 64 + number % 2 * _SLOT
            size = self._words[at // _WORD + 1]
            if size <= CAPACITY_BYTES:
                value = bytes(self._bytes[at + _HEAD : at + _HEAD + size])
                whole = self._words[at // _WORD] == number and self._words[at // _WORD + 2] == _checksum(number, value)
                if whole and self._words[0] == number:
                    self.newest = number
                    return value
        return None

    def close(self) -> None:
        """Let go of the memory; the other end keeps it."""
        self._words.release()
        self._bytes.release()
        self._memory.close()
        os.close(self.fd)


def _checksum(number: int, value: bytes) -> int:
    return crc32(value, number & 0xFFFFFFFF)
