"""Shared memory of a link, its pacer and the stand-by: mailbox, lease of a port, and the port.

Mailbox: the newest of many values, from one process to another. Neither side ever waits for the
    other.

    byte 0        number of the newest record, 0 before the first; written last
    byte 64       slot 0, then slot 1: number, size, CRC-32 of number and value (8 bytes each), and
                  the value

Record n goes to slot n mod 2, so a writer never touches the newest whole record. A slow reader,
whose slot is written anew meanwhile, finds that by the number, which it reads before and after, and
tries again later; the checksum protects it where a processor reorders writes. Half a record is thus
never read, and a writer that dies while it writes leaves the record before.

Lease: whose turn it is to write to the port, and signs of life of a pacer and its stand-by.

    byte 0        generation: number of the process whose turn it is to write, 0 for the pacer
    byte 8        instant up to which the pacer vouches that it lives [ns]; 0 before its first frame
    byte 16       the same of its stand-by

Each word is written by one process at a time and by one store. A generation only rises; whoever
writes to the port looks at it immediately before, and one that is not its own ends it.

Shared port: the serial port of a pacer and its stand-by. One opens it, both hold it, and one
writes.

The stand-by gets each descriptor as soon as the port is open, over a socket pair. It never opens
the port to take over: opening one again would touch its modem lines, and take time.

Nothing here waits.
"""

import contextlib
import errno
import fcntl
import mmap
import os
import socket
import struct
import termios
import time
from binascii import crc32
from enum import IntEnum

from links.io import discard, open_port, waiting
from links.text import link_notice

CAPACITY_BYTES = 16384
"""Largest size of a value [bytes]. Chosen: far above a report or a command."""
_HEAD = struct.Struct("=QQQ")
"""Before a slot's value: its number, length and checksum."""
_SLOT = _HEAD.size + CAPACITY_BYTES


def _make_memory(name: str, size: int) -> int:
    """Return the file descriptor of new memory of ``size`` [bytes], all of it zero."""
    fd = os.memfd_create(name)
    os.ftruncate(fd, size)
    return fd


class Mailbox:
    """One end; whoever makes it hands ``fd`` to the other process."""

    def __init__(self, fd: int | None = None) -> None:
        """Map the memory behind ``fd``, or make it.

        Raises:
            OSError: there is none.
        """
        self.fd = _make_memory("mailbox", 64 + 2 * _SLOT) if fd is None else fd
        """File descriptor of the memory."""
        self._memory = mmap.mmap(self.fd, 0)
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
        _HEAD.pack_into(self._bytes, at, number, len(value), _checksum(number, value))
        self._bytes[at + _HEAD.size : at + _HEAD.size + len(value)] = value
        self._words[0] = self.newest = number

    def get(self) -> bytes | None:
        """Return the newest value; None where it was returned before, or is just being
        overwritten.
        """
        number = self._words[0]
        at = 64 + number % 2 * _SLOT
        _, size, _ = _HEAD.unpack_from(self._bytes, at)
        if number == self.newest or size > CAPACITY_BYTES:
            return None
        value = bytes(self._bytes[at + _HEAD.size : at + _HEAD.size + size])
        if _HEAD.unpack_from(self._bytes, at) != (number, size, _checksum(number, value)):
            return None
        self.newest = number
        return value

    def close(self) -> None:
        """Release the memory; the other end keeps it."""
        self._words.release()
        self._bytes.release()
        self._memory.close()
        os.close(self.fd)


def _checksum(number: int, value: bytes) -> int:
    return crc32(value, number & 0xFFFFFFFF)


class LeaseWord(IntEnum):
    """Words of the lease."""

    GENERATION = 0
    PACER = 1
    """Sign of life of the pacer."""
    STANDBY = 2


class Superseded(Exception):
    """Another process writes now."""


class Lease:
    """One end; whoever makes it hands ``fd`` to the other process.

    Times are on one clock, the commands' [s].
    """

    def __init__(self, fd: int | None = None) -> None:
        """Map the memory behind ``fd``, or make it.

        Raises:
            OSError: there is none.
        """
        self.fd = _make_memory("lease", mmap.PAGESIZE) if fd is None else fd
        """File descriptor of the memory."""
        self._words = memoryview(mmap.mmap(self.fd, mmap.PAGESIZE)).cast("Q")

    @property
    def generation(self) -> int:
        """Generation whose turn it is."""
        return self._words[LeaseWord.GENERATION]

    def take(self) -> None:
        """Take the turn for the next generation, which is the caller."""
        self._words[LeaseWord.GENERATION] += 1

    def vouch(self, who: LeaseWord, until_s: float) -> None:
        """Vouch that ``who`` lives, up to ``until_s`` [s]."""
        self._words[who] = int(1e9 * until_s)

    def vouched_s(self, who: LeaseWord) -> float:
        """Return the time up to which ``who`` has vouched to live [s]; 0.0 where it never has."""
        return 1e-9 * self._words[who]


OPEN_S = 2.0
"""Longest time to open or close a port [s]; nothing is armed meanwhile. Chosen."""
_OPENED, _CLOSED = b"opened", b"closed"


class SharedPort:
    """Implements :class:`links.rf.pacer.Port` for one generation of ``lease``."""

    def __init__(
        self,
        path: str,
        baud: int,
        lease: Lease,
        generation: int,
        beside: socket.socket | None,
        fd: int | None = None,
    ) -> None:
        """``beside`` leads to the stand-by, where there is one.

        ``fd`` is the port where it is open already.
        """
        self._path, self._baud = path, baud
        self._lease, self._generation = lease, generation
        self._beside = beside
        self._fd = fd

    def open(self) -> None:
        """Open it for this process alone, unless it is open; the stand-by has it from then on.

        Raises:
            OSError: it can't be used; its text says why.
        """
        if self._fd is not None:
            return
        self._lease.vouch(LeaseWord.PACER, time.monotonic() + OPEN_S)
        try:
            self._fd = open_port(self._path, self._baud)
        except OSError as error:
            raise OSError(
                error.errno, link_notice("module.port", path=self._path, why=error.strerror).text
            ) from None
        self._send(_OPENED, self._fd)

    def write(self, frame: bytes) -> bool:
        """Send one frame; False, with nothing sent, where earlier bytes still wait: those are
        thrown away, too old.

        Raises:
            Superseded: it is the turn of another generation.
        """
        fd = self._open_fd()
        if waiting(fd):
            discard(fd)
            return False
        if self._lease.generation != self._generation:
            raise Superseded
        try:
            written = os.write(fd, frame)
        except BlockingIOError:
            written = 0
        if written != len(frame):
            discard(fd)
            return False
        return True

    def read(self, limit: int) -> bytes:
        """Return received bytes, at most ``limit`` bytes; the rest is thrown away."""
        fd = self._open_fd()
        try:
            data = os.read(fd, limit)
        except BlockingIOError:
            return b""
        if len(data) == limit:
            discard(fd, termios.TCIFLUSH)
        return data

    def close(self) -> None:
        """Close it, at the stand-by too; never raises."""
        if self._fd is None:
            return
        self._lease.vouch(LeaseWord.PACER, time.monotonic() + OPEN_S)
        fd, self._fd = self._fd, None
        # The lock is on what is open, which the stand-by may hold longer.
        with contextlib.suppress(OSError):  # its device is gone already
            fcntl.flock(fd, fcntl.LOCK_UN)
        self._send(_CLOSED)
        with contextlib.suppress(OSError):
            os.close(fd)

    def _open_fd(self) -> int:
        if self._fd is None:
            raise OSError(errno.EBADF, f"{self._path} is not open")
        return self._fd

    def _send(self, what: bytes, *fds: int) -> None:
        """Send ``what``, and descriptors, to the stand-by, if there is one."""
        if self._beside is not None:
            # A stand-by that is dead, or has stood still for long, takes nothing any more.
            with contextlib.suppress(OSError):
                socket.send_fds(self._beside, [what], list(fds))


class HeldPort:
    """Serial port that the stand-by holds for its pacer."""

    def __init__(self, beside: socket.socket) -> None:
        """``beside`` leads to the pacer."""
        self.beside = beside
        beside.setblocking(False)
        self.fd: int | None = None
        """Descriptor of the port; None while it is closed."""

    def take_messages(self) -> bool:
        """Take the pacer's messages about the port; return whether the pacer can send more."""
        while True:
            try:
                what, fds, _, _ = socket.recv_fds(self.beside, len(_OPENED), 1)
            except BlockingIOError:
                return True
            except OSError:
                return False
            if not what:
                return False
            if self.fd is not None:
                os.close(self.fd)
            self.fd = fds[0] if fds else None
