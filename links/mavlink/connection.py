"""Connection: one wire to one autopilot, heartbeats both ways, its messages to whoever reads them, and hand-shakes.

When the autopilot is heard again after a silence, or after its wire was lost, it is asked for its messages again, as
it may have restarted. Set-points do not leave until the vehicle is armed anew: nobody knows what it did meanwhile.

A time stamp that signs a frame must never be used twice, also not after a restart with a clock that was set back: so
the newest one is kept on disk beside the key, and the next run begins behind it. Nothing else of this package reads the
machine's clock.
"""

import asyncio
import math
from collections import Counter
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from links.core import LinkError, LinkLost, LinkMisuse
from links.io import read_key
from links.mavlink.protocol import (
    GROUND_STATION,
    TICKS_PER_S,
    AutopilotAddress,
    Handshake,
    HeartbeatMonitor,
    MavlinkCodec,
    MavlinkLinkConfig,
    Message,
    Signer,
    Timesync,
    Trip,
    Words,
    choose_streams,
)
from links.mavlink.transport import ReconnectingTransport

VISION = (
    "VISION_POSITION_ESTIMATE", "GLOBAL_VISION_POSITION_ESTIMATE", "VICON_POSITION_ESTIMATE", "ATT_POS_MOCAP",
    "ODOMETRY", "GPS_INPUT",
)  # fmt: skip
"""Messages by which somebody tells an autopilot where it is."""
HEARTBEAT_S = 1.0
"""Period of our own HEARTBEAT [s]."""

Subscriber = Callable[[Message, float], None]


class Contact:
    """Heartbeats both ways, each other's time, and messages to whoever reads them: over one wire, for a connection."""

    def __init__(self, config: MavlinkLinkConfig, keeper: "MavlinkConnection") -> None:
        """Nothing is opened yet."""
        self._config = config
        self._target = (config.target_system, config.target_component)
        self._keeper = keeper
        self.codec = MavlinkCodec(config.system_id, config.component_id)
        self.words = Words()
        self.heard_vision = False
        """Whether somebody else was heard who tells an autopilot its position."""
        self._first_beat = asyncio.Event()
        self._dropped: Counter[str] = Counter()
        self._line = ReconnectingTransport(config, self._dropped, hear=self._hear, lose=self._lose, tell=keeper.tell)
        self._subscribers: list[Subscriber] = []
        self._reset()

    def _reset(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._next_beat: asyncio.TimerHandle | None = None
        self.heard = HeartbeatMonitor(self._config.heartbeat_timeout_s)
        """What its heartbeats say."""
        self.timesync = Timesync()
        """Its clock against ours."""

    @property
    def has_wire(self) -> bool:
        """False on a wire that was lost, or is not open."""
        return self._line.wire is not None

    @property
    def dropped(self) -> dict[str, int]:
        """What was received and not used, by reason; and frames of ours that did not leave or came back.

        Those are ``congested`` (the network had no room), ``full`` (they would have had to wait), ``undeliverable``
        (given back), ``no_peer`` (none yet).
        """
        return dict(self.codec.dropped + self._dropped)

    def subscribe(self, subscriber: Subscriber) -> Callable[[], None]:
        """Call ``subscriber(message, arrival_s)`` for every message of the autopilot; returns what ends that."""
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    async def open(self) -> None:
        """Open the wire, and send heartbeats from now on.

        Raises:
            LinkLost: the wire can't be opened.
            LinkError: this was closed before it was open.
        """
        self._loop = asyncio.get_running_loop()
        await self._line.open()
        self._first_beat.clear()
        self._beat()

    async def wait_for_heartbeat(self) -> None:
        """Wait for the autopilot's first heartbeat.

        Raises:
            LinkLost: none came within the configured time.
        """
        try:
            async with asyncio.timeout(self._config.connect_timeout_s):
                await self._first_beat.wait()
        except TimeoutError:
            raise LinkLost(self._silence()) from None

    def _silence(self) -> str:
        config = self._config
        what = f"got only {self.dropped}" if self.dropped else "nothing came at all"
        return (
            f"no HEARTBEAT of MAVLink system {config.target_system}, component {config.target_component} on "
            f"{config.address} within {config.connect_timeout_s:g} s ({what}): check that the autopilot runs, that "
            "it sends to this address, and its system id (MAV_SYS_ID or SYSID_THISMAV)"
        )

    def close(self) -> None:
        """Release the wire. Nothing leaves afterwards."""
        beat = self._next_beat
        self._reset()
        if beat is not None:
            beat.cancel()
        self._line.cut()
        self.codec.forget()

    def _lose(self, why: str) -> None:
        self.heard.lose()
        self.codec.forget()
        self._keeper.lose_wire(why)

    # ---- what leaves

    def leave(self, frame: bytes) -> bool:
        """Send one frame, and tell whether it left; nothing leaves without a wire."""
        return self._line.leave(frame, self.heard.address)

    def _beat(self) -> None:
        if self._loop is None:
            return
        wire = self._line.wire
        if wire is not None and (wire.speaks_first or self.heard.address is not None):
            self.leave(self.codec.heartbeat())
            if self.heard.kind is not None:
                self._ask_the_time(self._loop.time())
        self._keeper.each_beat()
        self._next_beat = self._loop.call_later(HEARTBEAT_S, self._beat)

    def _ask_the_time(self, now_s: float) -> None:
        self.leave(self.codec.timesync_question(self.timesync.ask(now_s)))

    # ---- what arrives

    def _hear(self, data: bytes, source: Any) -> None:
        """Take what arrived from the address ``source``."""
        wire, known = self._line.wire, self.heard.address
        if self._loop is None or wire is None:
            return
        now = self._loop.time()
        if known is not None and source != known and not self.heard.is_silent(now):
            self._dropped["other_address"] += 1
            return
        read = self.codec.feed_datagram if wire.datagrams else self.codec.feed
        for message in read(data):
            if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
                self._dropped["other_system"] += 1
                self.heard_vision = self.heard_vision or message.get_type() in VISION
                continue
            if message.get_type() == "HEARTBEAT":
                self._heartbeat(message, source, now)
            # others have sent no heartbeat yet
            if self.heard.kind is not None and self.heard.address in (None, source):
                self._publish(message, now)

    def _publish(self, message: Message, now_s: float) -> None:
        name = message.get_type()
        if name == "STATUSTEXT":
            self.words.hear(message)
        elif name == "TIMESYNC" and message.tc1 == 0:  # a question, not an answer
            self.leave(self.codec.timesync_reply(message, now_s))
        elif name == "TIMESYNC":
            self.timesync.take_answer(message.tc1, message.ts1, now_s)
        for subscriber in self._subscribers:
            subscriber(message, now_s)

    def _heartbeat(self, message: Message, source: Any, now_s: float) -> None:
        wire = self._line.wire
        if message.type == GROUND_STATION or wire is None:
            return
        is_first = self.heard.kind is None
        if self.heard.beat(message, now_s):
            if not wire.speaks_first:
                self.heard.address = source
                self.leave(self.codec.heartbeat())
            self._ask_the_time(now_s)
            self._first_beat.set()
            if not is_first and self._line.wire is not None:  # a port may end in the moment of an answer
                self._keeper.resume()
                self.heard.believe_armed(None)
                self.timesync = Timesync()
        self.heard.take_armed(message, now_s)


POLL_S = 0.05
"""How often a request without a stream of set-points looks at the time [s]."""


class HandshakeRunner:
    """Goes through hand-shakes; whoever owns it passes on every message and calls ``wake`` when the wire changes."""

    def __init__(self, leave: Callable[[bytes], object], obstacle: Callable[[], LinkError | None]) -> None:
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
        self, handshake: Handshake, meanwhile: Callable[[float], None] | None = None, period_s: float = POLL_S
    ) -> None:
        """Go through ``handshake``, calling ``meanwhile(now_s)`` every ``period_s`` [s].

        Raises:
            LinkError: the hand-shake's failure, or the obstacle that came up.
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


KEEP_STAMP_BEATS = 10
"""How often the newest time stamp of signing is written down, in heartbeats; never while armed."""

Streams = Callable[[int], Mapping[str, float]]


def _nothing() -> None:
    """Nobody wants to know."""


class MavlinkConnection:
    """Opened and closed by the link that owns it; may be opened again."""

    def __init__(self, config: MavlinkLinkConfig) -> None:
        """Nothing is opened yet."""
        self._config = config
        self._contact = Contact(config, self)
        self.codec, self.words = self._contact.codec, self._contact.words
        self._streams: list[Streams] = []
        self._wishes: dict[tuple[str, ...], float] = {}
        self._requests = HandshakeRunner(self.leave, self._obstacle)
        self._contact.subscribe(self._requests.hear)  # before anybody else
        self._signing: Signing | None = None
        self.when_lost: Callable[[], None] = _nothing
        """Called when the wire is lost."""
        self.when_back: Callable[[], None] = _nothing
        """Called when an autopilot is heard again that was silent, or whose wire was lost."""
        self._reset()

    def _reset(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._beats = 0
        self._asking: asyncio.Task[None] | None = None
        self._trouble = ""

    # ---- what it is like

    @property
    def state(self) -> str:
        """One of ``closed``, ``connecting``, ``connected``, ``armed``, ``lost``."""
        if self._loop is None:
            return "closed"
        contact = self._contact
        if contact.heard.kind is None:
            return "connecting"
        if not contact.has_wire or contact.heard.is_silent(self._loop.time()):
            return "lost"
        return "armed" if contact.heard.armed else "connected"

    @property
    def kind(self) -> int | None:
        """The autopilot's HEARTBEAT.autopilot; None before the first."""
        return self._contact.heard.kind

    @property
    def text(self) -> str:
        """What became of the wire or of the autopilot, where it was lost; else the autopilot's newest words."""
        if self._loop is not None and self.state == "lost":
            silence_s = self._contact.heard.silence_s(self._loop.time())
            if silence_s < math.inf:
                return f"the link is lost: no HEARTBEAT of the autopilot for {silence_s:.0f} s"
        return self._trouble or self.words.newest

    @property
    def clock(self) -> Trip | None:
        """The autopilot's clock against ours; None until it has answered."""
        return self._contact.timesync.best

    @property
    def newest_trip(self) -> Trip | None:
        """The newest exchange of clocks with the autopilot, however long its way was; None until it has answered."""
        return self._contact.timesync.newest

    @property
    def heard_vision(self) -> bool:
        """Whether somebody else was heard here who tells an autopilot its position."""
        return self._contact.heard_vision

    @property
    def dropped(self) -> dict[str, int]:
        """What was received and not used, and frames of ours that did not leave or came back, by reason."""
        return self._contact.dropped

    def autopilot(self) -> AutopilotAddress:
        """The autopilot at the other end.

        Raises:
            LinkMisuse: there is none yet.
        """
        heard, config = self._contact.heard, self._config
        if self._loop is None or heard.kind is None:
            raise LinkMisuse("the link is not connected")
        target = (config.target_system, config.target_component)
        return AutopilotAddress(self.codec, self.words, *target, heard.kind, heard.vehicle)

    def believe_armed(self, armed: bool) -> None:
        """Believe that the motors are on, or off, until a heartbeat tells."""
        self._contact.heard.believe_armed(asyncio.get_running_loop().time() if armed else None)

    def begin_arming(self) -> None:
        """The operator arms anew: what became of the wire before needs no telling any more."""
        self._trouble = ""

    # ---- for whoever shares it

    def subscribe(self, subscriber: Subscriber) -> Callable[[], None]:
        """Call ``subscriber(message, arrival_s)`` for every message of the autopilot; returns what ends that.

        ``arrival_s`` is on the event loop's clock [s].
        """
        return self._contact.subscribe(subscriber)

    def request(self, streams: Streams) -> None:
        """Have ``open`` ask for the messages that ``streams(HEARTBEAT.autopilot)`` names: name → rate [Hz].

        Raises:
            LinkMisuse: the connection is open already.
        """
        if self._loop is not None:
            raise LinkMisuse("messages must be requested before the link is connected")
        self._streams.append(streams)

    def wish(self, names: tuple[str, ...], rate_hz: float) -> None:
        """Have ``open`` ask for the first message of ``names`` that the autopilot is willing to send, if any.

        Raises:
            LinkMisuse: the connection is open already.
        """
        if self._loop is not None:
            raise LinkMisuse("messages must be asked for before the link is connected")
        self._wishes[names] = rate_hz

    # ---- opening and closing

    async def open(self) -> None:
        """Open the wire, wait for the autopilot's HEARTBEAT, and ask for the messages that are wanted.

        Raises:
            LinkLost: the wire can't be opened, or nobody answered within the configured time.
            LinkRejected: the autopilot refuses to send a message that was requested.
            LinkError: the signing key can't be used.
        """
        if self._loop is not None:
            raise LinkMisuse("the link is connected already; close it first")
        self._loop = asyncio.get_running_loop()
        try:
            self._sign(self._loop)
            await self._contact.open()
        except BaseException:
            self._contact.close()
            self._reset()
            raise
        try:
            await self._contact.wait_for_heartbeat()
        except LinkLost:
            self.close()
            raise
        await self._choose_streams()

    def close(self) -> None:
        """Release the wire. Nothing leaves afterwards."""
        asking = self._asking
        self._note_stamp()
        self._reset()
        if asking is not None:
            asking.cancel()
        self._contact.close()
        self._requests.wake()

    def _sign(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._config.signing_key_file is not None and self._signing is None:
            try:
                self._signing = Signing(Path(self._config.signing_key_file), loop.time)
            except ValueError as error:
                raise LinkError(f"link.signing_key_file: {error}") from None
            self.codec.signer = self._signing.signer

    def _note_stamp(self) -> None:
        if self._signing is not None:
            try:
                self._signing.keep()
            except ValueError as error:
                self._trouble = str(error)

    async def _choose_streams(self) -> None:
        kind = self.autopilot().kind
        wanted = {name: rate for ask in self._streams for name, rate in ask(kind).items()}
        await choose_streams(self.autopilot(), wanted, self._wishes, self.see_through, quiet=self._config.quiet)

    # ---- what the contact tells: see :class:`links.mavlink.connection.Keeper`

    def each_beat(self) -> None:
        """Write the newest time stamp down, now and then."""
        self._beats += 1
        if self._beats % KEEP_STAMP_BEATS == 0 and not self._contact.heard.armed:
            self._note_stamp()

    def lose_wire(self, why: str) -> None:
        """Nothing more is asked for."""
        self.tell(f"the link is lost: {why}")
        self._requests.wake()
        self.when_lost()
        if self._asking is not None:
            self._asking.cancel()

    def resume(self) -> None:
        """Ask for the messages again."""
        self.when_back()
        if self._asking is not None:
            self._asking.cancel()
        self._asking = asyncio.get_running_loop().create_task(self._ask_again())

    def tell(self, trouble: str) -> None:
        """Show it instead of the autopilot's words."""
        self._trouble = trouble

    async def _ask_again(self) -> None:
        self._trouble = "the link is back after it was lost: arm anew to fly"
        try:
            await self._choose_streams()
        except LinkError as error:
            self._trouble = f"the link is back after it was lost, but: {error}"

    # ---- what leaves

    def leave(self, frame: bytes) -> bool:
        """Send one frame, and tell whether it left; nothing leaves on a closed or lost connection."""
        return self._contact.leave(frame)

    async def see_through(
        self, handshake: Handshake, meanwhile: Callable[[float], None] | None = None, period_s: float = POLL_S
    ) -> None:
        """Go through ``handshake``, one at a time, calling ``meanwhile(now_s)`` every ``period_s`` [s].

        Raises:
            LinkRejected: the autopilot refused.
            LinkLost: it did not answer.
            LinkError: the connection was closed meanwhile.
        """
        await self._requests.see_through(handshake, meanwhile, period_s)

    def _obstacle(self) -> LinkError | None:
        if self._loop is None:
            return LinkError("the link was closed before the autopilot answered")
        return None if self._contact.has_wire else LinkLost(self._trouble)


_EPOCH = datetime(2015, 1, 1, tzinfo=UTC)


class StampFile:
    """The newest time stamp, beside the key."""

    def __init__(self, key_file: Path) -> None:
        """``key.stamp`` for the key file ``key``."""
        self._path = key_file.with_name(key_file.name + ".stamp")

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
            raise ValueError(f"cannot read the newest time stamp in {self._path} ({error}): remove it") from None
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
                f"cannot write {self._path} ({error.strerror}): signing needs it, or stamps repeat"
            ) from None


class Signing:
    """A key in use: its signer, and the stamps that it may use."""

    def __init__(self, key_file: Path, time_s: Callable[[], float]) -> None:
        """Begin where the last run ended, and follow the clock ``time_s()`` [s].

        Raises:
            ValueError: the key or its newest stamp can't be used.
        """
        key = read_key(key_file)
        self._stamps = StampFile(key_file)
        first, begun_s = self._stamps.first(), time_s()
        self.signer = Signer(key, lambda: first + int((time_s() - begun_s) * TICKS_PER_S))
        self.signer.stamp = first - 1
        self.keep()

    def keep(self) -> None:
        """Write the newest stamp down; raises ValueError."""
        self._stamps.keep(self.signer.stamp)
