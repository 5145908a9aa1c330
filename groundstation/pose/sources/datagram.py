"""Sources on the event loop: one behind the outlier gate, and one that listens on a UDP socket.

Multicast groups are joined here, too, by options of sockets that the event loop has opened.

Poses from a home-made tracker that sends JSON (json_codec.py has the schema).
"""

import asyncio
import socket
from collections import Counter
from collections.abc import Callable
from typing import Annotated, ClassVar

import msgspec

from groundstation.core.geometry import Alignment, BodyAxes, LabAlignment, LabAxes, frames_of
from groundstation.core.messages import (
    Others,
    Pose,
    PoseKind,
    PoseSource,
    PoseStatus,
    Sentence,
    SourceError,
    notice,
)
from groundstation.pose.sources.intake import (
    Gate,
    GateConfig,
    Intake,
    Outbreaks,
    PoseReader,
    ReaderSource,
)
from groundstation.pose.sources.json_codec import MAX_NAME, JsonReader
from links.io import NETWORK, advise_on_address, parse_address, remote_setting

LOOK_S = 0.0493717
"""Period at which drop counters and lost poses are examined [s].

Not a round number: a timer more at the very instants of cameras and frames would change the last
bits of a simulation."""


class GatedSource:
    """Implements :class:`groundstation.core.messages.PoseSource`: passes the plausible poses on."""

    def __init__(
        self,
        source: PoseSource,
        config: GateConfig,
        *,
        lost_s: float,
        say: Callable[[Sentence], None],
    ) -> None:
        """``say`` takes news of the poses for the operator.

        They are lost after ``lost_s`` [s] without one.

        A pose that is older than that on arrival is counted and dropped: no command could use it.
        """
        self._source = source
        self._lost_s = lost_s
        self._gate = Gate(config)
        self._outbreaks = Outbreaks(lost_s)
        self._say = say
        self._next_look: asyncio.TimerHandle | None = None

    @property
    def status(self) -> PoseStatus:
        """Counters of the source, and those of the gate."""
        status, dropped = self._source.status, self._gate.dropped
        newest = self._gate.newest
        moves = 0 if newest is None else self._gate.count_moves(newest.arrival_s)
        return msgspec.structs.replace(
            status,
            origin_moves=moves,
            accepted=status.accepted - dropped.total(),
            dropped=dict(Counter(status.dropped) + dropped),
            excesses=dict(self._gate.excesses),
        )

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Start the source; ``deliver`` gets each pose that passes."""

        def take(pose: Pose) -> None:
            age_s = pose.arrival_s - pose.time_s
            if age_s > self._lost_s:
                self._gate.drop("late", (1e3 * age_s, 1e3 * self._lost_s))
                return
            passed, news = self._gate.filter_pose(pose)
            if news is not None:
                self._say(news)
            if passed is not None:
                deliver(passed)

        await self._source.start(take)
        self._look()

    async def close(self) -> None:
        """Close the source."""
        if self._next_look is not None:
            self._next_look.cancel()
            self._next_look = None
        await self._source.close()

    def _look(self) -> None:
        loop = asyncio.get_running_loop()
        for news in self._outbreaks.look(loop.time(), self.status, self._gate.newest):
            self._say(news)
        self._next_look = loop.call_later(LOOK_S, self._look)


class DatagramSource(ReaderSource, asyncio.DatagramProtocol):
    """Implements :class:`groundstation.core.messages.pose.PoseSource` on one UDP socket."""

    def __init__(self, what: str, listen: str, reader: PoseReader) -> None:
        """``what`` names the poses that come to ``listen`` (host:port) for the operator.

        Nothing is opened yet.
        """
        super().__init__(reader)
        self._what = what
        self._listen = listen
        self._transport: asyncio.DatagramTransport | None = None

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Begin to listen; ``deliver`` is called on the event loop for each pose."""
        self._begin(deliver, asyncio.get_running_loop().time)
        try:
            self._transport, _ = await NETWORK.get().open_datagram(
                lambda: self, parse_address(self._listen)
            )
        except OSError as error:
            raise cannot_listen(self._what, self._listen, error) from error

    async def close(self) -> None:
        """Stop listening; no pose is delivered afterwards."""
        self._deliver = None
        if self._transport is not None:
            self._transport.close()
            self._transport = None

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take one datagram (called by the event loop)."""
        self._reader.sender = addr
        self._take(data)


def cannot_listen(what: str, address: str, error: OSError) -> SourceError:
    """Describe ``error`` for the operator: what was to arrive where, and what to do."""
    why, advice = error.strerror or str(error), advise_on_address(error)
    return SourceError(
        notice("pose.cannot_listen", what=what, address=address, why=why, advice=advice)
    )


def join(transport: asyncio.DatagramTransport, group: str, interface: str) -> None:
    """Join ``group`` with the socket of ``transport`` by way of ``interface`` (IPv4 addresses).

    Raises:
        OSError: this machine has no such interface, or ``group`` is no multicast address.
    """
    membership = socket.inet_aton(group) + socket.inet_aton(interface)
    transport.get_extra_info("socket").setsockopt(
        socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership
    )


def send_by(transport: asyncio.DatagramTransport, interface: str) -> None:
    """Send to groups from the socket of ``transport`` by way of ``interface`` (IPv4 address).

    Raises:
        OSError: this machine has no such interface.
    """
    options = transport.get_extra_info("socket")
    options.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))


class AtAddress(PoseKind, frozen=True, kw_only=True):
    """Base of configurations with one address: ours to listen at, or the server's."""

    address_key: ClassVar[str] = "listen"

    def __post_init__(self) -> None:
        parse_address(self.address, self.address_key)

    @property
    def real(self) -> str | None:
        """The key by which real poses may come, and its value.

        None where all stays on this machine.
        """
        return remote_setting(self.address_key, self.address)


class JsonConfig(AtAddress, frozen=True, kw_only=True, tag="json"):
    """JSON objects over UDP, one or an array of them a datagram."""

    shows_others: ClassVar[bool] = True
    is_relayed: ClassVar[bool] = True
    body_key: ClassVar[str] = "name"
    stamp_field: ClassVar[str] = "t"
    name: Annotated[
        str,
        msgspec.Meta(min_length=1, max_length=MAX_NAME, description="Name of the vehicle's body."),
    ] = "quad"
    listen: Annotated[
        str,
        msgspec.Meta(description="Address that the tracker sends to, host:port of this machine."),
    ] = "127.0.0.1:51002"
    world: LabAxes = "nwu"
    body: BodyAxes = "flu"
    alignment: LabAlignment = Alignment()
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="Shortest time from the instant that the tracker stamps to the arrival "
            "here [s].",
        ),
    ] = 0.02
    rate_hz: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=1000.0,
            description="Frames per second [1/s], for a tracker that numbers its frames and has no "
            "clock; found by itself if wrong.",
        ),
    ] = 50.0

    def build(self, others: Others | None = None) -> DatagramSource:
        """Make the source; ``others`` are further bodies to look for."""
        intake, frames = (
            Intake(self.latency_s, frames_of(self), frame_s=seconds, others=others)
            for seconds in (1.0, 1.0 / self.rate_hz)
        )
        return DatagramSource("JSON poses", self.listen, JsonReader(self.name, intake, frames))
