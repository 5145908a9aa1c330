"""A serial port, opened raw and without waiting: 8 data bits, no parity, 1 stop bit, no flow control.

Written on termios rather than pyserial: bytes come by the event loop's own reader, no thread and no dependency.
Every failure is an OSError whose words fit a person.
"""

import asyncio
import contextlib
import fcntl
import os
import struct
import termios
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, TypeVar

STANDARD = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 500000, 921600, 1000000, 1500000, 2000000)
"""Baud rates that every Linux knows by name."""


def open_port(path: str, baud: int) -> int:
    """The descriptor of the port at ``path``, at ``baud`` bit/s; nobody else may open it meanwhile.

    Raises:
        OSError: it can't be opened, is no serial port, is in use, or does not do ``baud``.
    """
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        raise OSError(f"a port can't do {baud} baud: expected one of {STANDARD}")
    fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        if not os.isatty(fd):
            raise OSError(f"{path} is no serial port")
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        fcntl.ioctl(fd, termios.TIOCEXCL)
        cc = termios.tcgetattr(fd)[6]
        cc[termios.VMIN], cc[termios.VTIME] = 0, 0
        cflag = termios.CS8 | termios.CREAD | termios.CLOCAL
        termios.tcsetattr(fd, termios.TCSANOW, [0, 0, cflag, 0, speed, speed, cc])
        termios.tcflush(fd, termios.TCIOFLUSH)  # what was sent to, or by, whoever had it before
    except BlockingIOError:
        os.close(fd)
        raise OSError(f"another program has {path} open") from None
    except termios.error as error:
        os.close(fd)
        raise OSError(f"{path} takes no settings ({error.args[-1]})") from None
    except OSError:
        os.close(fd)
        raise
    return fd


def is_pseudo_terminal(path: str) -> bool:
    """True where a program of this machine is at the other end of ``path``; what is behind that one, nobody knows."""
    return str(Path(path).resolve()).startswith("/dev/pts/")


def waiting(fd: int) -> int:
    """Bytes that were written and have not left yet; 0 where the port can't tell."""
    try:
        count: int = struct.unpack("i", fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0\0\0\0"))[0]
    except OSError:
        return 0
    return count


def close_port(fd: int) -> None:
    """Close it; what waits in it never leaves."""
    with contextlib.suppress(termios.error, OSError):  # unplugged: there is nothing left in it
        termios.tcflush(fd, termios.TCIOFLUSH)
    os.close(fd)


class PortProtocol(Protocol):
    """Who is served by a port, as asyncio serves its protocols."""

    def connection_made(self, transport: Any) -> None:
        """The port is open: ``transport`` is a :class:`PortTransport`, or what stands around it."""
        ...

    def data_received(self, data: bytes) -> None:
        """Bytes came in."""
        ...

    def connection_lost(self, exc: Exception | None) -> None:
        """The port has ended by itself."""
        ...


P = TypeVar("P", bound=PortProtocol)


class PortTransport:
    """An open port on the event loop. What is sent leaves at once or never."""

    def __init__(self, fd: int, protocol: PortProtocol) -> None:
        """Take over the open port ``fd``."""
        self._fd = fd
        self._protocol = protocol
        self._loop = asyncio.get_running_loop()
        protocol.connection_made(self)
        self._loop.add_reader(fd, self._read)

    def waiting(self) -> int:
        """Bytes that were sent and have not left yet; 0 where the port can't tell."""
        return waiting(self._fd)

    def send(self, data: bytes) -> int:
        """Send ``data``; returns its length.

        Raises:
            BlockingIOError: there is no room for all of it.
            OSError: the port is gone.
        """
        written = os.write(self._fd, data)
        if written != len(data):
            raise BlockingIOError("a part has left")
        return written

    def abort(self) -> None:
        """Close the port; what waits in it never leaves, and nobody is told."""
        if self._fd >= 0:
            self._loop.remove_reader(self._fd)
            close_port(self._fd)
            self._fd = -1

    def _read(self) -> None:
        try:
            data = os.read(self._fd, 4096)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(error)
            return
        if data:
            self._protocol.data_received(data)
        else:
            self._end(None)

    def _end(self, error: Exception | None) -> None:
        self.abort()
        self._protocol.connection_lost(error)


async def create_serial_connection(factory: Callable[[], P], path: str, baud: int) -> tuple[Any, P]:
    """Open the port at ``path`` for the protocol that ``factory`` makes; raises as :func:`open_port` does.

    Where the running loop has a method of this name that is what opens it, as with asyncio's own wires: a recorder
    taps it there, and a replay has no real port.
    """
    own = getattr(asyncio.get_running_loop(), "create_serial_connection", None)
    if own is not None:
        transport, protocol = await own(factory, path, baud)
        return transport, protocol
    return await open_serial_connection(factory, path, baud)


async def open_serial_connection(factory: Callable[[], P], path: str, baud: int) -> tuple[Any, P]:
    """The same past the loop."""
    fd = open_port(path, baud)
    protocol = factory()
    return PortTransport(fd, protocol), protocol
