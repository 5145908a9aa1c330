"""Connection: one wire to one autopilot, its messages to whoever reads them, and requests, one hand-shake at a time.

When the autopilot is heard again after a silence, or after its wire was lost, it is asked for its messages again, as
it may have restarted. Set-points do not leave until the vehicle is armed anew: nobody knows what it did meanwhile.
"""

import asyncio
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from links.core import LinkError, LinkLost, LinkMisuse
from links.mavlink.contact import Contact, Subscriber
from links.mavlink.procedures import Autopilot, Handshake, choose_streams
from links.mavlink.protocol import MavlinkLinkConfig, Message, Trip

if TYPE_CHECKING:
    from links.mavlink.signing_key import Signing


POLL_S = 0.05
"""How often a request without a stream of set-points looks at the time [s]."""


class Requests:
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
        self._requests = Requests(self.leave, self._obstacle)
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

    def autopilot(self) -> Autopilot:
        """The autopilot at the other end.

        Raises:
            LinkMisuse: there is none yet.
        """
        heard, config = self._contact.heard, self._config
        if self._loop is None or heard.kind is None:
            raise LinkMisuse("the link is not connected")
        target = (config.target_system, config.target_component)
        return Autopilot(self.codec, self.words, *target, heard.kind, heard.vehicle)

    def armed(self, armed: bool) -> None:
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
            await self._contact.made()
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
            from links.mavlink.signing_key import Signing

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

    # ---- what the contact tells: see :class:`links.mavlink.contact.Keeper`

    def each_beat(self) -> None:
        """Write the newest time stamp down, now and then."""
        self._beats += 1
        if self._beats % KEEP_STAMP_BEATS == 0 and not self._contact.heard.armed:
            self._note_stamp()

    def lost(self, why: str) -> None:
        """Nothing more is asked for."""
        self.tell(f"the link is lost: {why}")
        self._requests.wake()
        self.when_lost()
        if self._asking is not None:
            self._asking.cancel()

    def back(self) -> None:
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
