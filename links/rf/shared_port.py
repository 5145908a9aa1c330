"""A serial port that a pacer and its stand-by have in common: one opens it, both hold it, and one writes.

The stand-by gets each descriptor as soon as the port is open, over a socket pair. It never opens the port to take
over: opening one again would touch its modem lines, and take time.
"""

import contextlib
import fcntl
import os
import socket
import time

from links.io.module_port import ModulePort
from links.rf.lease import PACER, Lease

OPEN_S = 2.0
"""Opening a port, or closing one whose device is gone, may take so long; nothing is armed meanwhile [s]."""
_OPENED, _CLOSED = b"opened", b"closed"


class SharedPort(ModulePort):
    """Implements :class:`links.rf.pacer.Port` for one generation of ``lease``."""

    def __init__(
        self, path: str, baud: int, lease: Lease, generation: int, beside: socket.socket | None, fd: int | None = None
    ) -> None:
        """``beside`` leads to the stand-by, where there is one; ``fd`` is the port where it is open already."""
        super().__init__(path, baud)
        self._lease, self._generation = lease, generation
        self._beside = beside
        self._fd = fd

    def open(self) -> None:
        """Open it, unless it is; the stand-by has it from then on.

        Raises:
            OSError: as :meth:`links.io.module_port.ModulePort.open`.
        """
        if self._fd is not None:
            return
        self._lease.vouch(PACER, time.monotonic() + OPEN_S)
        super().open()
        if self._fd is not None:
            self._tell(_OPENED, self._fd)

    def close(self) -> None:
        """Close it, at the stand-by too; never raises."""
        if self._fd is not None:
            self._lease.vouch(PACER, time.monotonic() + OPEN_S)
            with contextlib.suppress(OSError):  # its device is gone already
                fcntl.flock(self._fd, fcntl.LOCK_UN)  # the lock is on what is open, which the stand-by may hold longer
            self._tell(_CLOSED)
        super().close()

    def _send(self, fd: int, frame: bytes) -> int:
        self._lease.ensure(self._generation)
        return super()._send(fd, frame)

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
