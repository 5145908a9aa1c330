"""Assembly of a flight from one configuration: link, pose source, gate, operator's hold, recorder.

A recorded flight hands over to a recorder all data that a replay needs, as they occur. Its wires
are tapped, too: its network notes every byte in and out, whatever link or source opens them. The
wires of the pacer's own process are not recorded.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Any

from groundstation.config import dump
from groundstation.core.messages import (
    CommandSent,
    EndRecord,
    FlightEvent,
    Notice,
    Others,
    OverheardSource,
    Pose,
    PoseRecord,
    PoseSource,
    Say,
    Sentence,
    StatusRecord,
    Subscriber,
    notice,
)
from groundstation.core.pilot import MONITORS, Monitors
from groundstation.flight.flight import Flight
from groundstation.flight.hold_to_run import make_hold
from groundstation.flight.preflight import SurroundingsChecks
from groundstation.machine import IdleSlots, Running
from groundstation.pose import ForwardingSource, make_source
from groundstation.pose.sources import GatedSource
from groundstation.recording import (
    NO_PORT,
    About,
    LineRecord,
    Peer,
    ReceivedRecord,
    Record,
    RecorderProcess,
    SentRecord,
    WireRecord,
)
from groundstation.settings import Config
from links import make_link
from links.core import CommandLink
from links.io import Network
from links.mavlink import MavlinkLink


class WireTaps(Network):
    """Network of one flight that taps its wires: UDP, TCP or serial."""

    def __init__(self, give: Callable[[Record], None]) -> None:
        """``give`` takes each record as it occurs."""
        self._give = give
        self._opened = 0
        self._turn = 0
        self._turn_begun = False

    async def open_datagram(
        self,
        factory: Callable[[], Any],
        local: Any = None,
        remote: Any = None,
        *,
        reuse_port: bool | None = None,
    ) -> tuple[Any, Any]:
        """Open a datagram endpoint."""
        tap = TappedProtocol(self, "udp", local, remote, factory)
        await super().open_datagram(tap.begin, local, remote, reuse_port=reuse_port)
        return tap.transport, tap.inner

    async def open_stream(
        self, factory: Callable[[], Any], host: str, port: int
    ) -> tuple[Any, Any]:
        """Open a connection."""
        tap = TappedProtocol(self, "tcp", None, (host, port), factory)
        await super().open_stream(tap.begin, host, port)
        return tap.transport, tap.inner

    async def open_serial(
        self, factory: Callable[[], Any], path: str, baud: int
    ) -> tuple[Any, Any]:
        """Open a serial port."""
        tap = TappedProtocol(self, "serial", None, (path, NO_PORT), factory)
        await super().open_serial(tap.begin, path, baud)
        return tap.transport, tap.inner

    def note_opening(self, kind: str, local: Any, remote: Any) -> int:
        """Note that a wire was opened, and return its number."""
        number = self._opened
        self._opened += 1
        self._give(
            WireRecord(asyncio.get_running_loop().time(), number, kind, _peer(local), _peer(remote))
        )
        return number

    def note_received(self, wire: int, data: bytes, peer: Any) -> None:
        """Note received bytes."""
        if not self._turn_begun:
            self._turn_begun = True
            asyncio.get_running_loop().call_soon(self._next_turn)
        self._give(
            ReceivedRecord(asyncio.get_running_loop().time(), wire, self._turn, _peer(peer), data)
        )

    def note_sent(self, wire: int, data: bytes, peer: Any) -> None:
        """Note sent bytes."""
        self._give(SentRecord(asyncio.get_running_loop().time(), wire, _peer(peer), bytes(data)))

    def _next_turn(self) -> None:
        self._turn += 1
        self._turn_begun = False


def _peer(address: Any) -> Peer:
    return None if address is None else (address[0], address[1])


class TappedProtocol:
    """Wrapper of the protocol of one wire that notes its bytes.

    All else is passed to the protocol.
    """

    def __init__(
        self, wires: WireTaps, kind: str, local: Any, remote: Any, factory: Callable[[], Any]
    ) -> None:
        """``kind`` of wire, with the requested addresses; ``factory`` makes the protocol."""
        self._wires = wires
        self._asked = kind, local, remote
        self._factory = factory
        self._wire = -1
        self.inner: Any = None
        self.transport: Any = None

    def begin(self) -> "TappedProtocol":
        """Make the protocol."""
        self.inner = self._factory()
        return self

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def connection_made(self, transport: Any) -> None:
        """The wire is open: tap its transport, too."""
        self._wire = self._wires.note_opening(*self._asked)
        self.transport = TappedTransport(transport, self._wires, self._wire)
        self.inner.connection_made(self.transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Note it, and pass it on."""
        self._wires.note_received(self._wire, data, addr)
        self.inner.datagram_received(data, addr)

    def data_received(self, data: bytes) -> None:
        """Note it, and pass it on."""
        self._wires.note_received(self._wire, data, None)
        self.inner.data_received(data)


class TappedTransport:
    """Wrapper of a transport or a socket that notes sent bytes.

    All else is passed to the original.
    """

    def __init__(self, original: Any, wires: WireTaps, wire: int) -> None:
        self._original = original
        self._wires = wires
        self._wire = wire

    def __getattr__(self, name: str) -> Any:
        return getattr(self._original, name)

    def write(self, data: bytes) -> None:
        """Write to a connection."""
        self._original.write(data)
        self._wires.note_sent(self._wire, data, None)

    def sendto(self, data: bytes, addr: Any = None) -> Any:
        """Send by a datagram endpoint or a socket."""
        done = self._original.sendto(data, addr)
        self._wires.note_sent(self._wire, data, addr)
        return done

    def send(self, data: bytes) -> Any:
        """Send by a socket or a serial port."""
        done = self._original.send(data)
        self._wires.note_sent(self._wire, data, None)
        return done

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """Tap the socket, too: some senders bypass the transport and its buffer."""
        found = self._original.get_extra_info(name, default)
        return (
            TappedTransport(found, self._wires, self._wire)
            if name == "socket" and found is not None
            else found
        )

    def dup(self) -> Any:
        """Return a second handle of a socket."""
        return TappedTransport(self._original.dup(), self._wires, self._wire)


def make_ends(
    config: Config, wires: Mapping[str, Any] | None = None, others: Others | None = None
) -> tuple[CommandLink, PoseSource]:
    """Make the link and the pose source that ``config`` names; nothing is opened yet.

    ``wires`` replaces the link's hardware in a simulation; see :func:`links.make.make_link`.
    ``others`` are further bodies that the source looks for.

    Raises:
        ConfigError: the poses need another link.
    """
    link = make_link(
        config.link,
        thrust_max_n=config.full_thrust_n,
        thrust_curve=config.thrust_curve,
        **(wires or {}),
    )
    if link.autopilot is not None:
        link.autopilot.shares_poses = config.pose.shares_link
    return link, make_source(config.pose, link, others)


Give = Callable[[Record], None]
"""Takes records in their order, and never waits; what it raises ends no flight."""


STATUS_S = 0.2
"""Period of the link's and the source's status records [s]."""


class FlightRecorder:
    """Hands over the events of a flight, and its wires, as records.

    Its faults never end the flight.
    """

    def __init__(self, give: Give, say: Say, link: CommandLink, source: PoseSource) -> None:
        """``give`` takes the records; ``say`` gets one warning if one could not be taken.

        The status of ``link`` and ``source`` is recorded periodically.
        """
        self._recorder = give
        self._say = say
        self._link = link
        self._source = source
        self._has_failed = False
        self._sent_s = self._noted_s = -math.inf

    def take(self, event: FlightEvent) -> None:
        """Take an event, after all other subscribers."""
        match event:
            case PoseRecord(pose):
                self.give(event)
                # Not while a pose waits for its command.
                if pose.arrival_s - self._sent_s > STATUS_S:
                    self._note_status()
            case CommandSent(tick):
                self._sent_s = tick.time_s
                self._note_status()
            case Notice(time_s, state, text):
                self.give(LineRecord(time_s, state, text, event.id, event.numbers))
            case EndRecord():
                self._note_status(0.0)
                self.give(event)
            case _:
                self.give(event)

    def _note_status(self, period_s: float = STATUS_S) -> None:
        """Record the status of link and source, unless that was done within ``period_s`` [s]."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._noted_s >= period_s:
            self._noted_s = now_s
            self.give(StatusRecord(now_s, self._link.status, self._source.status))

    def give(self, record: Record) -> None:
        """Hand over one record."""
        try:
            self._recorder(record)
        except Exception as error:  # noqa: BLE001  # a controller of the user's own may put anything into a tick
            if not self._has_failed:
                self._has_failed = True
                self._say(notice("recording.unrecordable", why=error))


def about(config: Config, **more: Any) -> About:
    """Collect the facts known before the flight; ``more`` are those of a simulated one."""
    link = config.link
    return About(
        config=dump(config),
        vehicle=config.vehicle.name,
        controller=config.controller.kind,
        trajectory=str(config.trajectory.__struct_config__.tag),
        period_s=0.0 if link.follows_poses or link.period_s is None else link.period_s,
        mavlink=link.endpoint if link.has_autopilot else "",
        **more,
    )


def make_flight(
    config: Config,
    *,
    confirm: Callable[[], Awaitable[bool]],
    subscribers: Sequence[Subscriber] = (),
    on_pose: Callable[[Pose], None] | None = None,
    wires: Mapping[str, Any] | None = None,
    give: Give | None = None,
    quiet: IdleSlots | None = None,
    running: Callable[[], Sequence[Running]] = tuple,
    monitors: Monitors = MONITORS,
) -> Flight:
    """Make the flight that ``config`` describes; nothing is opened yet.

    Args:
        config: the whole configuration.
        confirm: asks the operator before the vehicle is armed.
        subscribers: get all events.
        on_pose: gets every pose first, also those that the gate will drop.
        wires: see :func:`make_ends`.
        give: takes the records of the flight; None for a flight that is not recorded.
        quiet: is notified of each command that left.
        running: lists the other flights of this machine.
        monitors: makes the monitors that may end the flight.

    Raises:
        ConfigError: the poses need another link.
    """
    bodies = None
    if config.pose.shows_others:
        bodies = Others(
            config.separation.others,
            own=config.pose.body_id if config.flight.start == "floor" else None,
        )
    link, source = make_ends(config, wires, bodies)
    hold = make_hold(config.operator, link)
    if on_pose is not None:
        source = OverheardSource(source, on_pose)

    def say(sentence: Sentence) -> None:
        flight.say(sentence)

    source = GatedSource(source, config.gate, lost_s=config.flight.coast_s, say=say)
    if config.forwards is not None:
        assert isinstance(link, MavlinkLink), "only a MAVLink section can forward"
        floor_z_m = config.flight.floor_z_m
        source = ForwardingSource(
            source,
            link,
            config.forwards,
            floor_z_m=floor_z_m,
            believes=lambda: flight.believes_poses,
        )
    tape = None
    if give is not None:
        tape = FlightRecorder(give, say, link, source)
        subscribers = *subscribers, tape.take
    flight = Flight(
        config,
        link,
        source,
        confirm=confirm,
        subscribers=subscribers,
        network=None if tape is None else WireTaps(tape.give),
        others=bodies if config.separation.others else None,
        idle_slots=quiet or IdleSlots(),
        surroundings=SurroundingsChecks(
            config, bodies, running, None if hold is None else hold.hold
        ),
        hold=hold,
        monitors=monitors,
    )
    return flight


@asynccontextmanager
async def recorder(
    config: Config,
    say: Say,
    quiet: IdleSlots,
    keep: Callable[[], bool] = lambda: True,
    *,
    describe_tracking_error: Callable[[], Sentence | None] = lambda: None,
) -> AsyncIterator[Give | None]:
    """Record a flight in real time by a process of its own; None without ``recording.enabled``.

    Records are handed over in ``quiet`` slots. ``keep`` returns at the end whether the recording is
    kept. If the recorder has not told the flight's tracking error, ``describe_tracking_error``
    returns the sentence about it.
    """
    process = None
    if config.recording.enabled:
        process = RecorderProcess(config.recording, about(config), say, quiet)
    try:
        yield None if process is None else process.give
    finally:
        kept = keep()
        if process is not None:
            await process.close(keep=kept)
        if kept and (process is None or not process.has_told_error):
            error = describe_tracking_error()
            if error is not None:
                say(error)
