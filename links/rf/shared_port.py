"""Shared port: the serial port of a pacer and its stand-by. One opens it, both hold it, and one writes.

The stand-by gets each descriptor as soon as the port is open, over a socket pair. It never opens the port to take
over: opening one again would touch its modem lines, and take time.

The port is Linux' own, at any speed, in plain termios2: 125000 and 400000 baud have no name that ``termios`` knows. No
modem line is touched: pseudo-terminals have none, and some modules reset on them. Nothing here waits.
Source: ioctl_tty(2), asm-generic/termbits.h; the numbers hold on x86, ARM and RISC-V.
"""

import contextlib
import errno
import fcntl
import os
import socket
import struct
import termios
import time

from links.rf.shared_memory import PACER, Lease

_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
_TERMIOS2 = struct.Struct("=IIIIB19sII")
_ANY_SPEED = 0o010000
_FLAGS = termios.CS8 | termios.CREAD | termios.CLOCAL | _ANY_SPEED
_FRAMINGS = {"8N1": 0, "8E2": termios.PARENB | termios.CSTOPB}
_SPEED_TOLERANCE = 0.03
"""UARTs work with clocks this far apart."""


class ModulePort:
    """Implements :class:`links.rf.pacer.Port`."""

    def __init__(self, path: str, baud: int, framing: str = "8N1") -> None:
        """Nothing is opened yet; ``framing`` is 8N1 or 8E2."""
        self._path = path
        self._baud = baud
        self._framing = _FRAMINGS[framing]
        self._fd: int | None = None

    def open(self) -> None:
        """Open it for this process alone.

        Raises:
            OSError: it is not there, not ours, in use, no serial port, or can't go that fast; its text says which.
        """
        try:
            fd = os.open(self._path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise OSError(error.errno, f"cannot open {self._path}: {_advice(error)}") from None
        try:
            self._configure(fd)
        except OSError as error:
            os.close(fd)
            raise OSError(error.errno, f"cannot use {self._path}: {_advice(error)}") from None
        self._fd = fd

    def write(self, frame: bytes) -> bool:
        """Send one frame; False, with nothing sent, where earlier bytes still wait: those are thrown away, too old."""
        fd = self._open_fd()
        if _waiting(fd):
            _flush(fd, termios.TCOFLUSH)
            return False
        try:
            written = self._send(fd, frame)
        except BlockingIOError:
            written = 0
        if written != len(frame):
            _flush(fd, termios.TCOFLUSH)
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
            _flush(fd, termios.TCIFLUSH)
        return data

    def close(self) -> None:
        """Close it; never raises."""
        if self._fd is not None:
            fd, self._fd = self._fd, None
            with contextlib.suppress(OSError):  # its device is gone already
                os.close(fd)

    def _send(self, fd: int, frame: bytes) -> int:
        return os.write(fd, frame)

    def _open_fd(self) -> int:
        if self._fd is None:
            raise OSError(errno.EBADF, f"{self._path} is not open")
        return self._fd

    def _configure(self, fd: int) -> None:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        old = _TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size)))
        control = bytearray(19)
        control[termios.VMIN] = 1
        raw = (0, 0, _FLAGS | self._framing, 0, old[4], bytes(control), self._baud, self._baud)
        fcntl.ioctl(fd, _TCSETS2, _TERMIOS2.pack(*raw))
        speed = _TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size)))[7]
        if abs(speed - self._baud) > _SPEED_TOLERANCE * self._baud:
            raise OSError(errno.EINVAL, f"it can't go at {self._baud} baud, only at {speed}: take another adapter")
        _flush(fd, termios.TCIOFLUSH)


def _waiting(fd: int) -> int:
    """Bytes that were written and have not left; 0 where the driver can't tell."""
    try:
        return int(struct.unpack("=i", fcntl.ioctl(fd, termios.TIOCOUTQ, bytes(4)))[0])
    except OSError as error:
        if error.errno in (errno.ENOTTY, errno.EINVAL):
            return 0
        raise


def _flush(fd: int, which: int) -> None:
    try:
        termios.tcflush(fd, which)
    except termios.error as error:
        raise OSError(*error.args) from None


def _advice(error: OSError) -> str:
    match error.errno:
        case errno.ENOENT | errno.ENXIO | errno.ENODEV | errno.EIO:
            return "no such port; plug in the adapter, or correct link.port"
        case errno.EACCES | errno.EPERM:
            return "permission denied; join the group that owns it (often dialout) and log in again"
        case errno.EAGAIN | errno.EBUSY:
            return "another program uses it; stop that first"
        case errno.ENOTTY:
            return "it is no serial port"
    return error.strerror or str(error)


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
            OSError: as :meth:`links.rf.shared_port.ModulePort.open`.
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
