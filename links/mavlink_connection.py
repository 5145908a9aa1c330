"""One wire to one autopilot: who is heard, our heartbeat, its messages to whoever reads them, and requests.

A wire that is lost (unplugged, closed by the other end) is opened again, with growing pauses. When the autopilot is
heard again after that or after a silence, it is asked for its messages again, as it may have restarted. Set-points do
not leave until the vehicle is armed anew: nobody knows what it did meanwhile.
"""

import asyncio
import math
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from links.mavlink_codec import ARMED, GROUND_STATION, MavlinkCodec, Message
from links.mavlink_config import MavlinkLinkConfig
from links.mavlink_requests import POLL_S, Requests
from links.mavlink_steps import Autopilot, Handshake
from links.mavlink_streams import choose_streams
from links.mavlink_wire import Wire, opener
from links.mavlink_words import Words
from links.port import LinkError, LinkLost, LinkMisuse
from links.timesync import Timesync, Trip

if TYPE_CHECKING:
    from links.mavlink_key import Signing

HEARTBEAT_S = 1.0
"""Period of our own HEARTBEAT [s]."""
STALE_NEWS_S = 0.5
"""A HEARTBEAT may have left before the arming that it denies: it is not believed for this long after it [s]."""

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 8.0
"""Before opening a lost wire again [s]; each pause is twice the one before."""
KEEP_STAMP_BEATS = 10
"""How often the newest time stamp of signing is written down, in heartbeats; never while armed."""

Subscriber = Callable[[Message, float], None]
Streams = Callable[[int], Mapping[str, float]]


def _nothing() -> None:
    """Nobody wants to know."""


class MavlinkConnection:
    """Opened and closed by the link that owns it; may be opened again. The :class:`links.mavlink_wire.Ear`."""

    def __init__(self, config: MavlinkLinkConfig) -> None:
        """Nothing is opened yet."""
        self._config = config
        self._target = (config.target_system, config.target_component)
        self.codec = MavlinkCodec(config.system_id, config.component_id)
        self.words = Words()
        self._dropped: Counter[str] = Counter()
        self._subscribers: list[Subscriber] = []
        self._streams: list[Streams] = []
        self._requests = Requests(self.leave, self._obstacle)
        self._first_beat = asyncio.Event()
        self._signing: Signing | None = None
        self.when_lost: Callable[[], None] = _nothing
        """Called when the wire is lost."""
        self.when_back: Callable[[], None] = _nothing
        """Called when an autopilot is heard again that was silent, or whose wire was lost."""
        self._reset()

    def _reset(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._wire: Wire | None = None
        self._next_beat: asyncio.TimerHandle | None = None
        self._beats = 0
        self._returning: asyncio.Task[None] | None = None
        self._peer: Any = None
        self._kind: int | None = None
        self._vehicle = 0
        self._heard_s = 0.0
        self._armed_s: float | None = None
        self._trouble = ""
        self._timesync = Timesync()

    # ---- what it is like

    @property
    def state(self) -> str:
        """One of ``closed``, ``connecting``, ``connected``, ``armed``, ``lost``."""
        if self._loop is None:
            return "closed"
        if self._kind is None:
            return "connecting"
        if self._wire is None or self._is_silent(self._loop.time()):
            return "lost"
        return "connected" if self._armed_s is None else "armed"

    def _is_silent(self, now_s: float) -> bool:
        return now_s - self._heard_s > self._config.heartbeat_timeout_s

    @property
    def kind(self) -> int | None:
        """The autopilot's HEARTBEAT.autopilot; None before the first."""
        return self._kind

    @property
    def text(self) -> str:
        """What became of the wire or of the autopilot, where it was lost; else the autopilot's newest words."""
        if self._loop is not None and self.state == "lost" and self._heard_s > -math.inf:
            return f"the link is lost: no HEARTBEAT of the autopilot for {self._loop.time() - self._heard_s:.0f} s"
        return self._trouble or self.words.newest

    @property
    def clock(self) -> Trip | None:
        """The autopilot's clock against ours; None until it has answered."""
        return self._timesync.best

    @property
    def dropped(self) -> dict[str, int]:
        """What was received and not used, by reason; and frames of ours that did not leave or came back.

        Those are ``congested`` (the network had no room), ``full`` (they would have had to wait), ``undeliverable``
        (given back), ``no_peer`` (none yet).
        """
        return dict(self.codec.dropped + self._dropped)

    def autopilot(self) -> Autopilot:
        """The autopilot at the other end.

        Raises:
            LinkMisuse: there is none yet.
        """
        if self._loop is None or self._kind is None:
            raise LinkMisuse("the link is not connected")
        return Autopilot(self.codec, self.words, *self._target, self._kind, self._vehicle)

    def armed(self, armed: bool) -> None:
        """Believe that the motors are on, or off, until a heartbeat tells."""
        self._armed_s = asyncio.get_running_loop().time() if armed else None

    def begin_arming(self) -> None:
        """The operator arms anew: what became of the wire before needs no telling any more."""
        self._trouble = ""

    # ---- for whoever shares it

    def subscribe(self, subscriber: Subscriber) -> Callable[[], None]:
        """Call ``subscriber(message, arrival_s)`` for every message of the autopilot; returns what ends that.

        ``arrival_s`` is on the event loop's clock [s].
        """
        self._subscribers.append(subscriber)
        return lambda: self._subscribers.remove(subscriber)

    def request(self, streams: Streams) -> None:
        """Have ``open`` ask for the messages that ``streams(HEARTBEAT.autopilot)`` names: name → rate [Hz].

        Raises:
            LinkMisuse: the connection is open already.
        """
        if self._loop is not None:
            raise LinkMisuse("messages must be requested before the link is connected")
        self._streams.append(streams)

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
        config = self._config
        self._loop = asyncio.get_running_loop()
        try:
            self._sign(self._loop)
            wire = await opener(config)(config, self)
        except OSError as error:
            self._reset()
            raise LinkLost(
                f"cannot open {config.address} for MAVLink ({error.strerror or error}): stop the program that "
                "holds this port, or give an address of this machine"
                if config.tcp is None and config.serial is None
                else f"cannot open {config.address} for MAVLink ({error.strerror or error}): check that it is there, "
                "that you may open it, and that no other program has it"
            ) from error
        except BaseException:
            self._reset()
            raise
        if self._loop is None:
            wire.cut()
            raise LinkError("the link was closed before it was open")
        self._wire = wire
        self._first_beat.clear()
        self._beat()
        try:
            async with asyncio.timeout(config.connect_timeout_s):
                await self._first_beat.wait()
        except TimeoutError:
            self.close()
            raise LinkLost(self._silence()) from None
        await self._choose_streams()

    def close(self) -> None:
        """Release the wire. Nothing leaves afterwards."""
        wire, beat, returning = self._wire, self._next_beat, self._returning
        self._note_stamp()
        self._reset()
        if beat is not None:
            beat.cancel()
        if returning is not None:
            returning.cancel()
        if wire is not None:
            wire.cut()
        self.codec.forget()
        self._requests.wake()

    def _sign(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._config.signing_key_file is not None and self._signing is None:
            from links.mavlink_key import Signing

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

    def _silence(self) -> str:
        config = self._config
        what = f"got only {self.dropped}" if self.dropped else "nothing came at all"
        return (
            f"no HEARTBEAT of MAVLink system {config.target_system}, component {config.target_component} on "
            f"{config.address} within {config.connect_timeout_s:g} s ({what}): check that the autopilot runs, that "
            "it sends to this address, and its system id (MAV_SYS_ID or SYSID_THISMAV)"
        )

    async def _choose_streams(self) -> None:
        kind = self.autopilot().kind
        wanted = {name: rate for ask in self._streams for name, rate in ask(kind).items()}
        await choose_streams(self.autopilot(), wanted, self.see_through, quiet=self._config.quiet)

    # ---- losing the wire, and coming back

    def gone(self, why: str) -> None:
        """The wire has ended by itself (called by the wire)."""
        if self._loop is None:
            return
        self._wire = None
        self._peer = None
        self._armed_s = None
        self._heard_s = -math.inf
        self.codec.forget()
        self._trouble = f"the link is lost: {why}"
        self._requests.wake()
        self.when_lost()
        if self._returning is not None:
            self._returning.cancel()
        self._returning = self._loop.create_task(self._return(why))

    async def _return(self, why: str) -> None:
        """Open the wire again, as often as it takes."""
        assert self._loop is not None, "only an open connection comes back"
        pause_s = FIRST_PAUSE_S
        while self._wire is None:
            self._trouble = f"the link is lost: {why}; trying again in {pause_s:g} s"
            await asyncio.sleep(pause_s)
            try:
                self._wire = await opener(self._config)(self._config, self)
            except OSError as error:
                why = f"cannot open {self._config.address} ({error.strerror or error})"
                pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
        self._trouble = "the wire is back: waiting for the autopilot's HEARTBEAT"

    async def _ask_again(self) -> None:
        self._trouble = "the link is back after it was lost: arm anew to fly"
        try:
            await self._choose_streams()
        except LinkError as error:
            self._trouble = f"the link is back after it was lost, but: {error}"

    # ---- what leaves

    def leave(self, frame: bytes) -> bool:
        """Send one frame, and tell whether it left; nothing leaves on a closed or lost connection."""
        if self._wire is None:
            return False
        why = self._wire.leave(frame, self._peer)
        if why:
            self._dropped[why] += 1
        return not why

    def _beat(self) -> None:
        if self._loop is None:
            return
        if self._wire is not None and (self._wire.speaks_first or self._peer is not None):
            self.leave(self.codec.heartbeat())
            if self._kind is not None:
                self._ask_the_time(self._loop.time())
        self._beats += 1
        if self._beats % KEEP_STAMP_BEATS == 0 and self._armed_s is None:
            self._note_stamp()
        self._next_beat = self._loop.call_later(HEARTBEAT_S, self._beat)

    def _ask_the_time(self, now_s: float) -> None:
        self.leave(self.codec.timesync_question(self._timesync.ask(now_s)))

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
        return LinkLost(self._trouble) if self._wire is None else None

    # ---- what arrives

    def undeliverable(self) -> None:
        """Count what the network gave back (called by the wire)."""
        self._dropped["undeliverable"] += 1

    def hear(self, data: bytes, source: Any) -> None:
        """Take what arrived from the address ``source`` (called by the wire)."""
        if self._loop is None or self._wire is None:
            return
        now = self._loop.time()
        if self._peer is not None and source != self._peer and not self._is_silent(now):
            self._dropped["other_address"] += 1
            return
        read = self.codec.feed_datagram if self._wire.datagrams else self.codec.feed
        for message in read(data):
            if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
                self._dropped["other_system"] += 1
                continue
            if message.get_type() == "HEARTBEAT":
                self._heartbeat(message, source, now)
            if self._kind is not None and self._peer in (None, source):  # others have sent no heartbeat yet
                self._publish(message, now)

    def _publish(self, message: Message, now_s: float) -> None:
        name = message.get_type()
        if name == "STATUSTEXT":
            self.words.hear(message)
        elif name == "TIMESYNC" and message.tc1 == 0:  # a question, not an answer
            self.leave(self.codec.timesync_reply(message, now_s))
        elif name == "TIMESYNC":
            self._timesync.answered(message.tc1, message.ts1, now_s)
        self._requests.hear(message, now_s)
        for subscriber in self._subscribers:
            subscriber(message, now_s)

    def _heartbeat(self, message: Message, source: Any, now_s: float) -> None:
        if message.type == GROUND_STATION or self._wire is None:
            return
        first, back = self._kind is None, self._kind is not None and self._is_silent(now_s)
        self._heard_s = now_s
        if first or back:
            self._kind, self._vehicle = message.autopilot, message.type
            if not self._wire.speaks_first:
                self._peer = source
                self.leave(self.codec.heartbeat())
            self._ask_the_time(now_s)
            self._first_beat.set()
        if back and self._loop is not None and self._wire is not None:  # a port may end in the moment of an answer
            self.when_back()
            self._armed_s = None
            self._timesync = Timesync()
            if self._returning is not None:
                self._returning.cancel()
            self._returning = self._loop.create_task(self._ask_again())
        if message.base_mode & ARMED:
            if self._armed_s is None:
                self._armed_s = now_s
        elif self._armed_s is not None and now_s - self._armed_s > STALE_NEWS_S:
            self._armed_s = None
