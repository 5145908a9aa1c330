"""MAVLink over UDP: waiting for an autopilot that speaks first (``listen``), or speaking first (``remote``)."""

import asyncio
from typing import Any

from links.io import Datagrams, parse_address
from links.mavlink.protocol import MavlinkLinkConfig
from links.mavlink.transport.wire import Ear


class UdpWire(asyncio.DatagramProtocol):
    """Implements :class:`~links.mavlink.transport.wire.Wire`. Never gone: a network that was away comes back itself."""

    datagrams = True

    def __init__(self, ear: Ear, *, speaks_first: bool) -> None:
        """Opened by the event loop."""
        self.speaks_first = speaks_first
        self._ear: Ear | None = ear
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


async def open_udp(config: MavlinkLinkConfig, ear: Ear) -> UdpWire:
    """Open ``listen`` or ``remote``; raises OSError."""
    address = parse_address(config.address)
    first = config.remote is not None
    local, remote = (None, address) if first else (address, None)
    loop = asyncio.get_running_loop()
    _, wire = await loop.create_datagram_endpoint(
        lambda: UdpWire(ear, speaks_first=first), local_addr=local, remote_addr=remote
    )
    return wire
