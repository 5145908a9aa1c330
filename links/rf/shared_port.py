"""Shared port: the serial port of a pacer and its stand-by. One opens it, both hold it, and one writes.

The stand-by gets each descriptor as soon as the port is open, over a socket pair. It never opens the port to take
over: opening one again would touch its modem lines, and take time.

Nothing here waits.
"""

import contextlib
import errno
import fcntl
import os
import socket
import termios
import time

from links.io import discard, open_port, waiting
from links.rf.shared_memory import PACER, Lease

OPEN_S = 2.0
"""Opening a port, or closing one whose device is gone, may take so long; nothing is armed meanwhile [s]."""
_OPENED, _CLOSED = b"opened", b"closed"


class SharedPort:
    """Implements :class:`links.rf.pacer.Port` for one generation of ``lease``."""

    def __init__(
        self, path: str, baud: int, lease: Lease, generation: int, beside: socket.socket | None, fd: int | None = None
    ) -> None:
        """``beside`` leads to the stand-by, where there is one; ``fd`` is the port where it is open already."""
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
        self._lease.vouch(PACER, time.monotonic() + OPEN_S)
        try:
            self._fd = open_port(self._path, self._baud)
        except OSError as error:
            raise OSError(error.errno, f"cannot open {self._path}: {error.strerror}") from None
        self._tell(_OPENED, self._fd)

    def write(self, frame: bytes) -> bool:
        """Send one frame; False, with nothing sent, where earlier bytes still wait: those are thrown away, too old."""
        fd = self._open_fd()
        if waiting(fd):
            discard(fd)
            return False
        self._lease.ensure(self._generation)
        try:
            written = os.write(fd, frame)
        except BlockingIOError:
            written = 0
        if written != len(frame):
            discard(fd)
            return False
        return True

    def read(self, limit: int) -> bytes:
        """What has come, at most ``limit`` bytes; the rest is thrown away."""
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
        self._lease.vouch(PACER, time.monotonic() + OPEN_S)
        fd, self._fd = self._fd, None
        with contextlib.suppress(OSError):  # its device is gone already
            fcntl.flock(fd, fcntl.LOCK_UN)  # the lock is on what is open, which the stand-by may hold longer
        self._tell(_CLOSED)
        with contextlib.suppress(OSError):
            os.close(fd)

    def _open_fd(self) -> int:
        if self._fd is None:
            raise OSError(errno.EBADF, f"{self._path} is not open")
        return self._fd

    def _tell(self, what: bytes, *fds: int) -> None:
        if self._beside is not None:
            with contextlib.suppress(OSError):  # it is dead, or has stood still for long: it is no stand-by any more
                socket.send_fds(self._beside, [what], list(fds))


class HeldPort:
    """The same port as the stand-by holds it."""

    def __init__(self, beside: socket.socket) -> None:
        """``beside`` leads to the pacer."""
        self.beside = beside
        beside.setblocking(False)
        self.fd: int | None = None
        """Its descriptor; None while it is closed."""

    def hear(self) -> bool:
        """Take what the pacer has said of it; False where it says nothing any more."""
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
