"""Simulated tracker programs with a protocol of requests: Qualisys Track Manager and Motive.

QTM's real-time protocol over TCP, as far as qtm-rt needs it for 6D bodies; Motive answers NatNet clients and streams
rigid bodies to them, or to a multicast group.
"""

import asyncio
from collections.abc import Sequence
from typing import Any

from groundstation.core.geometry import frames_of
from groundstation.pose.sources import NatNetConfig, QualisysConfig, UnreadableNatNet, send_by
from groundstation.pose.sources import natnet_codec as natnet
from groundstation.pose.sources import qualisys_codec as qtm
from links.io import parse_address
from sim.trackers.trackers import CLOCK_AHEAD_S, TrackedBody

MOST_UNREAD = 1 << 18
"""A client that leaves more than this unread gets no frames until it has caught up [bytes]."""


class QtmServer:
    """Implements :class:`sim.trackers.trackers.Tracker` at the address where ``config`` expects QTM."""

    def __init__(self, config: QualisysConfig) -> None:
        """Nothing is opened yet."""
        self._frames = frames_of(config)
        self.names: tuple[str, ...] = (config.name,)
        self._address = parse_address(config.server)
        self._server: asyncio.AbstractServer | None = None
        self.clients: set[Client] = set()

    async def open(self) -> None:
        """Listen for clients."""
        self._server = await asyncio.get_running_loop().create_server(lambda: Client(self), *self._address)

    def close(self) -> None:
        """Leave the network."""
        for client in tuple(self.clients):
            client.close()
        if self._server is not None:
            self._server.close()
            self._server = None

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Stream one frame."""
        self.names = tuple(seen.name for seen in bodies)
        data = self.encode(frame, exposure_s, bodies)
        for client in self.clients:
            client.stream(data)

    def encode(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        """The data packet of one frame; a hidden body is full of NaN."""
        poses = [seen.pose(self._frames) if seen.tracked else None for seen in bodies]
        return qtm.encode_data(round((exposure_s + CLOCK_AHEAD_S) * 1e6), frame, poses)


class Client(asyncio.Protocol):
    """One connection."""

    def __init__(self, server: QtmServer) -> None:
        """Not yet asked for anything."""
        self._server = server
        self._framer = qtm.Framer()
        self._streaming = False
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Greet (called by the event loop)."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._server.clients.add(self)
        self._say(qtm.COMMAND, "QTM RT Interface connected")

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget (called by the event loop)."""
        self._transport = None
        self._server.clients.discard(self)

    def data_received(self, data: bytes) -> None:
        """Answer commands (called by the event loop)."""
        for packet in self._framer.feed(data):
            self._answer(packet[8:].rstrip(b"\0").decode("ascii", "replace").lower())
        if self._framer.broken:
            self.close()

    def _answer(self, command: str) -> None:
        match command.split():
            case ["version", version]:
                self._say(qtm.COMMAND, f"Version set to {version}")
            case ["getparameters", *_]:
                self._say(qtm.XML, qtm.parameters_xml(self._server.names))
            case ["streamframes", "stop"]:
                self._streaming = False
            case ["streamframes", *_]:
                self._streaming = True
            case _:
                self._say(qtm.ERROR, "Parse error")

    def _say(self, kind: int, text: str) -> None:
        if self._transport is not None:
            self._transport.write(qtm.text_packet(kind, text))

    def stream(self, data: bytes) -> None:
        """Send one frame to whoever asked for frames."""
        transport = self._transport
        if self._streaming and transport is not None and transport.get_write_buffer_size() < MOST_UNREAD:
            transport.write(data)

    def close(self) -> None:
        """Hang up."""
        if self._transport is not None:
            self._transport.close()


TICKS_PER_S = 10_000_000
"""Windows' performance counter."""
FORGET_S = 5.0
"""A unicast client that has not been heard for so long is gone [s]."""
MOST_CLIENTS = 16


class NatNetServer(asyncio.DatagramProtocol):
    """Implements :class:`sim.trackers.trackers.Tracker` at the address where ``config`` expects its server."""

    def __init__(self, config: NatNetConfig, version: natnet.Version = (4, 1)) -> None:
        """Speak NatNet ``version``."""
        self._config = config
        self._frames = frames_of(config)
        host, port = parse_address(config.server)
        self._address = (host, port)
        self.info = natnet.ServerInfo("Motive", version, TICKS_PER_S, config.data_port, config.multicast, config.group)
        self._transport: asyncio.DatagramTransport | None = None
        self._clients: dict[Any, float] = {}
        self._ids: dict[str, int] = {config.name: 1}

    async def open(self) -> None:
        """Listen for clients."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=self._address)
        if self._config.multicast:
            send_by(self._transport, self._config.interface)

    def close(self) -> None:
        """Leave the network."""
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Answer a client (called by the event loop)."""
        try:
            number, _ = natnet.split(data)
        except UnreadableNatNet:
            return
        if addr in self._clients or len(self._clients) < MOST_CLIENTS:
            self._clients[addr] = asyncio.get_running_loop().time()
        if number == natnet.CONNECT:
            self._answer(natnet.encode_server_info(self.info), addr)
        elif number == natnet.REQUEST_MODELDEF:
            self._answer(self.models(), addr)

    def _answer(self, data: bytes, addr: Any) -> None:
        if self._transport is not None:
            self._transport.sendto(data, addr)

    def send(self, frame: int, exposure_s: float, bodies: Sequence[TrackedBody]) -> None:
        """Stream one frame."""
        now_s = asyncio.get_running_loop().time()
        config = self._config
        data = self.encode(frame, exposure_s, now_s, bodies)
        if config.multicast:
            self._answer(data, (config.group, config.data_port))
            return
        self._clients = {client: heard for client, heard in self._clients.items() if now_s - heard < FORGET_S}
        for client in self._clients:
            self._answer(data, client)

    def models(self) -> bytes:
        """The bodies that were streamed so far."""
        return natnet.encode_models(self._ids, self.info.version)

    def encode(self, frame: int, exposure_s: float, transmit_s: float, bodies: Sequence[TrackedBody]) -> bytes:
        """One frame; a hidden body's last pose is marked as not tracked."""
        rigid = []
        for seen in bodies:
            position, (w, x, y, z) = seen.pose(self._frames)
            number = self._ids.setdefault(seen.name, len(self._ids) + 1)
            rigid.append(natnet.RigidBody(number, position, (x, y, z, w), 0.0002, seen.tracked))
        exposure, transmit = (round((s + CLOCK_AHEAD_S) * TICKS_PER_S) for s in (exposure_s, transmit_s))
        return natnet.encode_frame(
            natnet.NatNetFrame(frame, tuple(rigid), exposure, transmit), self.info.version, ticks_per_s=TICKS_PER_S
        )
