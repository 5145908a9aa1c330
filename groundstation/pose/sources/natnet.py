"""Poses from OptiTrack: the stream of Motive's NatNet server (bytes: natnet_codec.py)."""

import asyncio
import ipaddress
from collections.abc import Callable
from typing import Annotated, Any, ClassVar

import msgspec

from groundstation.core.geometry import Alignment, Body, LabAlignment, World, frames_of
from groundstation.core.messages import Others, Pose, notice
from groundstation.pose.sources.datagram import AtAddress, cannot_listen, join
from groundstation.pose.sources.intake import Intake, ReaderSource
from groundstation.pose.sources.natnet_codec import NatNetReader
from links.io import NETWORK, is_loopback, parse_address

BEAT_S = 0.5
"""Period of the keep-alive to the server [s]."""


class NatNetConfig(AtAddress, frozen=True, kw_only=True, tag="natnet"):
    """OptiTrack's NatNet 3.0 to 4.x, straight from Motive. Its exposure stamps give the age of each
    pose.
    """

    shows_others: ClassVar[bool] = True
    body_key: ClassVar[str] = "name"
    address_key: ClassVar[str] = "server"
    latency_key: ClassVar[str] = "network_s"
    stamp_field: ClassVar[str] = "Motive's transmit time, by the clock frequency that it reports,"
    name: Annotated[
        str,
        msgspec.Meta(
            min_length=1, max_length=256, description="Name of the vehicle's rigid body in Motive."
        ),
    ] = "quad"
    id: Annotated[
        int | None,
        msgspec.Meta(description="Its streaming id; without it the server is asked for the name."),
    ] = None
    server: Annotated[
        str, msgspec.Meta(description="Command address of the machine that runs Motive, IPv4:port.")
    ] = "127.0.0.1:1510"
    interface: Annotated[
        str, msgspec.Meta(description="This machine's own IPv4 address in that network.")
    ] = "127.0.0.1"
    multicast: Annotated[
        bool,
        msgspec.Meta(
            description="Whether Motive is set to transmit by multicast; else it sends to us alone."
        ),
    ] = False
    group: Annotated[
        str, msgspec.Meta(description="Multicast group, where `multicast` is set.")
    ] = "239.255.42.99"
    data_port: Annotated[
        int, msgspec.Meta(ge=1, le=65535, description="UDP port of the multicast stream.")
    ] = 1511
    world: Annotated[
        World,
        msgspec.Meta(
            description="Axes of the lab frame: `nue` for Motive's up axis Y, `nwu` for its up "
            "axis Z."
        ),
    ] = "nue"
    body: Annotated[
        Body,
        msgspec.Meta(
            description="Axes of the rigid body, made with its nose along x: `fur` where up is Y, "
            "`flu` where up is Z."
        ),
    ] = "fur"
    alignment: LabAlignment = Alignment()
    network_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=0.1,
            description="Shortest network time of a frame [s]; Motive itself reports its age at "
            "transmission.",
        ),
    ] = 0.0003

    def __post_init__(self) -> None:
        super().__post_init__()
        host, _ = parse_address(self.server)
        for key, text in (("server", host), ("interface", self.interface), ("group", self.group)):
            try:
                address = ipaddress.IPv4Address(text)
            except ValueError:
                raise ValueError(notice("keys.ipv4", key=key, found=text)) from None
            if address.is_multicast != (key == "group"):
                id = "keys.multicast" if key == "group" else "keys.no_multicast"
                raise ValueError(notice(id, key=key, found=text))

    @property
    def body_id(self) -> str:
        """The body, by its streaming id if that is configured."""
        return self.name if self.id is None else f"id {self.id}"

    @property
    def stream(self) -> tuple[object, ...]:
        """Key of the camera stream, equal for all vehicles that it shows."""
        return (*super().stream, self.multicast, self.group, self.data_port)

    @property
    def real(self) -> str | None:
        """The key by which real poses may come, and its value.

        None where all stays on this machine.
        """
        here = None if is_loopback(self.interface) else f"interface = {self.interface}"
        return super().real or here

    def build(self, others: Others | None = None) -> "NatNetSource":
        """The source of this config; ``others`` are further bodies to look for."""
        return NatNetSource(self, others)


class NatNetSource(ReaderSource, asyncio.DatagramProtocol):
    """Implements :class:`groundstation.core.messages.PoseSource`, with one or two sockets.

    A unicast server streams to the socket that its client's commands come from.
    """

    _reader: NatNetReader

    def __init__(self, config: NatNetConfig, others: Others | None = None) -> None:
        intake = Intake(config.network_s, frames_of(config), others=others)
        super().__init__(
            NatNetReader(config.name, intake, body_id=config.id, keep_alive=not config.multicast)
        )
        self._config = config
        self._server = parse_address(config.server)
        self._command: asyncio.DatagramTransport | None = None
        self._data: asyncio.DatagramTransport | None = None
        self._next_beat: asyncio.TimerHandle | None = None

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Begin to listen and to ask; ``deliver`` is called on the event loop for each pose."""
        self._begin(deliver, asyncio.get_running_loop().time)
        config = self._config
        local = (config.interface, 0)
        try:
            self._command, _ = await NETWORK.get().open_datagram(lambda: self, local)
            if config.multicast:
                # A group is received by sockets bound to its address; others on this machine may
                # listen as well.
                local = (config.group, config.data_port)
                self._data, _ = await NETWORK.get().open_datagram(
                    lambda: self, local, reuse_port=True
                )
                join(self._data, config.group, config.interface)
        except OSError as error:
            await self.close()
            raise cannot_listen("NatNet poses", f"{local[0]}:{local[1]}", error) from error
        self._beat()

    async def close(self) -> None:
        """Stop listening; no pose is delivered afterwards."""
        self._deliver = None
        if self._next_beat is not None:
            self._next_beat.cancel()
        for transport in (self._command, self._data):
            if transport is not None:
                transport.close()
        self._next_beat = self._command = self._data = None

    def _beat(self) -> None:
        self._send_due()
        self._next_beat = asyncio.get_running_loop().call_later(BEAT_S, self._beat)

    def _send_due(self) -> None:
        if self._command is not None:
            for message in self._reader.due():
                self._command.sendto(message, self._server)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        if self._deliver is None:
            return
        if addr[0] != self._server[0]:
            self._reader.take_from_other(data, str(addr[0]), self._server[1])
            return
        server = self._reader.server
        self._take(data)
        if self._reader.server is not server:  # it has just answered: send the next request
            self._send_due()
