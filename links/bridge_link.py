"""The link to an RF bridge: the pacer and the module are on another computer, as in the paper's set-up.

To the link it is a pacer like any other (links/paced_link.py). What it wants goes out as a whole in every datagram: the
newest command as soon as it comes, and the rest again and again until the bridge has heard it. The bridge has the
dead man's switch; nothing here can make an old command count.
"""

import asyncio
import math
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import msgspec

from links.address import parse_address
from links.bridge_codec import (
    DOWNS,
    HELLO,
    NONCE_BYTES,
    WELCOME,
    WELCOMES,
    Down,
    Hello,
    Up,
    Welcome,
    first_seal,
    kind_of,
    session_seals,
)
from links.clock_bounds import ClockBounds
from links.datagrams import Datagrams
from links.key_file import read_key
from links.paced_link import PacedLink
from links.pacer_messages import Arm, End, Give, Hear, Order, Report, Serve, Stop
from links.port import Command, LinkLost, LinkRejected
from links.rf_codec import Manner, Service
from links.thrust_curve import signal

BEAT_S = 0.1
"""Longest time between two datagrams [s]."""
AGAIN_S = 0.02
"""What the bridge has not heard is said again after this time [s]."""
MUTE_S = 0.8
"""A bridge that says nothing for so long is asked for a new session: it may have been started anew [s]."""
REMEMBERED = 256
"""So many datagrams ago may lie the one that an answer is to."""

Nonce = Callable[[int], bytes]


class BridgeLinkConfig(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="rf_bridge", tag_field="kind"
):
    """`groundstation rf-bridge` on another computer, which has the module. That one knows port, codec and channels."""

    remote: str = "127.0.0.1:14600"
    """Its address."""
    key_file: str = "bridge.key"
    """File with the key that both computers share, mode 0600; `groundstation rf-bridge --make-key FILE` makes one."""
    connect_timeout_s: Annotated[float, msgspec.Meta(gt=0.0, le=60.0)] = 5.0
    """How long to wait for the bridge [s]."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: ``remote`` is no address.
        """
        parse_address(self.remote)

    @property
    def thrust_curve(self) -> None:
        """None: the vehicle's counts."""
        return None


class BridgeLink(PacedLink):
    """Implements :class:`links.port.CommandLink` (see there)."""

    def __init__(
        self,
        config: BridgeLinkConfig,
        *,
        thrust_max_n: float,
        thrust_curve: float = 0.0,
        key: bytes | None = None,
        nonce: Nonce = os.urandom,
    ) -> None:
        """Nothing is opened yet; ``thrust_max_n`` is the thrust at full throttle [N].

        ``thrust_curve`` is the vehicle's (links/thrust_curve.py); the bridge's own is applied on top. ``key`` stands
        for the key file, and ``nonce`` for chance, where a simulation has its own.
        """

        async def open_pacer(hear: Hear) -> "RemotePacer":
            try:
                shared = read_key(Path(config.key_file)) if key is None else key
            except ValueError as error:
                raise LinkLost(str(error)) from None
            return await RemotePacer(config, thrust_max_n, thrust_curve, shared, nonce, hear).opened()

        super().__init__(_UNTIL_TOLD, open_pacer)


class RemotePacer(asyncio.DatagramProtocol):
    """Implements :class:`links.pacer_messages.Pacer`."""

    def __init__(
        self,
        config: BridgeLinkConfig,
        thrust_max_n: float,
        thrust_curve: float,
        key: bytes,
        nonce: Nonce,
        hear: Hear,
    ) -> None:
        """See :meth:`opened`."""
        self.manner = _UNTIL_TOLD
        self.dropped: Counter[str] = Counter()
        self._config = config
        self._thrust_max, self._curve = thrust_max_n, thrust_curve
        self._key = key
        self._random = nonce
        self._on_report = hear
        self._loop = asyncio.get_running_loop()
        self._wire: Datagrams | None = None
        self._beat: asyncio.TimerHandle | None = None
        self._ended: asyncio.Future[None] = self._loop.create_future()
        self._opened: asyncio.Future[None] = self._loop.create_future()
        self._refused = ""
        self._wants = Up(0.0, 0.0, 0.0)
        self._linger_s: float | None = None
        self._urgent = 0
        """Counter of the first datagram with the newest wish; 0 while none was sent with it."""
        self._heard = 0
        self._heard_s = -math.inf
        """When the bridge was heard last; -inf before there is a session."""
        self._ask()

    @property
    def why_mute(self) -> str:
        """What it means that no report comes."""
        if self._refused:
            return f"the bridge at {self._config.remote} refuses: {self._refused}"
        return f"the bridge at {self._config.remote} is not heard: it brings down and disarms by itself"

    def _ask(self) -> None:
        """A new hello; a session that there was goes on until it is answered."""
        self._nonce = self._random(NONCE_BYTES)
        self._hello = first_seal(self._key, HELLO, self._nonce)
        self._welcome = first_seal(self._key, WELCOME, self._nonce)

    async def opened(self) -> "RemotePacer":
        """Find the bridge, and hear from it that this station may command.

        Raises:
            LinkLost: it does not answer.
            LinkRejected: it obeys another station.
        """
        host, port = parse_address(self._config.remote)
        try:
            await self._loop.create_datagram_endpoint(lambda: self, remote_addr=(host, port))
        except OSError as error:
            raise LinkLost(f"cannot reach {self._config.remote}: {error.strerror or error}") from None
        try:
            self._turn()
            async with asyncio.timeout(self._config.connect_timeout_s):
                await asyncio.shield(self._opened)
        except BaseException as error:
            self.forget()
            if isinstance(error, TimeoutError):
                raise self._nobody() from None
            raise
        return self

    def _nobody(self) -> LinkLost | LinkRejected:
        if self._refused:
            return LinkRejected(self.why_mute)
        odd = {why: count for why, count in self.dropped.items() if why != "undeliverable"}
        hint = f"what came was dropped: {odd}" if odd else "is it running there, and with the same key?"
        return LinkLost(
            f"no answer from a bridge at {self._config.remote} within {self._config.connect_timeout_s:g} s: {hint}"
        )

    # ---- what the link wants

    def give(self, order: Order) -> bool:
        """Hand over ``order`` without waiting; False where the wire is closed."""
        if self._wire is None:
            return False
        match order:
            case Give(arming, command):
                if arming == self._wants.arming and not self._wants.stopped:
                    self._say(self._shares(command))
                return True
            case Arm(number, at_s):
                self._want(arming=number, arm_at_s=at_s, stopped=False)
            case Stop():
                self._want(stopped=True)
            case Serve(service, duration_s):
                number = self._wants.serve[0] + 1 if self._wants.serve is not None else 1
                self._want(serve=(number, service, duration_s))
            case End(linger_s):
                self._linger_s = linger_s
                self._want(end=True)
        return True

    def _want(self, **changes: Any) -> None:
        self._wants = msgspec.structs.replace(self._wants, **changes)
        self._urgent = 0
        self._turn()

    def _shares(self, command: Command) -> Command:
        replace, most, curve = msgspec.structs.replace, self._thrust_max, self._curve
        down = tuple(replace(part, thrust_n=signal(part.thrust_n / most, curve)) for part in command.bring_down)
        return replace(command, thrust_n=signal(command.thrust_n / most, curve), bring_down=down)

    async def ended(self) -> None:
        """Wait until the bridge has brought the vehicle down and disarm frames have left."""
        await asyncio.shield(self._ended)

    def forget(self) -> None:
        """Close the wire; the bridge's dead man's switch does the rest."""
        if self._beat is not None:
            self._beat.cancel()
        if self._wire is not None:
            self._wire.abort()
            self._wire = None
        self._end()

    # ---- the wire

    def connection_made(self, transport: Any) -> None:
        """Take the wire (called by the event loop)."""
        self._wire = Datagrams(transport)

    def _turn(self) -> None:
        """Say something now, and again after a while."""
        self._say(None)
        if self._is_mute() and self._wire is not None:
            self._wire.send(self._hello.close(Hello(self._nonce)), None)
        if self._beat is not None:
            self._beat.cancel()
        self._beat = self._loop.call_later(AGAIN_S if self._is_pressing() else BEAT_S, self._turn)

    def _is_mute(self) -> bool:
        return self._heard_s < self._loop.time() - MUTE_S

    def _is_pressing(self) -> bool:
        return not self._has_session or self._urgent > self._heard

    @property
    def _has_session(self) -> bool:
        return self._heard_s > -math.inf

    def _say(self, command: Command | None) -> None:
        if self._wire is None or not self._has_session:
            return
        now = self._loop.time()
        self._wants = msgspec.structs.replace(
            self._wants, sent_s=now, heard_s=self._heard_s, bridge_s=self._bridge_s, command=command
        )
        why = self._wire.send(self._up.close(self._wants), None)
        if why:
            self.dropped[why] += 1
        self._sent_s[self._up.counter] = now
        self._sent_s.pop(self._up.counter - REMEMBERED, None)
        self._urgent = self._urgent or self._up.counter

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there, says the network (called by the event loop)."""
        self.dropped["undeliverable"] += 1

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        now = self._loop.time()
        if kind_of(data) == WELCOME:
            welcome = self._welcome.open(data, WELCOMES, self.dropped)
            if welcome is not None and welcome.station_nonce == self._nonce and self._is_mute():
                self._begin(welcome, now)
        elif not self._has_session:
            self.dropped["other_session"] += 1
        else:
            down = self._down.open(data, DOWNS, self.dropped)
            if down is not None:
                self._take(down, now)

    def _begin(self, welcome: Welcome, now_s: float) -> None:
        self._up, self._down = session_seals(self._key, self._nonce, welcome.bridge_nonce)
        self.manner = welcome.manner
        self._clock = ClockBounds()
        self._sent_s: dict[int, float] = {}
        self._heard = self._urgent = 0
        self._heard_s, self._bridge_s = now_s, welcome.bridge_s
        self._ask()  # should this session ever be lost
        self._turn()

    def _take(self, down: Down, now_s: float) -> None:
        self._heard_s, self._bridge_s = now_s, down.bridge_s
        self._heard = max(self._heard, down.heard)
        self._refused = down.refused
        sent_s = self._sent_s.get(down.heard)
        if sent_s is not None:
            self._clock.narrow(sent_s - down.bridge_s, now_s - down.bridge_s, now_s)
        if down.refused or not math.isfinite(self._clock.width_s):
            return
        self._on_report(self._ours(down.report))
        if not self._opened.done():
            self._opened.set_result(None)
        heard_all = 0 < self._urgent <= self._heard
        if self._linger_s is not None and heard_all and down.report.over:
            self._loop.call_later(self._linger_s, self._end)
            self._linger_s = None

    def _end(self) -> None:
        if not self._ended.done():
            self._ended.set_result(None)

    def _ours(self, report: Report) -> Report:
        """``report`` by this machine's clock."""
        shift, round_trip_ms = self._clock.middle_s, 1e3 * self._clock.width_s
        return msgspec.structs.replace(
            report,
            now_s=report.now_s + shift,
            frame_s=report.frame_s + shift,
            port=f"on the bridge: {report.port}" if report.port else "",
            dropped={**report.dropped, **self.dropped},
            note=f"{report.note}; bridge answers in {round_trip_ms:.1f} ms",
        )


_UNTIL_TOLD = Manner(
    period_s=0.0225, lead_s=0.005, arm_low_s=0.5, arm_high_s=1.0, disarm_s=0.5, services=frozenset[Service]()
)
