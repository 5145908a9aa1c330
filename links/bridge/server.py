"""RF bridge: paces the commands of a station on another computer, as the paper did.

`groundstation radio bridge`.

Every station that has the key may command, one at a time. The bridge converts the station's times
to its own clock by the earliest instant that the messages so far allow (links/bridge/codec.py,
``ClockBounds``), so that no deadline comes out later than the station meant. The bridge uses the
same pacer, with the same dead man's switch, as a link on this machine (links/rf/pacer.py), and
starts it again whenever it ends. Disarm frames leave without a station, too.
"""

import asyncio
import os
from collections import Counter
from collections.abc import Callable
from typing import Annotated, Any

import msgspec

from links.bridge.codec import (
    HELLOS,
    NONCE_BYTES,
    UPS,
    BridgeEnd,
    DatagramKind,
    Down,
    Nonce,
    Up,
    Welcome,
    first_seal,
    kind_of,
    name_of,
)
from links.core import REOPEN_S, Command, LinkError
from links.io import Datagrams, is_loopback, parse_address
from links.rf import (
    SILENT_S,
    Arm,
    DsmLinkConfig,
    End,
    Give,
    OpenPacer,
    Order,
    Pacer,
    PacerReport,
    RfConfig,
    RfLinkConfig,
    Serve,
    Stop,
    end_pacer,
    open_process,
)
from links.text import link_notice


class KeptPacer:
    """A pacer that is started again whenever it ends. :meth:`run` does it."""

    def __init__(
        self,
        config: RfLinkConfig,
        open_pacer: OpenPacer,
        say: Callable[[str], None],
        on_report: Callable[[bool], None],
    ) -> None:
        """Open nothing yet.

        Args:
            config: the module's.
            open_pacer: starts a pacer.
            say: takes lines for the operator.
            on_report: called with False after each report, and with True when the pacer has ended.
        """
        self.report: PacerReport | None = None
        """Newest report, after the pacer's end with the reason in ``port``; None before any."""
        self._config = config
        self._open_pacer = open_pacer
        self._say, self._on_report = say, on_report
        self._pacer: Pacer | None = None
        self._ends = False
        """Whether the bridge is ending."""
        self._relieved = False
        """Whether this pacer was told to end because its partner (pacer or stand-by) is gone."""
        self._disarmed = True
        """Whether the operator's newest line says that the vehicle is disarmed."""
        self._quiet: PacerReport | None = None
        """First report since which only disarm frames have left; None while other frames leave."""

    async def run(self) -> None:
        """Pace until cancelled; a flying vehicle is brought down before this returns."""
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            await self._pace()
            if loop.time() < began + REOPEN_S:
                await asyncio.sleep(REOPEN_S)

    def give(self, order: Order) -> None:
        """Hand ``order`` to the pacer; without a pacer it is dropped."""
        if self._pacer is not None:
            self._pacer.give(order)

    async def _pace(self) -> None:
        """Start a pacer and wait for its end."""
        self._quiet, self._relieved = None, False
        try:
            # Stations send thrusts as shares of the full signal (links/bridge/codec.py, ``Up``).
            pacer = self._pacer = await self._open_pacer(self._config, 1.0, self._take_report)
        except LinkError as error:
            self._say(str(error))
            return
        try:
            await pacer.wait_for_end()
            self._say(link_notice("bridge.restarts").text)
        except asyncio.CancelledError:
            self._ends = True
            await end_pacer(pacer, self._config.disarm_s)
            raise
        finally:
            self._pacer = None
            pacer.forget()

    def _take_report(self, report: PacerReport | None) -> None:
        """Take the pacer's report; None means that it ended."""
        before, ended = self.report, report is None
        if self._ends and ended:
            return
        if report is not None:
            self._report_changes(report, before)
            # The stand-by paces alone, or the pacer has lost its stand-by and no vehicle flies:
            # make place for a pair.
            is_lone = report.heir or (report.alone and report.over)
            if is_lone and self._pacer is not None and not self._relieved:
                self._relieved = True
                self._pacer.give(End(self._config.disarm_s))
        # A vehicle may still fly, and gets no frames until the next pacer: keep ``over``.
        elif before is not None:
            report = msgspec.structs.replace(before, port=link_notice("bridge.pacer_ended").text)
        self.report = report
        self._on_report(ended)

    def _report_changes(self, report: PacerReport, before: PacerReport | None) -> None:
        """Report each change from the report ``before`` to the operator."""
        if report.port and (before is None or before.port != report.port):
            self._say(report.port)
        if before is not None and before.port and not report.port:
            self._say(link_notice("bridge.port_back").text)
        if report.heir and not (before is not None and before.heir):
            self._say(report.heir)
        if report.alone and not (before is not None and before.alone):
            self._say(f"warning: {report.warning}")
        if not report.over:
            if self._disarmed:
                self._say(link_notice("bridge.armed").text)
            self._disarmed, self._quiet = False, None
        elif report.port:
            self._quiet = None
        elif self._quiet is None:
            self._quiet = report
        elif not self._disarmed:
            # One had left before the first such report.
            disarm_frames = report.frames - self._quiet.frames + 1
            if disarm_frames * self._config.period_s >= self._config.disarm_s:
                self._say(link_notice("bridge.disarmed").text)
                self._disarmed = True


SESSIONS = 8
"""Limit of the remembered sessions [-]: a further one replaces the oldest that does not command.
Chosen."""


class BridgeConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The bridge's address, its key and its module."""

    listen: Annotated[
        str,
        msgspec.Meta(
            description="Our address for stations, such as `192.168.1.20:14600`; `0.0.0.0:14600` "
            "hears on every network."
        ),
    ]
    key_file: Annotated[
        str, msgspec.Meta(description="File with the key that both computers share, mode 0600.")
    ] = "bridge.key"
    link: RfConfig = DsmLinkConfig()

    def __post_init__(self) -> None:
        parse_address(self.listen, "listen")


class Bridge(asyncio.DatagramProtocol):
    """The bridge: a pacer, and the stations that may command it.

    Times are on the event loop's clock [s].
    """

    def __init__(
        self,
        config: BridgeConfig,
        key: bytes,
        *,
        say: Callable[[str], None] = lambda line: None,
        open_pacer: OpenPacer = open_process,
        nonce: Nonce = os.urandom,
        remote_only: bool = False,
    ) -> None:
        """``say`` takes lines for the operator; ``open_pacer`` and ``nonce`` are for simulations.

        With ``remote_only`` stations on this machine are ignored: over loopback a station takes its
        vehicle for a simulated one.
        """
        self.dropped: Counter[str] = Counter()
        """Datagrams dropped, by reason."""
        self._config = config
        self._key = key
        self._say = say
        self._draw_nonce = nonce
        self._remote_only = remote_only
        self._pacer = KeptPacer(config.link, open_pacer, say, self._take_report)
        self._arming = 0
        """Number of the newest arming, as the pacer counts: over all stations."""
        self._sessions: dict[bytes, BridgeEnd] = {}
        """Sessions by the station's nonce, oldest first."""
        self._live: BridgeEnd | None = None
        """Session of the station that commands, or commanded last."""
        self._wire: Datagrams | None = None
        """The open socket."""

    async def run(self) -> None:
        """Pace and listen until cancelled; a flying vehicle is brought down before this returns.

        Raises:
            LinkError: the address can't be opened.
        """
        loop = asyncio.get_running_loop()
        try:
            await loop.create_datagram_endpoint(
                lambda: self, local_addr=parse_address(self._config.listen)
            )
        except OSError as error:
            raise LinkError(
                link_notice(
                    "bridge.listen", address=self._config.listen, why=error.strerror or error
                )
            ) from None
        try:
            await self._pacer.run()
        finally:
            if self._wire is not None:
                self._wire.abort()

    def kill(self) -> None:
        """Stop the motors, by this machine's operator: disarm frames leave until a new arming."""
        self._pacer.give(Stop())
        if self._live is not None:
            self._live.arming = None

    def _take_report(self, ended: bool) -> None:
        """Pass the pacer's new report, or its end, to the station that commands."""
        if self._live is not None:
            if ended:
                self._live.arming = None
            self._answer(self._live)

    # ---- stations

    def connection_made(self, transport: Any) -> None:
        """Take the wire (called by the event loop)."""
        self._wire = Datagrams(transport)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        now = asyncio.get_running_loop().time()
        kind = kind_of(data)
        if self._remote_only and is_loopback(addr[0]):
            self._refuse_local(addr)
        elif kind == DatagramKind.UP:
            self._take_up(data, addr, now)
        elif kind == DatagramKind.HELLO:
            self._take_hello(data, addr, now)
        else:
            self.dropped["not_ours"] += 1

    def _refuse_local(self, addr: Any) -> None:
        """Count a datagram of this machine; report the first one to the operator."""
        if not self.dropped["from_this_machine"]:
            self._say(
                link_notice(
                    "bridge.local_station", address=addr[0], kind=self._config.link.kind
                ).text
            )
        self.dropped["from_this_machine"] += 1

    def _take_hello(self, data: bytes, addr: Any, now_s: float) -> None:
        """Offer a session to the station at ``addr``."""
        seal = first_seal(self._key, DatagramKind.HELLO, name_of(data))
        hello = seal.open(data, HELLOS, self.dropped)
        if hello is None or self._pacer.report is None:
            return
        if len(hello.nonce) != NONCE_BYTES or not hello.nonce.startswith(name_of(data)):
            self.dropped["malformed"] += 1
            return
        session = self._sessions.get(hello.nonce)
        if session is None:
            if len(self._sessions) >= SESSIONS:
                del self._sessions[
                    next(nonce for nonce, each in self._sessions.items() if each is not self._live)
                ]
            session = self._sessions[hello.nonce] = BridgeEnd(
                self._key, hello.nonce, self._draw_nonce(NONCE_BYTES)
            )
        welcome = Welcome(
            hello.nonce, session.bridge_nonce, now_s, self._config.link.manner, self._pacer.report
        )
        if self._wire is not None:
            self._wire.send(session.welcome.close(welcome), addr)

    def _take_up(self, data: bytes, addr: Any, now_s: float) -> None:
        """Take the wanted state of the station at ``addr``, if it may command; answer it."""
        name = name_of(data)
        session = next((each for each in self._sessions.values() if each.up.name == name), None)
        if session is None:
            self.dropped["other_session"] += 1
            return
        up = session.up.open(data, UPS, self.dropped)
        if up is None:
            return
        if not session.clock.narrow(up.bridge_s - up.heard_s, now_s - up.sent_s, now_s):
            self.dropped["clock_jumped"] += 1
        session.peer, session.heard_s = addr, now_s
        if session is not self._live and not self._take_over(session, now_s):
            self._answer(session)
            return
        has_news = self._pass_requests(session, up)
        if has_news or up.command is None:
            self._answer(session)

    def _take_over(self, session: BridgeEnd, now_s: float) -> bool:
        """Let this station command, if no vehicle flies and no other station commands.

        One that is silent for ``SILENT_S`` counts as gone.

        Return whether this one commands.
        """
        live = self._live
        if session.ended or self._pacer.report is None or not self._pacer.report.over:
            return False
        if live is not None and not live.ended and now_s < live.heard_s + SILENT_S:
            return False
        self._live = session
        self._say(link_notice("bridge.commands", host=session.peer[0], port=session.peer[1]).text)
        return True

    def _pass_requests(self, session: BridgeEnd, up: Up) -> bool:
        """Pass the station's new requests to the pacer.

        Return whether there was more than a command.
        """
        before, session.wants = session.wants, msgspec.structs.replace(up, command=None)
        to_ours = session.clock.least_s
        has_news = False
        # The first ``Up`` of a session may repeat an old arming or service: only a later change
        # counts.
        if before is not None and up.arming != before.arming and not up.stopped:
            has_news = True
            self._arming += 1
            session.arming = self._arming
            self._pacer.give(Arm(self._arming, up.arm_at_s + to_ours))
        if up.stopped and (before is None or not before.stopped):
            has_news = True
            session.arming = None
            self._pacer.give(Stop())
        if before is not None and up.serve is not None and up.serve != before.serve:
            has_news = True
            _, service, lasts_s = up.serve
            self._pacer.give(Serve(service, lasts_s))
        if up.end and not session.ended:
            has_news = session.ended = True
            self._say(link_notice("bridge.leaves", host=session.peer[0], port=session.peer[1]).text)
        if up.command is not None and session.arming is not None and not up.end:
            self._pacer.give(Give(session.arming, _shift_deadline(up.command, to_ours)))
        return has_news

    def _answer(self, session: BridgeEnd) -> None:
        """Send the newest report to the station."""
        report = self._pacer.report
        if report is None or self._wire is None:
            return
        now = asyncio.get_running_loop().time()
        refused = "" if session is self._live else link_notice("bridge.busy").text
        # The station's number of the arming that the report is about; 0 while the pacer does not
        # know it yet. A station that is not armed gets its own number, too: its newest arming is
        # over, as the report says.
        arming = 0
        if session.wants is not None and session.arming in (None, report.arming):
            arming = session.wants.arming
        down = Down(
            now, session.up.counter, refused, msgspec.structs.replace(report, arming=arming)
        )
        why = self._wire.send(session.down.close(down), session.peer)
        if why:
            self.dropped[why] += 1


def _shift_deadline(command: Command, by_s: float) -> Command:
    """Convert the deadline of ``command`` to this clock.

    Its pose's time stays the station's: only its order counts.
    """
    return msgspec.structs.replace(command, deadline_s=command.deadline_s + by_s)
