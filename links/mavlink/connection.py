"""Connection to one autopilot over one wire at a time: heartbeats, clocks, hand-shakes, and
messages for their readers.

When the autopilot is heard again after a silence, or after its wire was lost, it may have
restarted: it is asked for its messages again, and set-points do not leave until the vehicle is
armed anew.
"""

import asyncio
import math
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from links.core import LinkError, LinkLost, LinkMisuse
from links.io import format_address
from links.mavlink.handshake_runner import HandshakeRunner
from links.mavlink.protocol import (
    MOST_SENDERS,
    AutopilotAddress,
    AutopilotTexts,
    HeartbeatMonitor,
    MavCommand,
    MavlinkCodec,
    MavlinkLinkConfig,
    Message,
    OtherTraffic,
    RoundTrip,
    TargetSenders,
    Timesync,
    choose_streams,
    is_autopilot,
)
from links.mavlink.stamp_file import StampFile
from links.mavlink.transport import ReconnectingTransport
from links.text import Sentence, link_notice

HEARTBEAT_S = 1.0
"""Period of our own HEARTBEAT [s]."""
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
Streams = Callable[[int], Mapping[str, float]]


class MavlinkConnection:
    """Connection to one autopilot. It may be opened again after it was closed."""

    def __init__(
        self,
        config: MavlinkLinkConfig,
        *,
        on_loss: Callable[[], None] = lambda: None,
        on_return: Callable[[], None] = lambda: None,
        is_commanding: Callable[[], bool] = lambda: False,
    ) -> None:
        """Nothing is opened yet.

        Args:
            config: the wire, and who is at its end.
            on_loss: called when the wire is lost.
            on_return: called when an autopilot is heard again that was silent, or whose wire was
                lost.
            is_commanding: whether a command or its bring-down may still leave: it belongs to the
                autopilot that was armed, and to no other that speaks in its place from another
                address.
        """
        self._config = config
        self._target = (config.target_system, config.target_component)
        self.codec = MavlinkCodec(config.system_id, config.component_id)
        self.words = AutopilotTexts()
        self.others = OtherTraffic(config)
        """Senders other than the vehicle."""
        self.other_addresses: tuple[str, ...] = ()
        """Addresses other than the vehicle's that sent to our port, at most ``MOST_SENDERS``."""
        self.read = 0
        """Number of reads from the wire."""
        self._dropped: Counter[str] = Counter()
        self._wires = ReconnectingTransport(
            config,
            self._dropped,
            on_data=self._receive,
            on_loss=self._lose,
            on_news=self._set_trouble,
        )
        self._streams: list[Streams] = []
        self._wishes: dict[tuple[str, ...], float] = {}
        self._requests = HandshakeRunner(self.send, self._obstacle)
        self.run_handshake = self._requests.run
        """Run a hand-shake (:meth:`HandshakeRunner.run`)."""
        self._subscribers: list[Subscriber] = [self._requests.take_message]
        self._stamps = (
            StampFile(Path(config.signing_key_file))
            if config.signing_key_file is not None
            else None
        )
        self._on_loss, self._on_return, self._is_commanding = on_loss, on_return, is_commanding
        self._reset()

    def _reset(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._first_beat = asyncio.Event()
        self._next_beat: asyncio.TimerHandle | None = None
        self._beats = 0
        self._requesting: asyncio.Task[None] | None = None
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
        if self._wires.wire is None or self._heard.is_silent(self._loop.time()):
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
    def clock(self) -> RoundTrip | None:
        """The autopilot's clock against ours; None until it has answered."""
        return self.timesync.best

    @property
    def rival(self) -> str:
        """Describe the other sender of set-points in the last ``NEWS_S``; empty without one."""
        return "" if self._loop is None else self.others.rival(self._loop.time())

    @property
    def conflict(self) -> str:
        """Why it is not known which of two autopilots would obey; empty where one is alone."""
        if self._loop is None or self._heard.kind is None:
            return ""
        return self._senders.conflict(self._heard.address, self._loop.time())

    @property
    def second_path(self) -> str:
        """Warning that the autopilot is heard by a second path; empty where it is not."""
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
        """Take the motors for on, or off, until a heartbeat says so."""
        self._heard.believe_armed(asyncio.get_running_loop().time() if armed else None)

    def begin_arming(self) -> None:
        """Forget troubles of the wire so far: the operator arms anew."""
        self._trouble = ""

    def note_examined(self) -> None:
        """Note that the autopilot heard now was found fit to be armed."""
        self._senders.examine(self._heard.address)

    # ---- for whoever shares it

    def subscribe(self, subscriber: Subscriber) -> Callable[[], None]:
        """Call ``subscriber(message, arrival_s)`` for every message of the autopilot.

        ``arrival_s`` is on the event loop's clock [s]. The returned function ends that.
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
            await self._wires.open()
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
            raise LinkLost(self._describe_silence()) from None

    def _describe_silence(self) -> Sentence:
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
        beat, asking = self._next_beat, self._requesting
        self._keep_stamp()
        self._reset()
        for pending in (beat, asking):
            if pending is not None:
                pending.cancel()
        self._wires.cut()
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

    def _keep_stamp(self) -> None:
        if self._stamps is not None and self.codec.signer is not None:
            try:
                self._stamps.keep(self.codec.signer.stamp)
            except ValueError as error:
                self._trouble = str(error)

    async def _choose_streams(self) -> None:
        kind = self.autopilot().kind
        wanted = {name: rate for ask in self._streams for name, rate in ask(kind).items()}
        await choose_streams(
            self.autopilot(), wanted, self._wishes, self.run_handshake, quiet=self._config.quiet
        )

    def _set_trouble(self, trouble: str) -> None:
        """Show ``trouble`` instead of the autopilot's words."""
        self._trouble = trouble

    def _lose(self, trouble: str) -> None:
        """Stop all requests: the wire has ended by itself."""
        self._heard.lose()
        self.codec.forget()
        self._set_trouble(trouble)
        self._requests.wake()
        self._on_loss()
        if self._requesting is not None:
            self._requesting.cancel()

    def _resume(self) -> None:
        """Request the messages again of an autopilot that is heard again: it may have restarted."""
        self._on_return()
        if self._requesting is not None:
            self._requesting.cancel()
        self._requesting = asyncio.get_running_loop().create_task(self._request_again())

    async def _request_again(self) -> None:
        self._trouble = link_notice("mavlink.back").text
        try:
            await self._choose_streams()
        except LinkError as error:
            self._trouble = link_notice("mavlink.back_but", why=error).text

    # ---- what leaves

    def send(self, frame: bytes) -> bool:
        """Send one frame; return whether it left, which it never does on a closed or lost
        connection.
        """
        return self._wires.send(frame, self._heard.address)

    def _obstacle(self) -> LinkError | None:
        if self._loop is None:
            return LinkError(link_notice("mavlink.closed"))
        return None if self._wires.wire is not None else LinkLost(self._trouble)

    def _beat(self) -> None:
        if self._loop is None:
            return
        wire = self._wires.wire
        if wire is not None and (wire.speaks_first or self._heard.address is not None):
            self.send(self.codec.heartbeat())
            if self._heard.kind is not None:
                self._ask_the_time(self._loop.time())
        self._beats += 1
        if not self._heard.armed:  # a flight must not wait for a disk
            self._keep_stamp()
        self._next_beat = self._loop.call_later(HEARTBEAT_S, self._beat)

    def _ask_the_time(self, now_s: float) -> None:
        self.send(self.codec.timesync_question(self.timesync.ask(now_s)))

    def _ask_identity(self, address: Any) -> None:
        """Ask the autopilot at ``address`` for its hardware id, unless it has told."""
        if not self._senders.is_known(address):
            number = float(self.codec.message_number("AUTOPILOT_VERSION"))
            self._wires.send(
                self.codec.command(*self._target, MavCommand.REQUEST_MESSAGE, number), address
            )

    # ---- what arrives

    def _receive(self, data: bytes, source: Any) -> None:
        """Take data from the address ``source``."""
        wire, known = self._wires.wire, self._heard.address
        if self._loop is None or wire is None:
            return
        self.read += 1
        now = self._loop.time()
        if (
            known is not None
            and source != known
            and (self._is_commanding() or not self._heard.is_silent(now))
        ):
            self._dropped["other_address"] += 1
            self._receive_other(data, source, now)
            return
        for message in self.codec.feed(data, source if wire.datagrams else None):
            if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
                self._dropped["other_system"] += 1
                self.others.take_message(
                    message, self._name_address(source), now, ours=self._is_commanding()
                )
                continue
            if message.get_type() == "HEARTBEAT":
                if not is_autopilot(message):
                    self._dropped["other_system"] += 1
                    continue
                self._heartbeat(message, source, now)
            # Messages of an address that has sent no heartbeat are not the autopilot's.
            if self._heard.kind is not None and self._heard.address in (None, source):
                self._publish(message, now)

    def _receive_other(self, data: bytes, source: Any, now_s: float) -> None:
        """Take data from another address than the vehicle's: only to find a second autopilot."""
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
            self.words.take_message(message)
        elif name == "TIMESYNC" and message.tc1 == 0:  # a question, not an answer
            self.send(self.codec.timesync_reply(message, now_s))
        elif name == "AUTOPILOT_VERSION":
            self._senders.identify(self._heard.address, message)
        elif name == "TIMESYNC":
            self.timesync.take_answer(message.tc1, message.ts1, now_s)
        for subscriber in self._subscribers:
            subscriber(message, now_s)

    def _heartbeat(self, message: Message, source: Any, now_s: float) -> None:
        wire = self._wires.wire
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
                self.send(self.codec.heartbeat())
            self._ask_the_time(now_s)
            self._first_beat.set()
            # A port may end in the moment of an answer.
            if not is_first and self._wires.wire is not None:
                self._resume()
                self._heard.believe_armed(None)
                self.timesync = Timesync()
                self._ask_identity(self._heard.address)
        self._heard.take_armed(message, now_s)
