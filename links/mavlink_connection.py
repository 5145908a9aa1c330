"""One UDP socket to one autopilot: who is heard, our heartbeat, its messages to whoever reads them, and requests."""

import asyncio
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

from links.address import parse_address
from links.datagrams import Datagrams
from links.mavlink_codec import ARMED, GROUND_STATION, MavlinkCodec, Message
from links.mavlink_config import MavlinkLinkConfig
from links.mavlink_handshake import silence, stream
from links.mavlink_steps import Autopilot, Handshake
from links.mavlink_words import Words
from links.port import LinkError, LinkLost, LinkMisuse

HEARTBEAT_S = 1.0
"""Period of our own HEARTBEAT [s]."""
POLL_S = 0.05
"""How often a request without a stream of set-points looks at the time [s]."""
STALE_NEWS_S = 0.5
"""A HEARTBEAT may have left before the arming that it denies: it is not believed for this long after it [s]."""

QUIETENED = (
    "ATTITUDE", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "ODOMETRY", "TIMESYNC",
    "ATTITUDE_TARGET", "HIGHRES_IMU", "RAW_IMU", "SERVO_OUTPUT_RAW", "RC_CHANNELS", "VFR_HUD", "ALTITUDE",
    "POSITION_TARGET_LOCAL_NED", "POSITION_TARGET_GLOBAL_INT",
)  # fmt: skip
"""What autopilots send by default, ten times a second or more, and what nobody here reads unless asked for."""

Subscriber = Callable[[Message, float], None]
Streams = Callable[[int], Mapping[str, float]]


class MavlinkConnection(asyncio.DatagramProtocol):
    """Opened and closed by the link that owns it; may be opened again."""

    def __init__(self, config: MavlinkLinkConfig) -> None:
        """Nothing is opened yet."""
        self._config = config
        self._target = (config.target_system, config.target_component)
        self.codec = MavlinkCodec(config.system_id, config.component_id)
        self.words = Words()
        self._dropped: Counter[str] = Counter()
        self._subscribers: list[Subscriber] = []
        self._streams: list[Streams] = []
        self._one_at_a_time = asyncio.Lock()
        self._news = asyncio.Event()
        self._handshake: Handshake | None = None
        self._reset()

    def _reset(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._transport: Datagrams | None = None
        self._next_beat: asyncio.TimerHandle | None = None
        self._peer: Any = None
        self._kind: int | None = None
        self._heard_s = 0.0
        self._armed_s: float | None = None

    # ---- what it is like

    @property
    def state(self) -> str:
        """One of ``closed``, ``connecting``, ``connected``, ``armed``, ``lost``."""
        if self._transport is None or self._loop is None:
            return "closed"
        if self._kind is None:
            return "connecting"
        if self._loop.time() - self._heard_s > self._config.heartbeat_timeout_s:
            return "lost"
        return "connected" if self._armed_s is None else "armed"

    @property
    def kind(self) -> int | None:
        """The autopilot's HEARTBEAT.autopilot; None before the first."""
        return self._kind

    @property
    def dropped(self) -> dict[str, int]:
        """What was received and not used, by reason; and frames of ours that did not leave or came back.

        Those are ``congested`` (the network had no room), ``undeliverable`` (given back), ``no_peer`` (none yet).
        """
        return dict(self.codec.dropped + self._dropped)

    def autopilot(self) -> Autopilot:
        """The autopilot at the other end.

        Raises:
            LinkMisuse: there is none yet.
        """
        if self._transport is None or self._kind is None:
            raise LinkMisuse("the link is not connected")
        return Autopilot(self.codec, self.words, *self._target, self._kind)

    def armed(self, armed: bool) -> None:
        """Believe that the motors are on, or off, until a heartbeat tells."""
        self._armed_s = asyncio.get_running_loop().time() if armed else None

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
        if self._transport is not None:
            raise LinkMisuse("messages must be requested before the link is connected")
        self._streams.append(streams)

    # ---- opening and closing

    async def open(self) -> None:
        """Open the socket, wait for the autopilot's HEARTBEAT, and ask for the messages that are wanted.

        Raises:
            LinkLost: the address can't be opened, or nobody answered within the configured time.
            LinkRejected: the autopilot refuses to send a message that was requested.
        """
        if self._transport is not None:
            raise LinkMisuse("the link is connected already; close it first")
        config = self._config
        self._loop = asyncio.get_running_loop()
        address = parse_address(config.address)
        local, remote = (address, None) if config.remote is None else (None, address)
        try:
            transport, _ = await self._loop.create_datagram_endpoint(lambda: self, local_addr=local, remote_addr=remote)
            self._transport = Datagrams(transport)
        except OSError as error:
            raise LinkLost(
                f"cannot open {config.address} for MAVLink ({error.strerror or error}): stop the program that "
                "holds this port, or give an address of this machine"
            ) from error
        self._beat()
        try:
            async with asyncio.timeout(config.connect_timeout_s):
                while self._kind is None:
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            self.close()
            raise LinkLost(self._silence()) from None
        await self._choose_streams(self._kind)

    def close(self) -> None:
        """Release the socket. Nothing leaves afterwards."""
        transport, beat = self._transport, self._next_beat
        self._reset()
        if beat is not None:
            beat.cancel()
        if transport is not None:
            transport.abort()
        self._news.set()

    def _silence(self) -> str:
        config = self._config
        what = f"got only {self.dropped}" if self.dropped else "nothing came at all"
        return (
            f"no HEARTBEAT of MAVLink system {config.target_system}, component {config.target_component} on "
            f"{config.address} within {config.connect_timeout_s:g} s ({what}): check that the autopilot runs, that "
            "it sends to this address, and its system id (MAV_SYS_ID or SYSID_THISMAV)"
        )

    async def _choose_streams(self, kind: int) -> None:
        wanted = {name: rate for ask in self._streams for name, rate in ask(kind).items()}
        for name in QUIETENED if self._config.quiet else ():
            if name not in wanted:
                try:
                    await self.see_through(silence(self.autopilot(), name))
                except LinkLost:
                    break  # it takes no such commands; a link with idle talk on it works too
        for name, rate in wanted.items():
            await self.see_through(stream(self.autopilot(), name, rate))

    # ---- what leaves

    def leave(self, frame: bytes) -> bool:
        """Send one frame now or never; False where it did not leave. Nothing happens on a closed connection."""
        if self._transport is None:
            return False
        fault = self._transport.send(frame, self._peer)
        if fault:
            self._dropped[fault] += 1
        return not fault

    def _beat(self) -> None:
        if self._loop is None:
            return
        if self._config.remote is not None or self._peer is not None:
            self.leave(self.codec.heartbeat())
        self._next_beat = self._loop.call_later(HEARTBEAT_S, self._beat)

    async def see_through(
        self, handshake: Handshake, meanwhile: Callable[[float], None] | None = None, period_s: float = POLL_S
    ) -> None:
        """Go through ``handshake``, one at a time, calling ``meanwhile(now_s)`` every ``period_s`` [s].

        Raises:
            LinkRejected: the autopilot refused.
            LinkLost: it did not answer.
            LinkError: the connection was closed meanwhile.
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
            if self._transport is None:
                raise LinkError("the link was closed before the autopilot answered")
            now = loop.time()
            if now >= due_s:
                if meanwhile is not None:
                    meanwhile(now)
                due_s += period_s
                if due_s <= now:
                    due_s = now + period_s  # a late frame is left out, never made up for
            for frame in handshake.poll(now):
                self.leave(frame)
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

    # ---- what arrives

    def error_received(self, exc: Exception) -> None:
        """Count what the network says of a datagram of ours (called by the event loop)."""
        self._dropped["undeliverable"] += 1

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        if self._loop is None:
            return
        if self._peer is not None and addr != self._peer:
            self._dropped["other_address"] += 1
            return
        now = self._loop.time()
        for message in self.codec.feed_datagram(data):
            if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
                self._dropped["other_system"] += 1
                continue
            if message.get_type() == "HEARTBEAT":
                self._heartbeat(message, addr, now)
            if self._kind is not None:  # whoever has sent no heartbeat may be anybody
                self._publish(message, now)

    def _publish(self, message: Message, now_s: float) -> None:
        name = message.get_type()
        if name == "STATUSTEXT":
            self.words.hear(message)
        elif name == "TIMESYNC" and message.tc1 == 0:  # a question, not an answer
            self.leave(self.codec.timesync_reply(message, now_s))
        if self._handshake is not None:
            self._handshake.hear(message, now_s)
            self._news.set()
        for subscriber in self._subscribers:
            subscriber(message, now_s)

    def _heartbeat(self, message: Message, addr: Any, now_s: float) -> None:
        if message.type == GROUND_STATION:
            return
        self._heard_s = now_s
        if self._kind is None:
            self._kind = message.autopilot
            if self._config.remote is None:
                self._peer = addr
                self.leave(self.codec.heartbeat())
            self._news.set()
        if message.base_mode & ARMED:
            if self._armed_s is None:
                self._armed_s = now_s
        elif self._armed_s is not None and now_s - self._armed_s > STALE_NEWS_S:
            self._armed_s = None
