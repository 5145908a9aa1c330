"""A simulated Motive: answers NatNet clients and streams rigid bodies to them, or to a multicast group."""

import asyncio
from collections.abc import Sequence
from typing import Any

from groundstation.core.geometry import frames_of
from groundstation.pose.sources import NatNetConfig, UnreadableNatNet, send_by
from groundstation.pose.sources import natnet_codec as natnet
from links.io import parse_address
from sim.trackers.trackers import CLOCK_AHEAD_S, Seen

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

    def send(self, frame: int, exposure_s: float, bodies: Sequence[Seen]) -> None:
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

    def encode(self, frame: int, exposure_s: float, transmit_s: float, bodies: Sequence[Seen]) -> bytes:
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
