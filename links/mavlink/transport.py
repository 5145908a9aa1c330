"""MAVLink transport: UDP, TCP or a serial port, opened again when it is lost.

A frame leaves at once or never: one that would have to wait is dropped, as it would be stale when it left.

TCP repeats what got lost until it arrives, so a command may arrive late. Against that:

- A frame is dropped where older ones have waited for their acknowledgement for longer than ``TCP_QUEUE_S``.
- After ``TCP_STALL_S`` of that the connection is cut so that nothing in it arrives any more (SO_LINGER 0: a reset).

What the other end has acknowledged and not read yet is out of our hands: prefer UDP where there is a choice.
"""

import asyncio
import struct
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from typing import Any, Protocol

from links.core import LinkError, LinkLost
from links.io import Datagrams, create_serial_connection, parse_address, waiting
from links.mavlink.protocol import MavlinkLinkConfig


class MavlinkTransport(Protocol):
    """An open medium."""

    datagrams: bool
    """True where what is heard at once holds whole frames; a stream may be cut anywhere."""
    speaks_first: bool
    """True where it is known whom to send to before anybody has been heard."""

    def leave(self, frame: bytes, to: Any) -> str:
        """Send ``frame`` to the address ``to`` (None: the only one there is).

        Returns why it was dropped instead, or an empty string.
        """
        ...

    def cut(self) -> None:
        """Release the medium at once, with all that waits in it. Nothing is heard afterwards."""
        ...


class TransportListener(Protocol):
    """What an open medium reports to."""

    def hear(self, data: bytes, source: Any) -> None:
        """``data`` came from the address ``source``."""
        ...

    def undeliverable(self) -> None:
        """The network gave back a datagram of ours."""
        ...

    def lose_transport(self, why: str) -> None:
        """The medium has ended by itself; ``why`` completes "the link is lost: "."""
        ...


class UdpTransport(asyncio.DatagramProtocol):
    """A :class:`MavlinkTransport` that is never gone: a network that was away comes back itself."""

    datagrams = True

    def __init__(self, ear: TransportListener, *, speaks_first: bool) -> None:
        """Opened by the event loop."""
        self.speaks_first = speaks_first
        self._ear: TransportListener | None = ear
        self._out: Datagrams

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one datagram."""
        return self._out.send(frame, to)

    def cut(self) -> None:
        """Close the socket."""
        self._ear = None
        self._out.abort()

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]  # it is one
        """Keep it (called by the event loop)."""
        self._out = Datagrams(transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Pass it on (called by the event loop)."""
        if self._ear is not None:
            self._ear.hear(data, addr)

    def error_received(self, exc: Exception) -> None:
        """Pass it on (called by the event loop)."""
        if self._ear is not None:
            self._ear.undeliverable()


async def open_udp(config: MavlinkLinkConfig, ear: TransportListener) -> UdpTransport:
    """Open ``listen`` or ``remote``; raises OSError."""
    address = parse_address(config.address)
    first = config.remote is not None
    local, remote = (None, address) if first else (address, None)
    loop = asyncio.get_running_loop()
    _, wire = await loop.create_datagram_endpoint(
        lambda: UdpTransport(ear, speaks_first=first), local_addr=local, remote_addr=remote
    )
    return wire


TCP_QUEUE_S = 0.1
"""Frames may wait for the other end this long [s]; a delayed acknowledgement takes 0.04."""
TCP_STALL_S = 0.25
"""After this long the connection is cut [s]."""
TCP_OPEN_S = 5.0
"""How long the other end may take to accept [s]."""

_SOL_SOCKET, _SO_LINGER = 1, 13  # the same on every Linux that Python runs on


class TcpTransport(asyncio.Protocol):
    """Implements :class:`MavlinkTransport`."""

    datagrams = False
    speaks_first = True

    def __init__(self, ear: TransportListener) -> None:
        """Opened by the event loop."""
        self._ear: TransportListener | None = ear
        self._transport: Any = None
        self._loop = asyncio.get_running_loop()
        self._sent = 0
        self._unacknowledged: deque[tuple[int, float]] = deque()
        """For each frame: bytes sent up to its end, and when."""
        self._watch: asyncio.TimerHandle | None = None

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one frame."""
        transport = self._transport
        if transport.is_closing() or transport.get_write_buffer_size() or self._waited_s() > TCP_QUEUE_S:
            return "full"
        transport.write(frame)
        self._sent += len(frame)
        self._unacknowledged.append((self._sent, self._loop.time()))
        if self._watch is None:
            self._watch = self._loop.call_later(TCP_QUEUE_S, self._look)
        return ""

    def _look(self) -> None:
        """While anything waits, see for how long."""
        self._watch = None
        if self._ear is None:
            return
        if self._waited_s() > TCP_STALL_S:
            self._end("the other end acknowledges nothing any more")
        elif self._unacknowledged:
            self._watch = self._loop.call_later(TCP_QUEUE_S / 4, self._look)

    def _waited_s(self) -> float:
        """How long ago the oldest frame left that is not acknowledged yet [s]."""
        frames = self._unacknowledged
        if frames:
            socket = self._transport.get_extra_info("socket")
            queued = waiting(socket.fileno()) + self._transport.get_write_buffer_size()
            while frames and frames[0][0] <= self._sent - queued:
                frames.popleft()
        return self._loop.time() - frames[0][1] if frames else 0.0

    def cut(self) -> None:
        """Reset the connection."""
        self._ear = None
        if self._watch is not None:
            self._watch.cancel()
        self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep it (called by the event loop)."""
        self._transport = transport
        transport.get_extra_info("socket").setsockopt(_SOL_SOCKET, _SO_LINGER, struct.pack("ii", 1, 0))

    def data_received(self, data: bytes) -> None:
        """Pass it on (called by the event loop)."""
        if self._ear is not None:
            self._ear.hear(data, None)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on (called by the event loop)."""
        self._end("the other end closed the TCP connection" if exc is None else f"the TCP connection broke ({exc})")

    def _end(self, why: str) -> None:
        ear, self._ear = self._ear, None
        if self._watch is not None:
            self._watch.cancel()
        self._transport.abort()
        if ear is not None:
            ear.lose_transport(why)


async def open_tcp(config: MavlinkLinkConfig, ear: TransportListener) -> TcpTransport:
    """Connect to ``tcp``; raises OSError."""
    assert config.tcp is not None, "the caller has looked"
    host, port = parse_address(config.tcp)
    loop = asyncio.get_running_loop()
    try:
        async with asyncio.timeout(TCP_OPEN_S):
            _, wire = await loop.create_connection(lambda: TcpTransport(ear), host, port)
    except TimeoutError:
        raise OSError(f"nobody accepts within {TCP_OPEN_S:g} s") from None
    return wire


SERIAL_QUEUE_S = 0.02
"""A frame is dropped where what waits before it takes the port longer than this [s]."""
SERIAL_STALL_S = 0.25
"""What has waited for this long is thrown away [s]: a flow control that blocks must not keep a stale command."""


class SerialTransport:
    """Implements :class:`MavlinkTransport`, and :class:`links.io.serial_port.PortProtocol`."""

    datagrams = False
    speaks_first = True

    def __init__(self, baud: int, ear: TransportListener) -> None:
        """Opened by :func:`open_serial`."""
        self._port: Any = None
        self._ear: TransportListener | None = ear
        self._room = max(64.0, SERIAL_QUEUE_S * baud / 10.0)  # a byte takes 10 bits
        self._loop = asyncio.get_running_loop()
        self._full_since_s: float | None = None

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one frame."""
        if self._ear is None:
            return "full"
        if self._port.waiting() <= self._room and self._write(frame):
            self._full_since_s = None
            return ""
        now = self._loop.time()
        if self._full_since_s is None:
            self._full_since_s = now
        elif now - self._full_since_s > SERIAL_STALL_S:
            self._end("the port takes nothing any more: check flow control and wiring")
        return "full"

    def _write(self, frame: bytes) -> bool:
        try:
            self._port.send(frame)
        except BlockingIOError:
            return False
        except OSError as error:
            self._end(f"the port is gone ({error.strerror})")
            return False
        return True

    def cut(self) -> None:
        """Close the port."""
        self._ear = None
        self._port.abort()

    def connection_made(self, transport: Any) -> None:
        """Keep it (called by the port)."""
        self._port = transport

    def data_received(self, data: bytes) -> None:
        """Pass it on (called by the port)."""
        if self._ear is not None:
            self._ear.hear(data, None)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on (called by the port)."""
        self._end(f"the port is gone ({getattr(exc, 'strerror', None) or 'unplugged'})")

    def _end(self, why: str) -> None:
        ear = self._ear
        self.cut()
        if ear is not None:
            ear.lose_transport(why)


async def open_serial(config: MavlinkLinkConfig, ear: TransportListener) -> SerialTransport:
    """Open ``serial``; raises OSError."""
    assert config.serial is not None, "the caller has looked"
    _, wire = await create_serial_connection(lambda: SerialTransport(config.baud, ear), config.serial, config.baud)
    return wire


Opener = Callable[[MavlinkLinkConfig, TransportListener], Awaitable[MavlinkTransport]]


def opener(config: MavlinkLinkConfig) -> Opener:
    """The function that opens the medium of ``config``; it raises OSError."""
    if config.serial is not None:
        return open_serial
    if config.tcp is not None:
        return open_tcp
    return open_udp


FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 8.0
"""Before opening a lost wire again [s]; each pause is twice the one before."""


class ReconnectingTransport:
    """The :class:`TransportListener` of one wire after the other. Opened and cut by whoever owns it."""

    def __init__(
        self,
        config: MavlinkLinkConfig,
        dropped: Counter[str],
        *,
        hear: Callable[[bytes, Any], None],
        lose: Callable[[str], None],
        tell: Callable[[str], None],
    ) -> None:
        """Nothing is opened yet. Frames of ours that do not leave or come back are counted in ``dropped``.

        ``hear(data, source)`` takes what arrives; ``lose(why)`` is called when the wire has ended by itself, and
        ``tell`` with what is being done about it, for the operator.
        """
        self._config = config
        self._dropped = dropped
        self._hear, self._lose, self._tell = hear, lose, tell
        self.wire: MavlinkTransport | None = None
        """The open one; None while there is none."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._returning: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Open it for the first time.

        Raises:
            LinkLost: it can't be opened.
            LinkError: it was cut before it was open.
        """
        self._loop = asyncio.get_running_loop()
        config = self._config
        try:
            wire = await opener(config)(config, self)
        except OSError as error:
            raise LinkLost(
                f"cannot open {config.address} for MAVLink ({error.strerror or error}): stop the program that "
                "holds this port, or give an address of this machine"
                if config.tcp is None and config.serial is None
                else f"cannot open {config.address} for MAVLink ({error.strerror or error}): check that it is there, "
                "that you may open it, and that no other program has it"
            ) from error
        if self._loop is None:
            wire.cut()
            raise LinkError("the link was closed before it was open")
        self.wire = wire

    def cut(self) -> None:
        """Release it, and open it no more."""
        wire, returning = self.wire, self._returning
        self.wire = self._returning = self._loop = None
        if returning is not None:
            returning.cancel()
        if wire is not None:
            wire.cut()

    def leave(self, frame: bytes, to: Any) -> bool:
        """Send ``frame`` to the address ``to``, and tell whether it left; nothing leaves on a lost wire."""
        if self.wire is None:
            return False
        why = self.wire.leave(frame, to)
        if why:
            self._dropped[why] += 1
        return not why

    def hear(self, data: bytes, source: Any) -> None:
        """Pass on what arrived from the address ``source`` (called by the wire)."""
        if self.wire is not None:
            self._hear(data, source)

    def undeliverable(self) -> None:
        """Count what the network gave back (called by the wire)."""
        self._dropped["undeliverable"] += 1

    def lose_transport(self, why: str) -> None:
        """Begin to open it again (called by the wire)."""
        if self._loop is None:
            return
        self.wire = None
        self._lose(why)
        if self._returning is not None:
            self._returning.cancel()
        self._returning = self._loop.create_task(self._return(why))

    async def _return(self, why: str) -> None:
        """Open the wire again, as often as it takes."""
        pause_s = FIRST_PAUSE_S
        while self.wire is None:
            self._tell(f"the link is lost: {why}; trying again in {pause_s:g} s")
            await asyncio.sleep(pause_s)
            try:
                self.wire = await opener(self._config)(self._config, self)
            except OSError as error:
                why = f"cannot open {self._config.address} ({error.strerror or error})"
                pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
        self._tell("the wire is back: waiting for the autopilot's HEARTBEAT")
