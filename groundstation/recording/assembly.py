"""Assembly of a flight from one configuration: link, pose source, gate, operator's hold, recorder.

Of a recorded flight everything that it takes to fly it again is handed to a recorder as it happens. Its wires are
tapped, too: every byte in and out, seen at the event loop, whatever link or source opens them. A context
variable says whose code opens a wire: in virtual time the simulated side lives on the same loop. What the pacer's own
process opens is not seen.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from contextvars import ContextVar
from typing import Any

from groundstation.config import dump
from groundstation.core import Pilot, Tick
from groundstation.core.messages import Others, OverheardSource, Pose, PoseEvent, PoseSource, Reply, Request
from groundstation.core.mission import State
from groundstation.core.trajectory import Reference, Trajectory
from groundstation.flight import Company, Flight, FlightOutcome, FrameLateness, HoldWatch, body_of, make_ends, make_hold
from groundstation.pose import ForwardingSource
from groundstation.pose.sources import GatedSource
from groundstation.recording.records import (
    GAIN,
    NO_PORT,
    About,
    EndRecord,
    IdleRecord,
    LineRecord,
    Peer,
    PoseRecord,
    ReceivedRecord,
    Record,
    RequestRecord,
    SentRecord,
    StatusRecord,
    SwitchRecord,
    TickRecord,
    TrajectoryRecord,
    WireRecord,
)
from groundstation.runtime import IdleSlots, Running
from groundstation.settings import Config
from links.core import Command, CommandLink
from links.io import open_serial_connection
from links.mavlink import MavlinkLink, MavlinkLinkConfig

_TAPPED: "ContextVar[WireTaps | None]" = ContextVar("tapped", default=None)


class WireTaps:
    """The wires of one flight."""

    def __init__(self, give: Callable[[Record], None]) -> None:
        """``give`` takes each record as it happens."""
        self._give = give
        self._opened = 0
        self._turn = 0
        self._turn_begun = False
        self._loop: Any = None

    def tap(self) -> None:
        """Tap every UDP, TCP or serial wire that this task, or one that it starts, opens from now on."""
        self._loop = asyncio.get_running_loop()
        _TAPPED.set(self)
        if not getattr(self._loop.create_datagram_endpoint, "taps", False):
            self._loop.create_datagram_endpoint = _tap_opening(self._loop.create_datagram_endpoint, "udp")
            self._loop.create_connection = _tap_opening(self._loop.create_connection, "tcp")
            own = getattr(self._loop, "create_serial_connection", open_serial_connection)
            self._loop.create_serial_connection = _tap_opening(own, "serial")

    def note_opening(self, kind: str, local: Any, remote: Any) -> int:
        """A wire was opened; returns its number."""
        number = self._opened
        self._opened += 1
        self._give(WireRecord(self._loop.time(), number, kind, _peer(local), _peer(remote)))
        return number

    def note_received(self, wire: int, data: bytes, peer: Any) -> None:
        """Bytes came in."""
        if not self._turn_begun:
            self._turn_begun = True
            self._loop.call_soon(self._next_turn)
        self._give(ReceivedRecord(self._loop.time(), wire, self._turn, _peer(peer), data))

    def note_sent(self, wire: int, data: bytes, peer: Any) -> None:
        """Bytes left."""
        self._give(SentRecord(self._loop.time(), wire, _peer(peer), bytes(data)))

    def _next_turn(self) -> None:
        self._turn += 1
        self._turn_begun = False


def _peer(address: Any) -> Peer:
    return None if address is None else (address[0], address[1])


def _tap_opening(open_wire: Callable[..., Any], kind: str) -> Callable[..., Any]:
    """The loop's method ``open_wire`` with a tap on what it opens."""

    async def open_tapped(factory: Callable[[], Any], *args: Any, **options: Any) -> Any:
        wires = _TAPPED.get()
        if wires is None:
            return await open_wire(factory, *args, **options)
        if kind == "tcp":
            local, remote = None, args[:2] or (options.get("host"), options.get("port"))
        elif kind == "serial":
            local, remote = None, (args[0], NO_PORT)
        else:
            local, remote = (*args, None, None)[:2]
            local, remote = options.get("local_addr", local), options.get("remote_addr", remote)
        tap = TappedProtocol(wires, kind, local, remote)
        await open_wire(lambda: tap.around(factory()), *args, **options)
        return tap.transport, tap.inner

    open_tapped.taps = True  # type: ignore[attr-defined]  # so that it is done once
    return open_tapped


class TappedProtocol(asyncio.DatagramProtocol, asyncio.Protocol):
    """Stands between the loop and the protocol of one wire."""

    def __init__(self, wires: WireTaps, kind: str, local: Any, remote: Any) -> None:
        """``kind`` of wire, with the addresses that were asked for."""
        self._wires = wires
        self._asked = kind, local, remote
        self._wire = -1
        self.inner: Any = None
        self.transport: Any = None

    def around(self, inner: Any) -> "TappedProtocol":
        """Take the protocol that is to be served."""
        self.inner = inner
        return self

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

    def error_received(self, exc: Exception) -> None:
        """Pass it on."""
        self.inner.error_received(exc)

    def connection_lost(self, exc: Exception | None) -> None:
        """Pass it on."""
        self.inner.connection_lost(exc)

    def eof_received(self) -> bool | None:
        """Pass it on."""
        kept: bool | None = self.inner.eof_received()
        return kept

    def pause_writing(self) -> None:
        """Pass it on."""
        self.inner.pause_writing()

    def resume_writing(self) -> None:
        """Pass it on."""
        self.inner.resume_writing()


class TappedTransport:
    """A transport, or a socket, whose sending is noted; all else is the original's."""

    def __init__(self, original: Any, wires: WireTaps, wire: int) -> None:
        """``original`` does the work."""
        self._original = original
        self._wires = wires
        self._wire = wire

    def __getattr__(self, name: str) -> Any:
        """The original's."""
        return getattr(self._original, name)

    def write(self, data: bytes) -> None:
        """Of a connection."""
        self._original.write(data)
        self._wires.note_sent(self._wire, data, None)

    def sendto(self, data: bytes, addr: Any = None) -> Any:
        """Of a datagram endpoint or of a socket."""
        done = self._original.sendto(data, addr)
        self._wires.note_sent(self._wire, data, addr)
        return done

    def send(self, data: bytes) -> Any:
        """Of a socket, or of a serial port."""
        done = self._original.send(data)
        self._wires.note_sent(self._wire, data, None)
        return done

    def get_extra_info(self, name: str, default: Any = None) -> Any:
        """The socket is tapped too: some send past the transport, so that nothing waits in it."""
        found = self._original.get_extra_info(name, default)
        return TappedTransport(found, self._wires, self._wire) if name == "socket" and found is not None else found

    def dup(self) -> Any:
        """Of a socket: a second handle."""
        return TappedTransport(self._original.dup(), self._wires, self._wire)


LOOK_S = 0.2
"""How often the state of link and source is noted [s]."""

Give = Callable[[Record], None]
"""Takes records in their order; never waits, never raises."""


class RecordedPilot(Pilot):
    """A pilot that hands over what it is given and what it makes of it."""

    give: Give
    due: FrameLateness

    def pose(self, pose: Pose) -> None:
        """Take one pose."""
        self.give(PoseRecord(pose))
        super().pose(pose)

    def follow(self, trajectory: Trajectory, start_s: float) -> None:
        """Follow a new trajectory."""
        self.give(TrajectoryRecord(start_s))
        super().follow(trajectory, start_s)

    def stand(self) -> None:
        """Stand on the floor."""
        self._note_switch("stand")
        super().stand()

    def lift(self, time_s: float, hover_share: float, climb_m_s: float) -> Reference:
        """Leave the floor."""
        self._note_switch("lift", time_s, hover_share, climb_m_s)
        return super().lift(time_s, hover_share, climb_m_s)

    def descend(self, sink_m_s: float, *, blind: bool = False, rest_s: float = 0.0) -> None:
        """Level out and sink."""
        self._note_switch("descend", sink_m_s, float(blind), rest_s)
        super().descend(sink_m_s, blind=blind, rest_s=rest_s)

    def surrender(self, time_s: float, hold_s: float) -> Command:
        """Make the last command."""
        self._note_switch("surrender", hold_s)
        command = super().surrender(time_s, hold_s)
        self.give(IdleRecord(time_s, command.thrust_n, command))
        return command

    def gain(self, name: str, value: float) -> None:
        """Set a gain."""
        self._note_switch(f"{GAIN}{name}", value)
        super().gain(name, value)

    def ease(self, calmly: bool, *, asks: bool) -> None:
        """Fly calmly, or the figure."""
        self._note_switch("ease", float(calmly), float(asks))
        super().ease(calmly, asks=asks)

    def _note_switch(self, what: str, *values: float) -> None:
        self.give(SwitchRecord(asyncio.get_running_loop().time(), what, values))

    def idle(self, time_s: float, thrust_n: float) -> Command:
        """Make an idle command."""
        command = super().idle(time_s, thrust_n)
        self.due.begin()
        self.give(IdleRecord(time_s, thrust_n, command))
        return command

    def tick(self, time_s: float) -> Tick:
        """Make a command."""
        tick = super().tick(time_s)
        self.give(TickRecord(tick, self.due.late_s(time_s, tick.pose.id, tick.pose.arrival_s)))
        return tick


class RecordedFlight(Flight):
    """Implements :class:`groundstation.flight.flight.Flight`, with a recorder beside it."""

    def __init__(
        self,
        config: Config,
        link: CommandLink,
        source: PoseSource,
        *,
        give: Give,
        confirm: Callable[[], Awaitable[bool]],
        on_tick: Callable[[Tick], None] | None = None,
        on_event: Callable[[str], None] | None = None,
        on_state: Callable[[State, str], None] | None = None,
        others: Others | None = None,
        quiet: IdleSlots | None = None,
        company: Company | None = None,
        hold: HoldWatch | None = None,
    ) -> None:
        """As a flight; ``give`` takes the records."""
        self._recorder = give
        self._deaf = False
        self._told = on_event
        self._status_noted_s = -LOOK_S
        pilot = RecordedPilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
        pilot.give, pilot.due = self._note, FrameLateness(link)
        super().__init__(
            config,
            link,
            source,
            confirm=confirm,
            on_tick=on_tick,
            on_event=self._tell,
            on_state=on_state,
            pilot=pilot,
            others=others,
            quiet=quiet,
            company=company,
            hold=hold,
        )

    def ask(self, request: Request) -> Reply:
        """Note who asks, and do it."""
        self._give(RequestRecord(asyncio.get_running_loop().time(), request.ask, request.why))
        return super().ask(request)

    async def run(self) -> FlightOutcome:
        """Fly, with every wire tapped."""
        WireTaps(self._give).tap()
        try:
            return await super().run()
        finally:
            self._note_status()
            self._give(EndRecord(asyncio.get_running_loop().time(), self.state, self._progress.reason))

    def _give(self, record: Record) -> None:
        """Hand over one record. Whatever goes wrong with it, the flight goes on."""
        try:
            self._recorder(record)
        except Exception as error:  # noqa: BLE001  # a controller of the user's own may put anything into a tick
            if not self._deaf:
                self._deaf = True
                self._tell_operator(f"WARNING: a part of this flight can't be recorded: {error}")

    def _note(self, record: Record) -> None:
        self._give(record)
        if isinstance(record, PoseRecord):
            tick_s = self.newest_tick_s
            if tick_s is None or record.pose.arrival_s - tick_s > LOOK_S:
                self._note_status(LOOK_S)

    def _on_command(self, tick: Tick) -> None:
        super()._on_command(tick)
        self._note_status(LOOK_S)  # not while a pose waits for its command

    def _note_status(self, period_s: float = 0.0) -> None:
        """Note how link and source are, unless that was done within ``period_s`` [s]."""
        now = asyncio.get_running_loop().time()
        if now - self._status_noted_s >= period_s:
            self._status_noted_s = now
            self._give(StatusRecord(now, self._link.status, self._source.status))

    def _tell(self, line: str) -> None:
        text = line.partition(" ")[2].removeprefix(f"{self.state}: ")
        self._give(LineRecord(asyncio.get_running_loop().time(), self.state, text))
        self._tell_operator(line)

    def _tell_operator(self, line: str) -> None:
        if self._told is not None:
            self._told(line)


def about(config: Config, **more: Any) -> About:
    """What is known before the flight; ``more`` of it about a simulated one."""
    link = config.link
    return About(
        config=dump(config),
        vehicle=config.vehicle.name,
        controller=config.controller.kind,
        trajectory=str(config.trajectory.__struct_config__.tag),
        period_s=getattr(link, "period_s", 0.0) if getattr(link, "pace", "period") == "period" else 0.0,
        mavlink=link.address if isinstance(link, MavlinkLinkConfig) else "",
        **more,
    )


def make_flight(
    config: Config,
    *,
    confirm: Callable[[], Awaitable[bool]],
    on_tick: Callable[[Tick], None] | None = None,
    on_event: Callable[[str], None] | None = None,
    on_pose: Callable[[Pose], None] | None = None,
    wires: Mapping[str, Any] | None = None,
    give: Give | None = None,
    on_state: Callable[[State, str], None] | None = None,
    quiet: IdleSlots | None = None,
    running: Callable[[], Sequence[Running]] = tuple,
) -> Flight:
    """The parts that ``config`` names, put together; nothing is opened yet.

    ``on_pose`` sees every pose first, also those that the gate will drop; ``give`` takes what is to be recorded.
    ``wires``: see :func:`make_ends`. ``quiet`` hears of each command that left.
    ``running`` tells what else flies from this machine.

    Raises:
        ConfigError: the poses need another link.
    """
    bodies = None
    if config.pose.shows_others:
        bodies = Others(config.separation.others, own=body_of(config) if config.flight.start == "floor" else None)
    link, source = make_ends(config, wires, bodies)
    hold = make_hold(config.operator, link)
    if on_pose is not None:
        source = OverheardSource(source, on_pose)

    def tell(event: PoseEvent) -> None:
        flight.pose_event(event)

    source = GatedSource(source, config.gate, asyncio.get_running_loop, lost_s=config.flight.coast_s, tell=tell)
    if config.forwards is not None:
        assert isinstance(link, MavlinkLink), "only a MAVLink section says so"
        source = ForwardingSource(source, link, config.forwards)
    told: dict[str, Any] = {"confirm": confirm, "on_tick": on_tick, "on_event": on_event, "on_state": on_state}
    told |= {"others": bodies if config.separation.others else None, "quiet": quiet, "hold": hold}
    told |= {"company": Company(config, bodies, running, None if hold is None else hold.hold)}
    flight = (
        Flight(config, link, source, **told)
        if give is None
        else RecordedFlight(config, link, source, give=give, **told)
    )
    return flight


@asynccontextmanager
async def recorder(
    config: Config,
    say: Callable[[str], None],
    quiet: IdleSlots,
    keep: Callable[[], bool] = lambda: True,
    *,
    view: str = "",
) -> AsyncIterator[Give | None]:
    """What records a flight in real time, in a process of its own; None where ``recording.enabled`` is false.

    Records are handed over when it is ``quiet``. ``keep`` is asked at the end whether the recording shall stay.
    ``view`` names a viewer that the recorder opens on it.
    """
    if not config.recording.enabled:
        yield None
        return
    from groundstation.recording.process import RecorderProcess

    process = RecorderProcess(config.recording, about(config), say, quiet, view=view)
    try:
        yield process.give
    finally:
        await process.close(keep=keep())
