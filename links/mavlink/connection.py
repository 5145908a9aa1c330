"""Connection to one autopilot: one wire, opened again when lost, heartbeats, hand-shakes.

When the autopilot is heard again after a silence, or after its wire was lost, it may have
restarted: it is asked for its messages again, and set-points do not leave until the vehicle is
armed anew.

A time stamp that signs a frame must never be used twice, also not after a restart with a clock that
was set back: so the newest one is kept on disk beside the key, and the next run begins behind it.

Transports: UDP, TCP or a serial port. A frame leaves at once or never. TCP repeats what got lost,
so a command may arrive late. Against that a frame is dropped where older ones have waited for their
acknowledgement for longer than ``TCP_QUEUE_S``, and after ``STUCK_S`` of that the connection is
reset (SO_LINGER 0). What the other end has acknowledged and not read yet is out of our hands:
prefer UDP where there is a choice.
"""

import asyncio
import math
import os
import socket
import struct
from collections import Counter, deque
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from errno import EADDRINUSE
from pathlib import Path
from typing import Any

from links.core import NEWS_S, REOPEN_S, STUCK_S, Arrival, LinkError, LinkLost, LinkMisuse
from links.io import (
    NETWORK,
    Datagrams,
    advise_on_address,
    format_address,
    parse_address,
    read_key,
    waiting,
)
from links.mavlink.protocol import (
    MOST_SENDERS,
    TICKS_PER_S,
    AutopilotAddress,
    Handshake,
    HeartbeatMonitor,
    MavCommand,
    MavlinkCodec,
    MavlinkLinkConfig,
    Message,
    Signer,
    TargetSenders,
    Timesync,
    Trip,
    Words,
    choose_streams,
    is_autopilot,
)
from links.text import Sentence, link_notice


def _describe(error: OSError) -> str:
    """Why, in the system's words: asyncio has its own for a connection that is refused."""
    return (
        os.strerror(error.errno)
        if isinstance(error, ConnectionError) and error.errno
        else error.strerror or str(error)
    )


class UdpTransport(asyncio.DatagramProtocol):
    """Is never gone: a network that was away comes back itself."""

    datagrams = True

    def __init__(self, ear: "ReconnectingTransport", *, speaks_first: bool) -> None:
        self.speaks_first = speaks_first
        self._ear: ReconnectingTransport | None = ear
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


TCP_QUEUE_S = 0.1
"""Frames may wait for the other end this long [s]; a delayed acknowledgement takes 0.04."""


class StreamTransport(asyncio.Protocol):
    """Common base of the TCP and the serial transport: bytes in order, until cut or lost."""

    datagrams = False
    speaks_first = True

    def __init__(self, ear: "ReconnectingTransport") -> None:
        self._ear: ReconnectingTransport | None = ear
        self._transport: Any = None
        """The connection, or the port."""

    def connection_made(self, transport: Any) -> None:
        """Keep it (called by the event loop, or by the port)."""
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Pass it on (called by the event loop, or by the port)."""
        if self._ear is not None:
            self._ear.hear(data, None)

    def cut(self) -> None:
        """Reset the connection, or close the port."""
        self._ear = None
        self._transport.abort()

    def _end(self, why: str) -> None:
        ear = self._ear
        self.cut()
        if ear is not None:
            ear.lose_transport(why)


class TcpTransport(StreamTransport):
    """A connection; what does not leave soon enough is dropped, and the connection with it."""

    def __init__(self, ear: "ReconnectingTransport") -> None:
        super().__init__(ear)
        self._loop = asyncio.get_running_loop()
        self._sent = 0
        self._unacknowledged: deque[tuple[int, float]] = deque()
        """For each frame: bytes sent up to its end, and when."""
        self._watch: asyncio.TimerHandle | None = None

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one frame."""
        transport = self._transport
        if (
            transport.is_closing()
            or transport.get_write_buffer_size()
            or self._waited_s() > TCP_QUEUE_S
        ):
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
        if self._waited_s() > STUCK_S:
            self._end(link_notice("mavlink.tcp_silent").text)
        elif self._unacknowledged:
            self._watch = self._loop.call_later(TCP_QUEUE_S / 4, self._look)

    def _waited_s(self) -> float:
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
        if self._watch is not None:
            self._watch.cancel()
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
    """Implements :class:`links.io.wires.PortProtocol`."""

    def __init__(self, baud: int, ear: "ReconnectingTransport") -> None:
        super().__init__(ear)
        self._room = max(64.0, SERIAL_QUEUE_S * baud / 10.0)  # a byte takes 10 bits
        self._loop = asyncio.get_running_loop()
        self._full_since_s: float | None = None

    def leave(self, frame: bytes, to: Any) -> str:
        """Send one frame."""
        if self._ear is None:
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
"""``datagrams``: what is heard at once holds whole frames; ``speaks_first``: whom to send to is
known from the start. ``leave(frame, to)`` says why the frame was dropped instead, or nothing;
``cut()`` ends all at once."""


async def open_wire(config: MavlinkLinkConfig, ear: "ReconnectingTransport") -> MavlinkTransport:
    """Open the medium of ``config``; raises OSError."""
    network = NETWORK.get()
    if config.serial is not None:
        _, port = await network.open_serial(
            lambda: SerialTransport(config.baud, ear), config.serial, config.baud
        )
        return port
    address = parse_address(config.endpoint)
    if config.tcp is not None:
        try:
            async with asyncio.timeout(config.connect_timeout_s):
                _, stream = await network.open_stream(lambda: TcpTransport(ear), *address)
        except TimeoutError:
            raise OSError(
                link_notice("mavlink.tcp_nobody", limit_s=config.connect_timeout_s).text
            ) from None
        return stream
    first = config.remote is not None
    local, remote = (config.local_address, address) if first else (address, None)
    _, datagrams = await network.open_datagram(
        lambda: UdpTransport(ear, speaks_first=first), local, remote
    )
    return datagrams


def _explain_failure(config: MavlinkLinkConfig, error: OSError) -> Sentence:
    """Why the wire can't be opened, and what to do."""
    endpoint, why = config.endpoint, _describe(error)
    if config.way == "remote" and error.errno == EADDRINUSE:
        return link_notice(
            "mavlink.local_port_taken", endpoint=endpoint, why=why, port=config.local_address[1]
        )
    advice = link_notice("address.refused") if config.way == "serial" else advise_on_address(error)
    return link_notice("mavlink.open", endpoint=endpoint, why=why, advice=advice)


class ReconnectingTransport:
    """One wire after the other: hears its data, returned datagrams and loss.

    Opened and cut by whoever owns it.
    """

    def __init__(
        self,
        config: MavlinkLinkConfig,
        dropped: Counter[str],
        *,
        hear: Callable[[bytes, Any], None],
        lose: Callable[[str], None],
        tell: Callable[[str], None],
    ) -> None:
        """Nothing is opened yet.

        Frames of ours that do not leave or come back are counted in ``dropped``.

        ``hear(data, source)`` takes what arrives; ``lose(says)`` is called when the wire has ended
        by itself, and ``tell(says)`` when more is known: both with a sentence for the operator.
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
            wire = await open_wire(config, self)
        except OSError as error:
            raise LinkLost(_explain_failure(config, error)) from error
        if self._loop is None:
            wire.cut()
            raise LinkError(link_notice("mavlink.closed_early"))
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
        """Send ``frame`` to the address ``to``, and tell whether it left.

        Nothing leaves on a lost wire.
        """
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
        self._lose(_describe_loss(why))
        if self._returning is not None:
            self._returning.cancel()
        self._returning = self._loop.create_task(self._return())

    async def _return(self) -> None:
        """Open the wire again, as often as it takes."""
        while self.wire is None:
            await asyncio.sleep(REOPEN_S)
            try:
                self.wire = await open_wire(self._config, self)
            except OSError as error:
                self._tell(
                    _describe_loss(f"cannot open {self._config.endpoint} ({_describe(error)})")
                )
        self._tell(link_notice("mavlink.wire_back").text)


def _describe_loss(why: str) -> str:
    """Why the wire is away, and what is being done about it."""
    return link_notice("mavlink.lost", why=why, pause_s=REOPEN_S).text


VISION = (
    "VISION_POSITION_ESTIMATE", "GLOBAL_VISION_POSITION_ESTIMATE", "VICON_POSITION_ESTIMATE",
    "ATT_POS_MOCAP", "ODOMETRY", "GPS_INPUT",
)  # fmt: skip
"""Messages by which somebody tells an autopilot where it is."""
SET_POINTS = (
    "SET_ATTITUDE_TARGET",
    "SET_POSITION_TARGET_LOCAL_NED",
    "SET_POSITION_TARGET_GLOBAL_INT",
)
"""Messages by which somebody steers an autopilot."""
HEARTBEAT_S = 1.0
"""Period of our own HEARTBEAT [s]."""

ASKED_S = 0.05
"""Period of the time questions that leave beside set-points [s]."""
ASKED_SLOWLY_S = 0.1
"""Period of the same on slow serial ports [s]."""
FORGOTTEN_S = 5.0
"""Unanswered time questions are dropped after this long [s]."""
HOLE_S = 0.15
"""After it was not heard for so long, nobody knows what of ours it has answered meanwhile [s]."""
TOO_LATE_S = 0.5
"""Answers later than the usual round trip by more than this are late [s]."""
LASTS_S = 0.15
"""Late answers for this long mean that our commands arrive too late [s]."""

DROPS = {
    "garbage": "bytes that are no MAVLink",
    "truncated": "frames of which a part got lost",
    "bad_crc": "frames with a wrong checksum",
    "unknown": "messages that nobody here knows",
    "unsigned": "messages without a signature, which link.signing_key_file asks for",
    "bad_signature": "messages signed with another key than link.signing_key_file",
    "replayed": "signed messages with old time stamps",
    "other_system": "messages of other systems",
    "other_address": "datagrams from other addresses",
    "undeliverable": "messages of ours that the network gave back: does anything listen there?",
}
"""Sentences for the operator, by the reason for which received data was not used."""

Subscriber = Callable[[Message, float], None]


class Uplink:
    """Arrival of our frames in time: TIMESYNC questions beside set-points, and their answers."""

    def __init__(self, period_s: float) -> None:
        self._period = period_s
        self._asked: deque[int] = deque()
        self._heard_s = -math.inf
        self.begin(-math.inf)

    def begin(self, now_s: float) -> None:
        """The operator arms: what was asked before counts no more."""
        self._asked.clear()
        self._next_s = self._since_s = now_s
        self._late_s, self._late_since_s = 0.0, math.inf
        self._answers = False

    def ask(self, now_s: float) -> int | None:
        """The time to send in a question (TIMESYNC.ts1) as a set-point leaves at ``now_s`` [ns].

        None where not yet.
        """
        if now_s < self._next_s:
            return None
        self._next_s = now_s + self._period
        asked_ns = int(now_s * 1e9)
        self._asked.append(asked_ns)
        while self._asked[0] < asked_ns - FORGOTTEN_S * 1e9:
            self._asked.popleft()
        return asked_ns

    def hear(self, message: Message, now_s: float, usual_s: float) -> None:
        """Take one message of the autopilot; a round trip usually takes ``usual_s`` [s]."""
        if now_s - self._heard_s > HOLE_S:
            self._since_s = now_s
        self._heard_s = now_s
        if message.get_type() != "TIMESYNC" or message.tc1 == 0 or message.ts1 not in self._asked:
            return
        while self._asked.popleft() != message.ts1:
            pass
        asked_s = message.ts1 * 1e-9
        self._since_s, self._answers = max(self._since_s, asked_s), True
        self._late_s = now_s - asked_s - usual_s
        self._late_since_s = (
            min(self._late_since_s, now_s) if self._late_s > TOO_LATE_S else math.inf
        )

    def arrival(self, now_s: float, usual_s: float) -> Arrival:
        """Whether commands arrive, as far as answers tell.

        A round trip usually takes ``usual_s`` [s].
        """
        if not self._answers or now_s - self._heard_s > HOLE_S:
            return Arrival()  # nobody can tell
        late_s = self._late_s if now_s - self._late_since_s > LASTS_S else 0.0
        return Arrival(max(now_s - self._since_s - usual_s - self._period, 0.0), late_s)


class OtherTraffic:
    """Messages of other senders: they steer the vehicle, send it positions, use its address."""

    def __init__(self, config: MavlinkLinkConfig) -> None:
        self._config = config
        self.tells_position = False
        """Whether somebody else was heard who tells an autopilot its position."""
        self.systems: dict[str, None] = {}
        """Other systems that were heard, by number and address: one may be the vehicle."""
        self._rival, self._rival_s = "", -math.inf

    def hear(self, message: Message, address: str, now_s: float, *, ours: bool) -> None:
        """Take a message of another system at ``address``.

        ``ours``: what has our own numbers may be an echo.
        """
        config, kind = self._config, message.get_type()
        system, component = message.get_srcSystem(), message.get_srcComponent()
        self.tells_position = self.tells_position or kind in VISION
        if kind == "HEARTBEAT" and len(self.systems) < MOST_SENDERS:
            self.systems[f"system {system}, component {component} at {address}"] = None
        if kind not in SET_POINTS or message.target_system not in (0, config.target_system):
            return
        if not ours or (system, component) != (config.system_id, config.component_id):
            says = link_notice(
                "mavlink.rival_sends", system=system, component=component, message=kind
            )
            self._rival, self._rival_s = says.text, now_s

    def rival(self, now_s: float) -> str:
        """Describe whoever else sent set-points in the last ``NEWS_S``; empty where nobody did."""
        return self._rival if now_s - self._rival_s < NEWS_S else ""


POLL_S = 0.05
"""Period at which a request without a set-point stream checks the time [s]."""


class HandshakeRunner:
    """Goes through hand-shakes.

    Whoever owns it passes on every message and calls ``wake`` when the wire changes.
    """

    def __init__(
        self, leave: Callable[[bytes], object], obstacle: Callable[[], LinkError | None]
    ) -> None:
        """``leave`` sends a frame; ``obstacle()`` is why nothing can be asked now."""
        self._leave = leave
        self._obstacle = obstacle
        self._one_at_a_time = asyncio.Lock()
        self._news = asyncio.Event()
        self._handshake: Handshake | None = None

    def wake(self) -> None:
        """Look again."""
        self._news.set()

    def hear(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot."""
        if self._handshake is not None:
            self._handshake.hear(message, now_s)
            self._news.set()

    async def see_through(
        self,
        handshake: Handshake,
        meanwhile: Callable[[float], None] | None = None,
        period_s: float = POLL_S,
    ) -> None:
        """Go through ``handshake``, one at a time, with ``meanwhile(now_s)`` each ``period_s`` [s].

        Raises:
            LinkRejected: the autopilot refused.
            LinkLost: it did not answer.
            LinkError: another failure, or the obstacle that came up.
        """
        async with self._one_at_a_time:
            self._handshake = handshake
            try:
                await self._go_through(handshake, meanwhile, period_s)
            finally:
                self._handshake = None

    async def _go_through(
        self, handshake: Handshake, meanwhile: Callable[[float], None] | None, period_s: float
    ) -> None:
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            if (obstacle := self._obstacle()) is not None:
                raise obstacle
            now = loop.time()
            if now >= due_s:
                if meanwhile is not None:
                    meanwhile(now)
                due_s += period_s
                if due_s <= now:
                    due_s = now + period_s  # a late frame is left out, never made up for
            for frame in handshake.poll(now):
                self._leave(frame)
            if handshake.failure is not None:
                raise handshake.failure
            if handshake.done:
                return
            self._news.clear()
            try:
                async with asyncio.timeout_at(due_s):
                    await self._news.wait()
            except TimeoutError:
                pass


Streams = Callable[[int], Mapping[str, float]]


class MavlinkConnection:
    """Heartbeats and time both ways, and messages to their readers, over one wire at a time.

    Opened and closed by the link that owns it; may be opened again.
    """

    def __init__(self, config: MavlinkLinkConfig) -> None:
        self._config = config
        self._target = (config.target_system, config.target_component)
        self.codec, self.words = MavlinkCodec(config.system_id, config.component_id), Words()
        self.others = OtherTraffic(config)
        """Senders other than the vehicle."""
        self.other_addresses: tuple[str, ...] = ()
        """Addresses other than the vehicle's that sent to our port, at most ``MOST_SENDERS``."""
        self.read = 0
        """Number of reads from the wire."""
        self._dropped: Counter[str] = Counter()
        self._line = ReconnectingTransport(
            config, self._dropped, hear=self._hear, lose=self._lose, tell=self._tell
        )
        self._streams: list[Streams] = []
        self._wishes: dict[tuple[str, ...], float] = {}
        self._requests = HandshakeRunner(self.leave, self._obstacle)
        self.see_through = self._requests.see_through
        """Goes through a hand-shake."""
        self._subscribers: list[Subscriber] = [self._requests.hear]
        self._stamps = (
            StampFile(Path(config.signing_key_file))
            if config.signing_key_file is not None
            else None
        )
        self.when_lost: Callable[[], None] = lambda: None
        """Called when the wire is lost."""
        self.when_back: Callable[[], None] = lambda: None
        """Called when an autopilot is heard again that was silent, or whose wire was lost."""
        self.owes: Callable[[], bool] = lambda: False
        """Whether a command or its bring-down may still leave: it belongs to the autopilot that was
        armed, and to no other that speaks in its place from another address."""
        self._reset()

    def _reset(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._first_beat = asyncio.Event()
        self._next_beat: asyncio.TimerHandle | None = None
        self._beats = 0
        self._asking: asyncio.Task[None] | None = None
        self._trouble = ""
        self._heard = HeartbeatMonitor(self._config.heartbeat_timeout_s)
        self._senders = TargetSenders(self._config.target_system, self._name_address)
        self.timesync = Timesync()
        """Exchanges of clocks with the autopilot."""

    # ---- what it is like

    @property
    def state(self) -> str:
        """One of ``closed``, ``connecting``, ``connected``, ``armed``, ``lost``."""
        if self._loop is None:
            return "closed"
        if self._heard.kind is None:
            return "connecting"
        if self._line.wire is None or self._heard.is_silent(self._loop.time()):
            return "lost"
        return "armed" if self._heard.armed else "connected"

    @property
    def kind(self) -> int | None:
        """The autopilot's HEARTBEAT.autopilot; None before the first."""
        return self._heard.kind

    @property
    def text(self) -> str:
        """The cause of a loss of wire or autopilot, else the autopilot's newest words."""
        if self._loop is not None and self.state == "lost":
            silence_s = self._heard.silence_s(self._loop.time())
            if silence_s < math.inf:
                return link_notice("mavlink.lost_heartbeat", silence_s=silence_s).text
        return self._trouble or self.words.newest

    @property
    def clock(self) -> Trip | None:
        """The autopilot's clock against ours; None until it has answered."""
        return self.timesync.best

    @property
    def rival(self) -> str:
        """Describe whoever else sent set-points in the last ``NEWS_S``; empty where nobody did."""
        return "" if self._loop is None else self.others.rival(self._loop.time())

    @property
    def conflict(self) -> str:
        """Why nobody knows which autopilot would obey; empty where one does."""
        if self._loop is None or self._heard.kind is None:
            return ""
        return self._senders.conflict(self._heard.address, self._loop.time())

    @property
    def second_path(self) -> str:
        """That the autopilot is heard by a second way; empty where it is not."""
        return (
            ""
            if self._loop is None
            else self._senders.second_path(self._heard.address, self._loop.time())
        )

    @property
    def dropped(self) -> dict[str, int]:
        """Counts of unused received data and of our undelivered frames, by reason.

        Our frames are ``congested`` (the network had no room), ``full`` (they would have had to
        wait), ``undeliverable`` (given back), or had ``no_peer`` yet.
        """
        return dict(self.codec.dropped + self._dropped)

    def autopilot(self) -> AutopilotAddress:
        """The autopilot at the other end.

        Raises:
            LinkMisuse: there is none yet.
        """
        if self._loop is None or self._heard.kind is None:
            raise LinkMisuse("the link is not connected")
        return AutopilotAddress(
            self.codec, self.words, *self._target, self._heard.kind, self._heard.vehicle
        )

    def believe_armed(self, armed: bool) -> None:
        """Believe that the motors are on, or off, until a heartbeat tells."""
        self._heard.believe_armed(asyncio.get_running_loop().time() if armed else None)

    def begin_arming(self) -> None:
        """The operator arms anew: what became of the wire before needs no telling any more."""
        self._trouble = ""

    def note_examined(self) -> None:
        """The autopilot that is heard now was found fit to be armed."""
        self._senders.examine(self._heard.address)

    # ---- for whoever shares it

    def subscribe(self, subscriber: Subscriber) -> Callable[[], None]:
        """Call ``subscriber(message, arrival_s)`` for every message of the autopilot.

        Returns what ends that.

        ``arrival_s`` is on the event loop's clock [s].
        """
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    def request(self, streams: Streams) -> None:
        """Have ``open`` ask for ``streams(HEARTBEAT.autopilot)``: message name → rate [Hz].

        Raises:
            LinkMisuse: the connection is open already.
        """
        if self._loop is not None:
            raise LinkMisuse("messages must be requested before the link is connected")
        self._streams.append(streams)

    def wish(self, names: tuple[str, ...], rate_hz: float) -> None:
        """Have ``open`` ask for the first of ``names`` that the autopilot is willing to send.

        Raises:
            LinkMisuse: the connection is open already.
        """
        if self._loop is not None:
            raise LinkMisuse("messages must be asked for before the link is connected")
        self._wishes[names] = rate_hz

    # ---- opening and closing

    async def open(self) -> None:
        """Open the wire, wait for the autopilot's HEARTBEAT, and ask for the wanted messages.

        Raises:
            LinkLost: the wire can't be opened, or nobody answered within the configured time.
            LinkRejected: the autopilot refuses to send a message that was requested.
            LinkError: the signing key can't be used, or this was closed before it was open.
        """
        if self._loop is not None:
            raise LinkMisuse("the link is connected already; close it first")
        self._loop = asyncio.get_running_loop()
        try:
            self._sign(self._loop)
            await self._line.open()
            self._beat()
            await self._wait_for_heartbeat()
        except BaseException:
            self.close()
            raise
        await self._choose_streams()

    async def _wait_for_heartbeat(self) -> None:
        try:
            async with asyncio.timeout(self._config.connect_timeout_s):
                await self._first_beat.wait()
        except TimeoutError:
            raise LinkLost(self._silence()) from None

    def _silence(self) -> Sentence:
        config = self._config
        dropped = [f"{count} {DROPS.get(reason, reason)}" for reason, count in self.dropped.items()]
        instead = (
            [f"heard instead: {', '.join(self.others.systems)}"] if self.others.systems else []
        )
        silent = link_notice(
            "mavlink.silent",
            system=config.target_system,
            component=config.target_component,
            endpoint=config.endpoint,
            limit_s=config.connect_timeout_s,
            what=f"got only: {', '.join(dropped + instead)}" if dropped else "nothing came at all",
        )
        given_back = self._dropped["undeliverable"]
        if config.remote is None or len(dropped) > bool(given_back) or given_back >= self._beats:
            return silent  # something came, or nothing listens there
        return link_notice("mavlink.silent_port", silent=silent, port=config.local_address[1])

    def close(self) -> None:
        """Release the wire. Nothing leaves afterwards."""
        beat, asking = self._next_beat, self._asking
        self._note_stamp()
        self._reset()
        for pending in (beat, asking):
            if pending is not None:
                pending.cancel()
        self._line.cut()
        self.codec.forget()
        self._requests.wake()

    def _sign(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._stamps is not None and self.codec.signer is None:
            try:
                signer = self._stamps.make_signer(loop.time)
                self._stamps.keep(signer.stamp)
            except ValueError as error:
                raise LinkError(link_notice("mavlink.key", why=error)) from None
            self.codec.signer = signer

    def _note_stamp(self) -> None:
        if self._stamps is not None and self.codec.signer is not None:
            try:
                self._stamps.keep(self.codec.signer.stamp)
            except ValueError as error:
                self._trouble = str(error)

    async def _choose_streams(self) -> None:
        kind = self.autopilot().kind
        wanted = {name: rate for ask in self._streams for name, rate in ask(kind).items()}
        await choose_streams(
            self.autopilot(), wanted, self._wishes, self.see_through, quiet=self._config.quiet
        )

    def _tell(self, trouble: str) -> None:
        """Show it instead of the autopilot's words."""
        self._trouble = trouble

    def _lose(self, trouble: str) -> None:
        """The wire has ended by itself: nothing more is asked for."""
        self._heard.lose()
        self.codec.forget()
        self._tell(trouble)
        self._requests.wake()
        self.when_lost()
        if self._asking is not None:
            self._asking.cancel()

    def _resume(self) -> None:
        """An autopilot is heard again, which may have restarted: ask for the messages again."""
        self.when_back()
        if self._asking is not None:
            self._asking.cancel()
        self._asking = asyncio.get_running_loop().create_task(self._ask_again())

    async def _ask_again(self) -> None:
        self._trouble = link_notice("mavlink.back").text
        try:
            await self._choose_streams()
        except LinkError as error:
            self._trouble = link_notice("mavlink.back_but", why=error).text

    # ---- what leaves

    def leave(self, frame: bytes) -> bool:
        """Send one frame, and tell whether it left.

        Nothing leaves on a closed or lost connection.
        """
        return self._line.leave(frame, self._heard.address)

    def _obstacle(self) -> LinkError | None:
        if self._loop is None:
            return LinkError(link_notice("mavlink.closed"))
        return None if self._line.wire is not None else LinkLost(self._trouble)

    def _beat(self) -> None:
        if self._loop is None:
            return
        wire = self._line.wire
        if wire is not None and (wire.speaks_first or self._heard.address is not None):
            self.leave(self.codec.heartbeat())
            if self._heard.kind is not None:
                self._ask_the_time(self._loop.time())
        self._beats += 1
        if not self._heard.armed:  # a flight must not wait for a disk
            self._note_stamp()
        self._next_beat = self._loop.call_later(HEARTBEAT_S, self._beat)

    def _ask_the_time(self, now_s: float) -> None:
        self.leave(self.codec.timesync_question(self.timesync.ask(now_s)))

    def _ask_identity(self, address: Any) -> None:
        """Ask the autopilot at ``address`` for its hardware id, unless it has told."""
        if not self._senders.is_known(address):
            number = float(self.codec.message_number("AUTOPILOT_VERSION"))
            self._line.leave(
                self.codec.command(*self._target, MavCommand.REQUEST_MESSAGE, number), address
            )

    # ---- what arrives

    def _hear(self, data: bytes, source: Any) -> None:
        """Take what arrived from the address ``source``."""
        wire, known = self._line.wire, self._heard.address
        if self._loop is None or wire is None:
            return
        self.read += 1
        now = self._loop.time()
        if (
            known is not None
            and source != known
            and (self.owes() or not self._heard.is_silent(now))
        ):
            self._dropped["other_address"] += 1
            self._overhear(data, source, now)
            return
        for message in self.codec.feed(data, source if wire.datagrams else None):
            if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
                self._dropped["other_system"] += 1
                self.others.hear(message, self._name_address(source), now, ours=self.owes())
                continue
            if message.get_type() == "HEARTBEAT":
                if not is_autopilot(message):
                    self._dropped["other_system"] += 1
                    continue
                self._heartbeat(message, source, now)
            # others have sent no heartbeat yet
            if self._heard.kind is not None and self._heard.address in (None, source):
                self._publish(message, now)

    def _overhear(self, data: bytes, source: Any, now_s: float) -> None:
        """Another address than the vehicle's: used for nothing, but it may be a second vehicle."""
        name = self._name_address(source)
        if name not in self.other_addresses:
            self.other_addresses = (*self.other_addresses, name)[:MOST_SENDERS]
        for message in self.codec.feed(data, source, used=False):
            if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
                continue
            if message.get_type() == "AUTOPILOT_VERSION":
                self._senders.identify(source, message)
            elif message.get_type() == "HEARTBEAT" and is_autopilot(message):
                self._senders.beat(source, now_s)
                for address in (source, self._heard.address):
                    self._ask_identity(address)

    def _name_address(self, address: Any) -> str:
        """``address`` as the operator writes it; where the wire has none, its own."""
        return self._config.endpoint if address is None else format_address(address)

    def _publish(self, message: Message, now_s: float) -> None:
        name = message.get_type()
        if name == "STATUSTEXT":
            self.words.hear(message)
        elif name == "TIMESYNC" and message.tc1 == 0:  # a question, not an answer
            self.leave(self.codec.timesync_reply(message, now_s))
        elif name == "AUTOPILOT_VERSION":
            self._senders.identify(self._heard.address, message)
        elif name == "TIMESYNC":
            self.timesync.take_answer(message.tc1, message.ts1, now_s)
        for subscriber in self._subscribers:
            subscriber(message, now_s)

    def _heartbeat(self, message: Message, source: Any, now_s: float) -> None:
        wire = self._line.wire
        if wire is None:
            return
        is_first = self._heard.kind is None
        news = self._heard.beat(message, now_s)
        if news and not wire.speaks_first:
            if source != self._heard.address:
                self._senders.forget(self._heard.address)
            self._heard.address = source
        self._senders.beat(self._heard.address, now_s)
        if news:
            if not wire.speaks_first:
                self.leave(self.codec.heartbeat())
            self._ask_the_time(now_s)
            self._first_beat.set()
            # A port may end in the moment of an answer.
            if not is_first and self._line.wire is not None:
                self._resume()
                self._heard.believe_armed(None)
                self.timesync = Timesync()
                self._ask_identity(self._heard.address)
        self._heard.take_armed(message, now_s)


_EPOCH = datetime(2015, 1, 1, tzinfo=UTC)
"""Zero of MAVLink's signing time stamps."""


class StampFile:
    """The newest time stamp of a key, beside it."""

    def __init__(self, key_file: Path) -> None:
        self._key_file = key_file
        self._path = key_file.with_name(key_file.name + ".stamp")

    def make_signer(self, time_s: Callable[[], float]) -> Signer:
        """Return a signer whose stamps follow the last run's, and the clock ``time_s()`` [s].

        Raises:
            ValueError: the key or its newest stamp can't be used.
        """
        key, first, begun_s = read_key(self._key_file), self.first(), time_s()
        signer = Signer(key, lambda: first + int((time_s() - begun_s) * TICKS_PER_S))
        signer.stamp = first - 1
        return signer

    def first(self) -> int:
        """Where to begin: now, or behind the newest of the last run where that is later.

        Raises:
            ValueError: the file is damaged.
        """
        now = int((datetime.now(UTC) - _EPOCH).total_seconds() * TICKS_PER_S)
        try:
            kept = int(self._path.read_text("ascii"))
        except FileNotFoundError:
            kept = 0
        except (OSError, ValueError) as error:
            raise ValueError(
                link_notice("mavlink.stamp_unread", path=self._path, why=error)
            ) from None
        return max(now, kept + 1)

    def keep(self, stamp: int) -> None:
        """Write ``stamp`` down, all or nothing.

        Raises:
            ValueError: the folder can't be written.
        """
        new = self._path.with_name(self._path.name + ".new")
        try:
            new.write_text(f"{stamp}\n", "ascii")
            new.replace(self._path)
        except OSError as error:
            raise ValueError(
                link_notice("mavlink.stamp_unwritten", path=self._path, why=error.strerror)
            ) from None
