"""Wires to an autopilot: UDP, TCP and serial ports, opened again when lost.

A frame leaves at once or never. TCP repeats what got lost, so a command may arrive late. Against
that a frame is dropped where older ones have waited for their acknowledgement for longer than
``TCP_QUEUE_S``, and after ``STUCK_S`` of that the connection is reset (SO_LINGER 0). What the other
end has acknowledged and not read yet is out of our hands: prefer UDP where there is a choice.
"""

import asyncio
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable
from errno import EADDRINUSE
from typing import Any

from links.core import REOPEN_S, STUCK_S, LinkError, LinkLost
from links.io import (
    NETWORK,
    Datagrams,
    advise_on_address,
    explain_error,
    parse_address,
    waiting,
)
from links.mavlink.protocol import MavlinkLinkConfig
from links.text import Sentence, link_notice


class UdpTransport(asyncio.DatagramProtocol):
    """UDP socket. It is never lost: a network that was away comes back by itself."""

    datagrams = True
    """Whether received data holds whole frames."""

    def __init__(self, owner: "ReconnectingTransport", *, speaks_first: bool) -> None:
        self.speaks_first = speaks_first
        """Whether the address of the autopilot is known before it is heard."""
        self._owner: ReconnectingTransport | None = owner
        self._out: Datagrams

    def send(self, frame: bytes, to: Any) -> str:
        """Send one datagram; return why it was dropped instead, empty where it was not."""
        return self._out.send(frame, to)

    def cut(self) -> None:
        """Close the socket."""
        self._owner = None
        self._out.abort()

    def connection_made(self, transport: asyncio.DatagramTransport) -> None:  # type: ignore[override]  # it is one
        """Keep the socket (called by the event loop)."""
        self._out = Datagrams(transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Pass it on (called by the event loop)."""
        if self._owner is not None:
            self._owner.receive(data, addr)

    def error_received(self, exc: Exception) -> None:
        """Pass it on (called by the event loop)."""
        if self._owner is not None:
            self._owner.count_undeliverable()


TCP_QUEUE_S = 0.1
"""Frames may wait for the other end this long [s]; a delayed acknowledgement takes 0.04."""


class StreamTransport(asyncio.Protocol):
    """Base of the TCP and the serial transport: bytes in order, until cut or lost."""

    datagrams = False
    speaks_first = True

    def __init__(self, owner: "ReconnectingTransport") -> None:
        self._owner: ReconnectingTransport | None = owner
        self._transport: Any = None
        """The connection, or the port."""

    def connection_made(self, transport: Any) -> None:
        """Keep it (called by the event loop, or by the port)."""
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Pass it on (called by the event loop, or by the port)."""
        if self._owner is not None:
            self._owner.receive(data, None)

    def cut(self) -> None:
        """Reset the connection, or close the port."""
        self._owner = None
        self._transport.abort()

    def _end(self, why: str) -> None:
        owner = self._owner
        self.cut()
        if owner is not None:
            owner.lose_transport(why)


class TcpTransport(StreamTransport):
    """TCP connection. Frames that do not leave soon enough are dropped, and then the connection."""

    def __init__(self, owner: "ReconnectingTransport") -> None:
        super().__init__(owner)
        self._loop = asyncio.get_running_loop()
        self._sent = 0
        self._unacknowledged: deque[tuple[int, float]] = deque()
        """For each frame: number of bytes sent up to its end, and when [s]."""
        self._timer: asyncio.TimerHandle | None = None

    def send(self, frame: bytes, to: Any) -> str:
        """Send one frame; return why it was dropped instead, empty where it was not."""
        transport = self._transport
        if (
            transport.is_closing()
            or transport.get_write_buffer_size()
            or self._find_wait_s() > TCP_QUEUE_S
        ):
            return "full"
        transport.write(frame)
        self._sent += len(frame)
        self._unacknowledged.append((self._sent, self._loop.time()))
        if self._timer is None:
            self._timer = self._loop.call_later(TCP_QUEUE_S, self._check_queue)
        return ""

    def _check_queue(self) -> None:
        """End the connection where frames have waited for ``STUCK_S``; look again while any
        wait.
        """
        self._timer = None
        if self._owner is None:
            return
        if self._find_wait_s() > STUCK_S:
            self._end(link_notice("mavlink.tcp_silent").text)
        elif self._unacknowledged:
            self._timer = self._loop.call_later(TCP_QUEUE_S / 4, self._check_queue)

    def _find_wait_s(self) -> float:
        """Return the age of the oldest unacknowledged frame [s]; 0 where there is none."""
        frames = self._unacknowledged
        if frames:
            socket = self._transport.get_extra_info("socket")
            queued = waiting(socket.fileno()) + self._transport.get_write_buffer_size()
            while frames and frames[0][0] <= self._sent - queued:
                frames.popleft()
        return self._loop.time() - frames[0][1] if frames else 0.0

    def cut(self) -> None:
        """Reset the connection."""
        if self._timer is not None:
            self._timer.cancel()
        super().cut()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep it (called by the event loop)."""
        super().connection_made(transport)
        wire = transport.get_extra_info("socket")
        wire.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on (called by the event loop)."""
        says = (
            link_notice("mavlink.tcp_closed")
            if exc is None
            else link_notice("mavlink.tcp_broken", why=exc)
        )
        self._end(says.text)


SERIAL_QUEUE_S = 0.02
"""A frame is dropped where what waits before it takes the port longer than this [s]."""


class SerialTransport(StreamTransport):
    """Serial port, opened by :meth:`links.io.wires.Network.open_serial`."""

    def __init__(self, baud: int, owner: "ReconnectingTransport") -> None:
        super().__init__(owner)
        # A byte takes 10 bits. A signed set-point, 64 bytes, always has room.
        self._room = max(64.0, SERIAL_QUEUE_S * baud / 10.0)
        self._loop = asyncio.get_running_loop()
        self._full_since_s: float | None = None

    def send(self, frame: bytes, to: Any) -> str:
        """Send one frame; return why it was dropped instead, empty where it was not."""
        if self._owner is None:
            return "full"
        if self._transport.waiting() <= self._room and self._write(frame):
            self._full_since_s = None
            return ""
        now = self._loop.time()
        if self._full_since_s is None:
            self._full_since_s = now
        elif now - self._full_since_s > STUCK_S:
            self._end(link_notice("mavlink.port_stuck").text)
        return "full"

    def _write(self, frame: bytes) -> bool:
        try:
            self._transport.send(frame)
        except BlockingIOError:
            return False
        except OSError as error:
            self._end(link_notice("mavlink.port_gone", why=error.strerror).text)
            return False
        return True

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on (called by the port)."""
        self._end(
            link_notice("mavlink.port_gone", why=getattr(exc, "strerror", None) or "unplugged").text
        )


MavlinkTransport = UdpTransport | TcpTransport | SerialTransport


async def open_wire(config: MavlinkLinkConfig, owner: "ReconnectingTransport") -> MavlinkTransport:
    """Open the wire of ``config``.

    Raises:
        OSError: it can't be opened.
    """
    network = NETWORK.get()
    if config.serial is not None:
        _, port = await network.open_serial(
            lambda: SerialTransport(config.baud, owner), config.serial, config.baud
        )
        return port
    address = parse_address(config.endpoint)
    if config.tcp is not None:
        try:
            async with asyncio.timeout(config.connect_timeout_s):
                _, stream = await network.open_stream(lambda: TcpTransport(owner), *address)
        except TimeoutError:
            raise OSError(
                link_notice("mavlink.tcp_nobody", limit_s=config.connect_timeout_s).text
            ) from None
        return stream
    first = config.remote is not None
    local, remote = (config.local_address, address) if first else (address, None)
    _, datagrams = await network.open_datagram(
        lambda: UdpTransport(owner, speaks_first=first), local, remote
    )
    return datagrams


def _explain_failure(config: MavlinkLinkConfig, error: OSError) -> Sentence:
    """Return why the wire can't be opened, and what to do."""
    endpoint, why = config.endpoint, explain_error(error)
    if config.address_key == "remote" and error.errno == EADDRINUSE:
        return link_notice(
            "mavlink.local_port_taken", endpoint=endpoint, why=why, port=config.local_address[1]
        )
    advice = (
        link_notice("address.refused")
        if config.address_key == "serial"
        else advise_on_address(error)
    )
    return link_notice("mavlink.open", endpoint=endpoint, why=why, advice=advice)


class ReconnectingTransport:
    """One wire after the other: a lost one is opened again every ``REOPEN_S``."""

    def __init__(
        self,
        config: MavlinkLinkConfig,
        dropped: Counter[str],
        *,
        on_data: Callable[[bytes, Any], None],
        on_loss: Callable[[str], None],
        on_news: Callable[[str], None],
    ) -> None:
        """Nothing is opened yet.

        Args:
            config: the wire.
            dropped: counts our frames that were dropped or came back, by reason.
            on_data: takes received data and the address that sent it.
            on_loss: takes a sentence for the operator, when the wire has ended by itself.
            on_news: takes a sentence for the operator about opening it again.
        """
        self._config = config
        self._dropped = dropped
        self._on_data, self._on_loss, self._on_news = on_data, on_loss, on_news
        self.wire: MavlinkTransport | None = None
        """The open wire; None while there is none."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._reopening: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Open the wire for the first time.

        Raises:
            LinkLost: it can't be opened.
            LinkError: it was cut before it was open.
        """
        self._loop = asyncio.get_running_loop()
        config = self._config
        try:
            wire = await open_wire(config, self)
        except OSError as error:
            raise LinkLost(_explain_failure(config, error)) from error
        if self._loop is None:
            wire.cut()
            raise LinkError(link_notice("mavlink.closed_early"))
        self.wire = wire

    def cut(self) -> None:
        """Close the wire, and open it no more."""
        wire, reopening = self.wire, self._reopening
        self.wire = self._reopening = self._loop = None
        if reopening is not None:
            reopening.cancel()
        if wire is not None:
            wire.cut()

    def send(self, frame: bytes, to: Any) -> bool:
        """Send ``frame`` to the address ``to``; return whether it left, which it never does on a
        lost wire.
        """
        if self.wire is None:
            return False
        why = self.wire.send(frame, to)
        if why:
            self._dropped[why] += 1
        return not why

    def receive(self, data: bytes, source: Any) -> None:
        """Pass on data from the address ``source`` (called by the wire)."""
        if self.wire is not None:
            self._on_data(data, source)

    def count_undeliverable(self) -> None:
        """Count a frame of ours that the network gave back (called by the wire)."""
        self._dropped["undeliverable"] += 1

    def lose_transport(self, why: str) -> None:
        """Begin to open the wire again (called by the wire)."""
        if self._loop is None:
            return
        self.wire = None
        self._on_loss(_describe_loss(why))
        if self._reopening is not None:
            self._reopening.cancel()
        self._reopening = self._loop.create_task(self._reopen())

    async def _reopen(self) -> None:
        """Open the wire again, as often as it takes."""
        while self.wire is None:
            await asyncio.sleep(REOPEN_S)
            try:
                self.wire = await open_wire(self._config, self)
            except OSError as error:
                self._on_news(
                    _describe_loss(f"cannot open {self._config.endpoint} ({explain_error(error)})")
                )
        self._on_news(link_notice("mavlink.wire_back").text)


def _describe_loss(why: str) -> str:
    """Return why the wire is lost, and what is being done about it."""
    return link_notice("mavlink.lost", why=why, pause_s=REOPEN_S).text
