"""Link to an RF bridge: the pacer and the module are on another computer, as in the paper's set-up.

To the link it is a pacer like any other (links/rf/link.py). Every datagram holds all that the link
wants: it leaves as soon as a command comes, and is repeated until the bridge has acknowledged the
newest order. The bridge has the dead man's switch; nothing here can make an old command count.
"""

import asyncio
import math
import os
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import msgspec

from links.bridge.codec import (
    NONCE_BYTES,
    WELCOMES,
    BridgeHello,
    DatagramKind,
    Down,
    Nonce,
    StationEnd,
    Up,
    Welcome,
    first_seal,
    kind_of,
)
from links.core import Command, LinkKind, LinkLost, LinkRejected, signal
from links.io import NETWORK, Datagrams, parse_address, read_key, remote_setting
from links.rf import (
    Arm,
    DsmLinkConfig,
    End,
    Give,
    Hear,
    Order,
    PacedLink,
    PacerReport,
    Serve,
    Service,
    Stop,
)
from links.text import link_notice

BEAT_S = 0.1
"""Longest time between two datagrams [s]: several of them within ``MUTE_S``."""
AGAIN_S = 0.02
"""Interval between repetitions of an unacknowledged order [s]."""
MUTE_S = 0.8
"""Silence of the bridge after which a new session is requested [s]: it may have restarted."""

DEFAULT_MANNER = msgspec.structs.replace(DsmLinkConfig().manner, services=frozenset[Service]())
"""Pacing that is assumed until the bridge reports its own: a default module's, without services."""


class SessionRequest:
    """One request for a session: its nonce, and the seals of the hello and of the answer."""

    def __init__(self, key: bytes, nonce: bytes) -> None:
        self.nonce = nonce
        self.hello = first_seal(key, DatagramKind.HELLO, nonce)
        self.welcome = first_seal(key, DatagramKind.WELCOME, nonce)


class RemotePacer(asyncio.DatagramProtocol):
    """Implements :class:`links.rf.pacer.Pacer`."""

    def __init__(
        self,
        remote: str,
        thrust_max_n: float,
        thrust_curve: float,
        key: bytes,
        nonce: Nonce,
        hear: Hear,
    ) -> None:
        """Nothing is opened yet; ``remote`` is the bridge's address, and ``key`` is shared with it.

        ``thrust_max_n`` is the thrust at full throttle [N], ``thrust_curve`` the vehicle's
        (links/core/deadman.py); ``nonce`` draws random bytes, and ``hear`` takes the reports.
        """
        self.manner = DEFAULT_MANNER
        """Pacing of the bridge's module."""
        self.dropped: Counter[str] = Counter()
        self._remote = remote
        self._thrust_max, self._curve = thrust_max_n, thrust_curve
        self._key = key
        self._draw_nonce = nonce
        self._on_report = hear
        self._loop = asyncio.get_running_loop()
        self._wire: Datagrams | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._ended: asyncio.Future[None] = self._loop.create_future()
        self._opened: asyncio.Future[None] = self._loop.create_future()
        self._refused = ""
        self._wants = Up(0.0, 0.0, 0.0)
        self._linger_s: float | None = None
        """Time after the bring-down until the end [s]; None until the end is ordered, and once it
        is near."""
        self._ordered = 0
        """Counter of the first datagram with the newest order; 0 while none has left with it."""
        self._session: StationEnd | None = None
        self._request = self._make_request()

    @property
    def why_mute(self) -> str:
        """Cause of missing reports, for the operator."""
        if self._refused:
            return link_notice("bridge.refuses", address=self._remote, why=self._refused).text
        return link_notice("bridge.unheard", address=self._remote).text

    def _make_request(self) -> SessionRequest:
        """Return a new request; the session so far goes on until it is answered."""
        return SessionRequest(self._key, self._draw_nonce(NONCE_BYTES))

    async def open(self, within_s: float) -> None:
        """Begin a session in which this station may command, ``within_s`` [s].

        Raises:
            LinkLost: it does not answer.
            LinkRejected: it follows another station.
        """
        host, port = parse_address(self._remote)
        try:
            await NETWORK.get().open_datagram(lambda: self, remote=(host, port))
        except OSError as error:
            raise LinkLost(
                link_notice("bridge.unreachable", address=self._remote, why=error.strerror or error)
            ) from None
        try:
            self._send_and_schedule()
            async with asyncio.timeout(within_s):
                await asyncio.shield(self._opened)
        except BaseException as error:
            self.forget()
            if isinstance(error, TimeoutError):
                raise self._explain_silence(within_s) from None
            raise

    def _explain_silence(self, within_s: float) -> LinkLost | LinkRejected:
        """Return why no session began ``within_s`` [s]."""
        if self._refused:
            return LinkRejected(self.why_mute)
        odd = {why: count for why, count in self.dropped.items() if why != "undeliverable"}
        id = "bridge.dropped" if odd else "bridge.silent"
        return LinkLost(link_notice(id, address=self._remote, limit_s=within_s, dropped=odd))

    # ---- orders of the link

    def give(self, order: Order) -> bool:
        """Hand over ``order`` without waiting; False where the wire is closed."""
        if self._wire is None:
            return False
        match order:
            case Give(arming, command):
                if arming == self._wants.arming and not self._wants.stopped:
                    self._send(self._scale_thrust(command))
                return True
            case Arm(number, at_s):
                self._order(arming=number, arm_at_s=at_s, stopped=False)
            case Stop():
                self._order(stopped=True)
            case Serve(service, duration_s):
                number = self._wants.serve[0] + 1 if self._wants.serve is not None else 1
                self._order(serve=(number, service, duration_s))
            case End(linger_s):
                self._linger_s = linger_s
                self._order(end=True)
        return True

    def _order(self, **changes: Any) -> None:
        """Change the wanted state, and send it until it is acknowledged."""
        self._wants = msgspec.structs.replace(self._wants, **changes)
        self._ordered = 0
        self._send_and_schedule()

    def _scale_thrust(self, command: Command) -> Command:
        """Return ``command`` with thrusts as shares of the full signal [-], which the bridge
        takes.
        """
        replace, most, curve = msgspec.structs.replace, self._thrust_max, self._curve
        down = tuple(
            replace(part, thrust_n=signal(part.thrust_n / most, curve))
            for part in command.bring_down
        )
        return replace(command, thrust_n=signal(command.thrust_n / most, curve), bring_down=down)

    async def wait_for_end(self) -> None:
        """Wait until the bridge has brought the vehicle down and disarm frames have left."""
        await asyncio.shield(self._ended)

    def forget(self) -> None:
        """Close the wire; the bridge's dead man's switch does the rest."""
        if self._timer is not None:
            self._timer.cancel()
        if self._wire is not None:
            self._wire.abort()
            self._wire = None
        self._end()

    # ---- the wire

    def connection_made(self, transport: Any) -> None:
        """Take the wire (called by the event loop)."""
        self._wire = Datagrams(transport)

    def _send_and_schedule(self) -> None:
        """Send the wanted state now, and schedule the next time."""
        self._send(None)
        if self._is_mute() and self._wire is not None:
            self._wire.send(self._request.hello.close(BridgeHello(self._request.nonce)), None)
        if self._timer is not None:
            self._timer.cancel()
        is_unheard = self._session is None or self._ordered > self._session.heard
        self._timer = self._loop.call_later(
            AGAIN_S if is_unheard else BEAT_S, self._send_and_schedule
        )

    def _is_mute(self) -> bool:
        """Whether there is no session, or its bridge is silent."""
        return self._session is None or self._session.heard_s < self._loop.time() - MUTE_S

    def _send(self, command: Command | None) -> None:
        """Send the wanted state, with ``command`` if there is one."""
        if self._wire is None or self._session is None:
            return
        why = self._wire.send(self._session.close(self._wants, command, self._loop.time()), None)
        if why:
            self.dropped[why] += 1
        self._ordered = self._ordered or self._session.sent

    def error_received(self, exc: Exception) -> None:
        """Count a datagram that nobody took (called by the event loop)."""
        self.dropped["undeliverable"] += 1

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        now = self._loop.time()
        if kind_of(data) == DatagramKind.WELCOME:
            welcome = self._request.welcome.open(data, WELCOMES, self.dropped)
            if (
                welcome is not None
                and welcome.station_nonce == self._request.nonce
                and self._is_mute()
            ):
                self._begin_session(welcome, now)
        elif self._session is None:
            self.dropped["other_session"] += 1
        else:
            down = self._session.open(data, self.dropped, now)
            if down is not None:
                self._take_answer(down, self._session)

    def _begin_session(self, welcome: Welcome, now_s: float) -> None:
        """Begin the session that ``welcome`` offers."""
        self._session = StationEnd(self._key, welcome, now_s)
        self.manner = welcome.manner
        self._ordered = 0
        self._request = self._make_request()  # for the next session, should this one be lost
        self._send_and_schedule()

    def _take_answer(self, down: Down, session: StationEnd) -> None:
        """Report what the bridge answers, and end where the vehicle is down after the last
        order.
        """
        self._refused = down.refused
        if down.refused or not math.isfinite(session.round_trip_s):
            return
        self._on_report(self._translate_report(session.ours(down.report), session))
        if not self._opened.done():
            self._opened.set_result(None)
        heard_all = 0 < self._ordered <= session.heard
        if self._linger_s is not None and heard_all and down.report.over:
            self._loop.call_later(self._linger_s, self._end)
            self._linger_s = None

    def _end(self) -> None:
        if not self._ended.done():
            self._ended.set_result(None)

    def _translate_report(self, report: PacerReport, session: StationEnd) -> PacerReport:
        """Return ``report`` with sentences that name the bridge."""
        return msgspec.structs.replace(
            report,
            port=_name_bridge(report.port),
            heir=_name_bridge(report.heir),
            warning=_name_bridge(report.warning),
            dropped={**report.dropped, **self.dropped},
            note=f"{report.note}; bridge answers in {1e3 * session.round_trip_s:.1f} ms",
        )


def _name_bridge(says: str) -> str:
    """Return the sentence ``says``, which is about the bridge's computer; empty stays empty."""
    return link_notice("bridge.there", says=says).text if says else ""


class BridgeLinkConfig(LinkKind, frozen=True, kw_only=True, tag="rf_bridge"):
    """`groundstation radio bridge` on another computer: that one has the module, and knows port,
    codec and channels.
    """

    remote: Annotated[str, msgspec.Meta(description="Its address.")] = "127.0.0.1:14600"
    key_file: Annotated[
        str,
        msgspec.Meta(
            description="File with the key that both computers share, mode 0600; `groundstation "
            "config key FILE` writes one."
        ),
    ] = "bridge.key"
    connect_timeout_s: Annotated[
        float, msgspec.Meta(ge=0.01, le=60.0, description="How long to wait for the bridge [s].")
    ] = 5.0

    def __post_init__(self) -> None:
        parse_address(self.remote, "remote")

    @property
    def address_key(self) -> str:
        """Key with the bridge's address."""
        return "remote"

    @property
    def key_files(self) -> dict[str, str]:
        """File of the key that both computers share."""
        return {"key_file": self.key_file}

    @property
    def real(self) -> str | None:
        """The setting that may lead to a real vehicle; None where all stays on this machine.

        A bridge with a real module takes no station of its own machine (links/bridge/server.py).
        """
        return remote_setting("remote", self.remote)

    @property
    def thrust_curve(self) -> None:
        """None: the vehicle's is used."""
        return None


class BridgeLink(PacedLink):
    """Implements :class:`links.core.deadman.CommandLink` (see there)."""

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

        ``thrust_curve`` is the vehicle's (links/core/deadman.py); the bridge's own is applied on
        top. A simulation gives its own ``key`` instead of the file's, and its own random ``nonce``.
        """

        async def open_pacer(hear: Hear) -> RemotePacer:
            try:
                shared = read_key(Path(config.key_file)) if key is None else key
            except ValueError as error:
                raise LinkLost(link_notice("bridge.key", why=error)) from None
            pacer = RemotePacer(config.remote, thrust_max_n, thrust_curve, shared, nonce, hear)
            await pacer.open(config.connect_timeout_s)
            return pacer

        super().__init__(DEFAULT_MANNER, open_pacer)
