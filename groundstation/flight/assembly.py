"""Assembly of a flight from one configuration: link, pose source, gate, operator's hold, recorder.

Of a recorded flight everything that it takes to fly it again is handed to a recorder as it happens. Its wires are
tapped, too: it flies on a network that notes every byte in and out, whatever link or source opens them. What the
pacer's own process opens is not seen.
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
from groundstation.core.safety import MONITORS, Monitors
from groundstation.flight.flight import Flight, make_ends
from groundstation.flight.hold_to_run import make_hold
from groundstation.flight.prearm import Company
from groundstation.machine import IdleSlots, Running
from groundstation.pose import ForwardingSource
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
from links.core import CommandLink
from links.io import Network
from links.mavlink import MavlinkLink


class WireTaps(Network):
    """The wires of one flight: opened as ever, and tapped, UDP, TCP or serial."""

    def __init__(self, give: Callable[[Record], None]) -> None:
        """``give`` takes each record as it happens."""
        self._give = give
        self._opened = 0
        self._turn = 0
        self._turn_begun = False

    async def open_datagram(
        self, factory: Callable[[], Any], local: Any = None, remote: Any = None, *, reuse_port: bool | None = None
    ) -> tuple[Any, Any]:
        """A datagram endpoint."""
        tap = TappedProtocol(self, "udp", local, remote, factory)
        await super().open_datagram(tap.begin, local, remote, reuse_port=reuse_port)
        return tap.transport, tap.inner

    async def open_stream(self, factory: Callable[[], Any], host: str, port: int) -> tuple[Any, Any]:
        """A connection."""
        tap = TappedProtocol(self, "tcp", None, (host, port), factory)
        await super().open_stream(tap.begin, host, port)
        return tap.transport, tap.inner

    async def open_serial(self, factory: Callable[[], Any], path: str, baud: int) -> tuple[Any, Any]:
        """A serial port."""
        tap = TappedProtocol(self, "serial", None, (path, NO_PORT), factory)
        await super().open_serial(tap.begin, path, baud)
        return tap.transport, tap.inner

    def note_opening(self, kind: str, local: Any, remote: Any) -> int:
        """A wire was opened; returns its number."""
        number = self._opened
        self._opened += 1
        self._give(WireRecord(asyncio.get_running_loop().time(), number, kind, _peer(local), _peer(remote)))
        return number

    def note_received(self, wire: int, data: bytes, peer: Any) -> None:
        """Bytes came in."""
        if not self._turn_begun:
            self._turn_begun = True
            asyncio.get_running_loop().call_soon(self._next_turn)
        self._give(ReceivedRecord(asyncio.get_running_loop().time(), wire, self._turn, _peer(peer), data))

    def note_sent(self, wire: int, data: bytes, peer: Any) -> None:
        """Bytes left."""
        self._give(SentRecord(asyncio.get_running_loop().time(), wire, _peer(peer), bytes(data)))

    def _next_turn(self) -> None:
        self._turn += 1
        self._turn_begun = False


def _peer(address: Any) -> Peer:
    return None if address is None else (address[0], address[1])


class TappedProtocol:
    """Stands between the loop and the protocol of one wire; all but what is noted is the protocol's own."""

    def __init__(self, wires: WireTaps, kind: str, local: Any, remote: Any, factory: Callable[[], Any]) -> None:
        """``kind`` of wire, with the addresses that were asked for; ``factory`` makes the protocol to be served."""
        self._wires = wires
        self._asked = kind, local, remote
        self._factory = factory
        self._wire = -1
        self.inner: Any = None
        self.transport: Any = None

    def begin(self) -> "TappedProtocol":
        """Have the protocol made."""
        self.inner = self._factory()
        return self

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def connection_made(self, transport: Any) -> None:
        """The wire is open: give it a transport that is tapped too."""
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
    """A transport, or a socket, whose sending is noted; all else is the original's."""

    def __init__(self, original: Any, wires: WireTaps, wire: int) -> None:
        """``original`` does the work."""
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
        """The socket is tapped too: some send past the transport, so that nothing waits in it."""
        found = self._original.get_extra_info(name, default)
        return TappedTransport(found, self._wires, self._wire) if name == "socket" and found is not None else found

    def dup(self) -> Any:
        """Return a second handle of a socket."""
        return TappedTransport(self._original.dup(), self._wires, self._wire)


Give = Callable[[Record], None]
"""Takes records in their order; never waits, never raises."""


STATUS_S = 0.2
"""Period of the link's and the source's status records [s]."""


class FlightRecorder:
    """Hands over what a flight tells, and its wires, as records. Whatever goes wrong with it, the flight goes on."""

    def __init__(self, give: Give, say: Say, link: CommandLink, source: PoseSource) -> None:
        """``give`` takes the records; ``say`` hears once that one could not be taken.

        How ``link`` and ``source`` are is noted now and then.
        """
        self._recorder = give
        self._say = say
        self._link = link
        self._source = source
        self._deaf = False
        self._sent_s = self._noted_s = -math.inf

    def hear(self, event: FlightEvent) -> None:
        """Take an event, after all others who hear of it."""
        match event:
            case PoseRecord(pose):
                self.give(event)
                if pose.arrival_s - self._sent_s > STATUS_S:  # not while a pose waits for its command
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
        """Note how link and source are, unless that was done within ``period_s`` [s]."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._noted_s >= period_s:
            self._noted_s = now_s
            self.give(StatusRecord(now_s, self._link.status, self._source.status))

    def give(self, record: Record) -> None:
        """Hand over one record."""
        try:
            self._recorder(record)
        except Exception as error:  # noqa: BLE001  # a controller of the user's own may put anything into a tick
            if not self._deaf:
                self._deaf = True
                self._say(notice("recording.unrecordable", why=error))


def about(config: Config, **more: Any) -> About:
    """Collect the facts known before the flight; ``more`` of them about a simulated one."""
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
    """The parts that ``config`` names, put together; nothing is opened yet.

    ``subscribers`` hear all that happens; ``on_pose`` sees every pose first, also those that the gate will drop;
    ``give`` takes what is to be recorded.
    ``wires``: see :func:`make_ends`. ``quiet`` hears of each command that left.
    ``running`` tells what else flies from this machine. ``monitors`` makes what may end the flight.

    Raises:
        ConfigError: the poses need another link.
    """
    bodies = None
    if config.pose.shows_others:
        bodies = Others(config.separation.others, own=config.pose.body_id if config.flight.start == "floor" else None)
    link, source = make_ends(config, wires, bodies)
    hold = make_hold(config.operator, link)
    if on_pose is not None:
        source = OverheardSource(source, on_pose)

    def tell(sentence: Sentence) -> None:
        flight.say(sentence)

    source = GatedSource(source, config.gate, lost_s=config.flight.coast_s, tell=tell)
    if config.forwards is not None:
        assert isinstance(link, MavlinkLink), "only a MAVLink section says so"
        floor_z_m = config.flight.floor_z_m
        source = ForwardingSource(
            source, link, config.forwards, floor_z_m=floor_z_m, believes=lambda: flight.believes_poses
        )
    tape = None
    if give is not None:
        tape = FlightRecorder(give, tell, link, source)
        subscribers = *subscribers, tape.hear
    flight = Flight(
        config,
        link,
        source,
        confirm=confirm,
        subscribers=subscribers,
        network=None if tape is None else WireTaps(tape.give),
        others=bodies if config.separation.others else None,
        quiet=quiet or IdleSlots(),
        company=Company(config, bodies, running, None if hold is None else hold.hold),
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
    view: str = "",
) -> AsyncIterator[Give | None]:
    """Record a flight in real time by a process of its own; None without ``recording.enabled``.

    Records are handed over when it is ``quiet``. ``keep`` is asked at the end whether the recording shall stay.
    ``view`` names a viewer that the recorder opens on it.
    """
    if not config.recording.enabled:
        yield None
        return
    process = RecorderProcess(config.recording, about(config), say, quiet, view=view)
    try:
        yield process.give
    finally:
        await process.close(keep=keep())
