"""Contact with one autopilot: heartbeats both ways, each other's time, and its messages to whoever reads them."""

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import Any, Protocol

from links.core import LinkLost
from links.mavlink.protocol import GROUND_STATION, Heard, MavlinkCodec, MavlinkLinkConfig, Message, Timesync, Words
from links.mavlink.transport import LastingWire

VISION = (
    "VISION_POSITION_ESTIMATE", "GLOBAL_VISION_POSITION_ESTIMATE", "VICON_POSITION_ESTIMATE", "ATT_POS_MOCAP",
    "ODOMETRY", "GPS_INPUT",
)  # fmt: skip
"""Messages by which somebody tells an autopilot where it is."""
HEARTBEAT_S = 1.0
"""Period of our own HEARTBEAT [s]."""

Subscriber = Callable[[Message, float], None]


class Keeper(Protocol):
    """Whoever keeps the contact."""

    def each_beat(self) -> None:
        """Our heartbeat was due."""
        ...

    def lost(self, why: str) -> None:
        """The wire has ended by itself."""
        ...

    def back(self) -> None:
        """The autopilot is heard again that was silent, or whose wire was lost."""
        ...

    def tell(self, trouble: str) -> None:
        """Take what becomes of a wire that was lost, for the operator."""
        ...


class Contact:
    """Over one wire. Opened and closed by its keeper; may be opened again."""

    def __init__(self, config: MavlinkLinkConfig, keeper: Keeper) -> None:
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
        self._line = LastingWire(config, self._dropped, hear=self._hear, lose=self._lose, tell=keeper.tell)
        self._subscribers: list[Subscriber] = []
        self._reset()

    def _reset(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._next_beat: asyncio.TimerHandle | None = None
        self.heard = Heard(self._config.heartbeat_timeout_s)
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

    async def made(self) -> None:
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
        self._keeper.lost(why)

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
            self.timesync.answered(message.tc1, message.ts1, now_s)
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
                self._keeper.back()
                self.heard.believe_armed(None)
                self.timesync = Timesync()
        self.heard.take_armed(message, now_s)
