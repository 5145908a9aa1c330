"""Wires: datagrams that leave now or never, a serial port, and the computer's sleep.

The serial port is opened raw and without waiting, for this program alone, at any speed; 8N1, no
flow control.

Linux' own, in plain termios2 rather than pyserial: 125000 and 400000 baud have no name that
``termios`` knows, bytes come by the event loop's own reader, and there is no thread. No modem line
is touched: pseudo-terminals have none, and some modules reset on them. Every failure is an OSError
whose ``strerror`` fits a person. While a computer sleeps, CLOCK_MONOTONIC, which every deadline is
on, stands still: what was fresh when a laptop's lid was closed would pass for fresh when it is
opened.

Source: ioctl_tty(2), asm-generic/termbits.h; the numbers hold on x86, ARM and RISC-V.
"""

import contextlib
import errno
import fcntl
import os
import re
import socket
import struct
import termios
import time
from collections.abc import Callable
from contextvars import ContextVar
from enum import IntEnum
from pathlib import Path
from typing import Any, TypeVar

from links.core import STALL_S
from links.text import Sentence, link_notice

TYPE_CHECKING = False
if TYPE_CHECKING:
    import asyncio


class Termios2(IntEnum):
    """Linux' numbers for a port with any speed, which ``termios`` does not have."""

    TCGETS2 = 0x802C542A
    """ioctl: read the settings."""
    TCSETS2 = 0x402C542B
    """ioctl: write them."""
    BOTHER = 0o010000
    """Bit of c_cflag: the speed is a number."""


_TERMIOS2 = struct.Struct("=IIIIB19sII")
_FLAGS = termios.CS8 | termios.CREAD | termios.CLOCAL | Termios2.BOTHER
_SPEED_TOLERANCE = 0.03
"""UARTs work with clocks this far apart."""


def open_port(path: str, baud: int) -> int:
    """The descriptor of the port at ``path``, at ``baud`` bit/s, with nothing in it.

    No other program that asks for it alone, as this one does, gets it meanwhile.

    Raises:
        OSError: it is not there, not ours, in use, no serial port, or can't go that fast; its text
            says which.
    """
    fd = -1
    try:
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        old = _TERMIOS2.unpack(fcntl.ioctl(fd, Termios2.TCGETS2, bytes(_TERMIOS2.size)))
        control = bytearray(19)
        control[termios.VMIN] = 1
        raw = (0, 0, _FLAGS, 0, old[4], bytes(control), baud, baud)
        fcntl.ioctl(fd, Termios2.TCSETS2, _TERMIOS2.pack(*raw))
        speed = _TERMIOS2.unpack(fcntl.ioctl(fd, Termios2.TCGETS2, bytes(_TERMIOS2.size)))[7]
        if abs(speed - baud) > _SPEED_TOLERANCE * baud:
            raise OSError(errno.EINVAL, link_notice("port.speed", baud=baud, speed=speed).text)
        discard(fd, termios.TCIOFLUSH)  # what was sent to, or by, whoever had it before
    except OSError as error:
        if fd >= 0:
            os.close(fd)
        raise OSError(error.errno, _advice(error)) from None
    return fd


def _advice(error: OSError) -> str:
    match error.errno:
        case errno.ENOENT | errno.ENXIO | errno.ENODEV | errno.EIO:
            return link_notice("port.missing").text
        case errno.EACCES | errno.EPERM:
            return link_notice("port.forbidden").text
        case errno.EAGAIN | errno.EBUSY:
            return link_notice("port.busy").text
        case errno.ENOTTY:
            return link_notice("port.not_serial").text
    return error.strerror or str(error)


def explain_error(error: OSError) -> str:
    """Return the system's words for ``error``; asyncio has others for a refused connection."""
    refused = re.search(r"\[Errno (\d+)\] Connect call failed", str(error))
    return os.strerror(int(refused[1])) if refused else error.strerror or str(error)


def discard(fd: int, which: int = termios.TCOFLUSH) -> None:
    """Throw away what waits to leave, or what ``which`` says as tcflush(3) has it.

    Raises:
        OSError: the port is gone.
    """
    try:
        termios.tcflush(fd, which)
    except termios.error as error:
        raise OSError(*error.args) from None


def is_pseudo_terminal(path: str) -> bool:
    """True where a program of this machine is at the other end of ``path``.

    What is behind that one, nobody knows.
    """
    return str(Path(path).resolve()).startswith("/dev/pts/")


def waiting(fd: int) -> int:
    """Bytes written that have not left yet; of a TCP socket, that are not acknowledged yet.

    0 where the driver can't tell.

    Raises:
        OSError: the port is gone.
    """
    try:
        return int(struct.unpack("=i", fcntl.ioctl(fd, termios.TIOCOUTQ, bytes(4)))[0])
    except OSError as error:
        if error.errno in (errno.ENOTTY, errno.EINVAL):
            return 0
        raise


P = TypeVar("P")


def _running_loop() -> Any:
    """Return the event loop; the processes of a pacer open ports without one."""
    import asyncio

    return asyncio.get_running_loop()


class PortTransport:
    """An open port on the event loop. What is sent leaves at once or never."""

    def __init__(self, fd: int, protocol: Any) -> None:
        self._fd = fd
        self._protocol = protocol
        self._loop = _running_loop()
        protocol.connection_made(self)
        self._loop.add_reader(fd, self._read)

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Nothing more is told, as by asyncio's transports."""
        return default

    def waiting(self) -> int:
        """Bytes that were sent and have not left yet; 0 where the port can't tell, or is gone."""
        try:
            return waiting(self._fd)
        except OSError:
            return 0

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
            with contextlib.suppress(OSError):  # unplugged: there is nothing left in it
                discard(self._fd, termios.TCIOFLUSH)
            os.close(self._fd)
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


class Network:
    """Opens wires for asyncio's protocols on the running event loop, of real or virtual time.

    Each method returns transport and protocol, and raises OSError where the wire can't be opened.
    """

    async def open_datagram(
        self,
        factory: Callable[[], P],
        local: Any = None,
        remote: Any = None,
        *,
        reuse_port: bool | None = None,
    ) -> tuple[Any, P]:
        """A datagram endpoint at the address ``local``, or to ``remote``."""
        opened: tuple[Any, P] = await _running_loop().create_datagram_endpoint(
            factory, local, remote, reuse_port=reuse_port
        )
        return opened

    async def open_stream(self, factory: Callable[[], P], host: str, port: int) -> tuple[Any, P]:
        """A connection to ``host``:``port``."""
        opened: tuple[Any, P] = await _running_loop().create_connection(factory, host, port)
        return opened

    async def open_serial(self, factory: Callable[[], P], path: str, baud: int) -> tuple[Any, P]:
        """The serial port at ``path``; see :func:`open_port`."""
        fd = open_port(path, baud)
        fcntl.ioctl(fd, termios.TIOCEXCL)  # programs that look for modems ask nobody
        protocol = factory()
        return PortTransport(fd, protocol), protocol


NETWORK: ContextVar[Network] = ContextVar("network", default=Network())  # noqa: B039  # it has no state
"""Factory of the wires of links and pose sources; flights replace it to record or replay them."""


def advise_on_address(error: OSError) -> Sentence:
    """Return the advice about an address that the system refuses by ``error``."""
    causes = {
        errno.EADDRNOTAVAIL: "address.not_ours",
        errno.EACCES: "address.forbidden",
        errno.EADDRINUSE: "address.taken",
    }
    known = causes.get(error.errno or 0, "address.refused")
    return link_notice("address.unknown_host" if isinstance(error, socket.gaierror) else known)


class Datagrams:
    """The sending side of a datagram endpoint.

    asyncio keeps a datagram that the kernel has no room for (EAGAIN) and sends it later, when it
    may have passed its deadline. So what is sent here goes through a second handle on the same
    socket, and is dropped instead.
    """

    def __init__(self, transport: "asyncio.DatagramTransport") -> None:
        """Send on ``transport``, which may be connected or not."""
        self._transport = transport
        shared = transport.get_extra_info("socket")
        self._socket: Any = shared.dup() if shared is not None else None
        self._connected = transport.get_extra_info("peername") is not None

    def send(self, data: bytes, peer: Any) -> str:
        """Send ``data`` to ``peer`` (None on a connected endpoint).

        Returns why it did not leave, or nothing.
        """
        if peer is None and not self._connected:
            return "no_peer"
        if self._socket is None:
            self._transport.sendto(data, peer)
            return ""
        try:
            if self._connected:
                self._socket.send(data)
            else:
                self._socket.sendto(data, peer)
        except (BlockingIOError, InterruptedError):
            return "congested"
        except OSError:
            return "undeliverable"
        return ""

    def abort(self) -> None:
        """Close both handles; nothing leaves any more."""
        if self._socket is not None:
            self._socket.close()
        self._transport.abort()


OURS_S = 0.05
"""A clock so close to this machine's is this machine's [s]."""

_AWAKE_OR_NOT = getattr(time, "CLOCK_BOOTTIME", None)
"""The clock that goes on in sleep; None where there is none, as on macOS."""


def _ahead_s() -> float:
    """Measure the lead of the clock that counts sleep [s].

    A pause between the readings only makes it smaller.
    """
    if _AWAKE_OR_NOT is None:
        return 0.0
    return time.clock_gettime(_AWAKE_OR_NOT) - time.monotonic()


class Sleep:
    """Watches from its making on."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        """``now_s`` is the owner's clock.

        One that is not this machine's, as a simulation's, never sleeps.
        """
        self._counts = time.monotonic() - OURS_S < now_s() < time.monotonic() + OURS_S
        self._before_s = max(_ahead_s() for _ in range(3))

    @property
    def slept_s(self) -> float:
        """Return how long the computer has slept since then [s].

        0.0 where it has not, or cannot tell: less than a stall only parts the readings of two
        clocks.
        """
        if not self._counts:
            return 0.0
        slept = _ahead_s() - self._before_s
        return slept if slept > STALL_S else 0.0
