"""RF bridge: paces the commands of a station on another computer, as the paper did. `groundstation radio bridge`.

Whoever holds the key may command, one station at a time. Its times are brought to this machine's clock so that no
deadline can come out later than it was meant: by the earliest instant that the messages so far allow. The pacer with
its dead man's switch is the one that a link on this machine has (links/rf/pacer.py), started again whenever it ends;
disarm frames leave whether there is a station or not.
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
    Up,
    Welcome,
    first_seal,
    kind_of,
    name_of,
)
from links.core import Command, LinkError
from links.io import Datagrams, is_loopback, parse_address
from links.rf import (
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
    open_process,
)
from links.text import link_notice

AGAIN_S = 1.0
"""Wait before a pacer that ended within this time, or could not be started, is started again [s]."""


class KeptPacer:
    """``run`` it."""

    def __init__(
        self,
        config: RfLinkConfig,
        open_pacer: OpenPacer,
        say: Callable[[str], None],
        heard: Callable[[bool], None],
    ) -> None:
        """Nothing is opened yet; ``say`` takes lines for the operator.

        ``heard`` is called with False after each report, and with True when the pacer has ended.
        """
        self.report: PacerReport | None = None
        """The newest, or what is true of a pacer that ended; None before the first."""
        self._config = config
        self._open_pacer = open_pacer
        self._say, self._heard = say, heard
        self._pacer: Pacer | None = None
        self._ends = False
        self._relieved = False
        """Whether a pacer that no stand-by follows has been told to end."""
        self._disarmed = True
        """Whether that is what the operator was told last."""
        self._quiet: PacerReport | None = None
        """The first report after which nothing that lifts has left; None where something has."""

    async def run(self) -> None:
        """Pace until cancelled; then what flies is brought down before this returns."""
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            await self._pace()
            if loop.time() < began + AGAIN_S:
                await asyncio.sleep(AGAIN_S)

    def give(self, order: Order) -> None:
        """Hand over ``order``, where there is a pacer."""
        if self._pacer is not None:
            self._pacer.give(order)

    async def _pace(self) -> None:
        self._quiet, self._relieved = None, False
        try:
            pacer = self._pacer = await self._open_pacer(self._config, 1.0, self._hear)
        except LinkError as error:
            self._say(str(error))
            return
        try:
            await pacer.wait_for_end()
            self._say(link_notice("bridge.restarts").text)
        except asyncio.CancelledError:
            self._ends = True
            pacer.give(End(self._config.disarm_s))
            await pacer.wait_for_end()
            raise
        finally:
            self._pacer = None
            pacer.forget()

    def _hear(self, report: PacerReport | None) -> None:
        """Take the pacer's report; None means that it ended."""
        before, ended = self.report, report is None
        if self._ends and ended:
            return
        if report is not None:
            self._tell(report, before)
            lone = report.heir or (report.alone and report.over)
            if lone and self._pacer is not None and not self._relieved:
                self._relieved = True
                self._pacer.give(End(self._config.disarm_s))  # once all is down, a pacer with a stand-by follows
        elif before is not None:  # what flew then may still do so: nobody sends it anything until there is another
            report = msgspec.structs.replace(before, port=link_notice("bridge.pacer_ended").text)
        self.report = report
        self._heard(ended)

    def _tell(self, report: PacerReport, before: PacerReport | None) -> None:
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
            left = report.frames - self._quiet.frames + 1  # one had left before the first such report
            if left * self._config.period_s >= self._config.disarm_s:
                self._say(link_notice("bridge.disarmed").text)
                self._disarmed = True


SILENT_S = 1.0
"""A station that says nothing for so long has left [s]: another may command, once the vehicle is down."""
SESSIONS = 8
"""Most sessions remembered; who asks for more pushes out the oldest that does not command."""

Nonce = Callable[[int], bytes]


class BridgeConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the bridge listens, and the module that it has."""

    listen: Annotated[
        str,
        msgspec.Meta(
            description="Our address for stations, such as `192.168.1.20:14600`; `0.0.0.0:14600` "
            "hears on every network."
        ),
    ]
    key_file: Annotated[str, msgspec.Meta(description="File with the key that both computers share, mode 0600.")] = (
        "bridge.key"
    )
    link: RfConfig = DsmLinkConfig()

    def __post_init__(self) -> None:
        parse_address(self.listen, "listen")


class Bridge(asyncio.DatagramProtocol):
    """``run`` it. Times are on the event loop's clock [s]."""

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

        With ``remote_only`` stations on this machine are not heard: on loopback they take vehicles for simulated ones.
        """
        self.dropped: Counter[str] = Counter()
        """Datagrams dropped, by reason."""
        self._config = config
        self._key = key
        self._say = say
        self._random = nonce
        self._remote_only = remote_only
        self._pacer = KeptPacer(config.link, open_pacer, say, self._take_report)
        self._arming = 0
        self._sessions: dict[bytes, BridgeEnd] = {}
        """Sessions by the station's nonce, oldest first."""
        self._live: BridgeEnd | None = None
        self._wire: Datagrams | None = None

    async def run(self) -> None:
        """Pace and listen until cancelled; then what flies is brought down before this returns.

        Raises:
            LinkError: the address can't be opened.
        """
        loop = asyncio.get_running_loop()
        try:
            await loop.create_datagram_endpoint(lambda: self, local_addr=parse_address(self._config.listen))
        except OSError as error:
            raise LinkError(
                link_notice("bridge.listen", address=self._config.listen, why=error.strerror or error)
            ) from None
        try:
            await self._pacer.run()
        finally:
            if self._wire is not None:
                self._wire.abort()

    def kill(self) -> None:
        """Motors off, by the operator of this machine: disarm frames from the next one on, until a new arming."""
        self._pacer.give(Stop())
        if self._live is not None:
            self._live.arming = None

    def _take_report(self, ended: bool) -> None:
        """The pacer has reported, or ended."""
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
            self._up(data, addr, now)
        elif kind == DatagramKind.HELLO:
            self._hello(data, addr, now)
        else:
            self.dropped["not_ours"] += 1

    def _refuse_local(self, addr: Any) -> None:
        if not self.dropped["from_this_machine"]:
            self._say(link_notice("bridge.local_station", address=addr[0], kind=self._config.link.kind).text)
        self.dropped["from_this_machine"] += 1

    def _hello(self, data: bytes, addr: Any, now_s: float) -> None:
        seal = first_seal(self._key, DatagramKind.HELLO, name_of(data))
        hello = seal.open(data, HELLOS, self.dropped)
        if hello is None or self._pacer.report is None:
            return
        if len(hello.nonce) != NONCE_BYTES or hello.nonce[:8] != name_of(data):
            self.dropped["malformed"] += 1
            return
        session = self._sessions.get(hello.nonce)
        if session is None:
            spare = [nonce for nonce, each in self._sessions.items() if each is not self._live]
            if len(self._sessions) >= SESSIONS:
                del self._sessions[spare[0]]
            session = self._sessions[hello.nonce] = BridgeEnd(self._key, hello.nonce, self._random(NONCE_BYTES))
        welcome = Welcome(hello.nonce, session.bridge_nonce, now_s, self._config.link.manner, self._pacer.report)
        if self._wire is not None:
            self._wire.send(session.welcome.close(welcome), addr)

    def _up(self, data: bytes, addr: Any, now_s: float) -> None:
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
        session.peer = addr
        if session is not self._live and not self._may_command(session, now_s):
            session.heard_s = now_s
            self._answer(session)
            return
        session.heard_s = now_s
        news = self._obey(session, up, now_s)
        if news or up.command is None:
            self._answer(session)

    def _may_command(self, session: BridgeEnd, now_s: float) -> bool:
        """Whether this station takes over."""
        live = self._live
        if session.ended or self._pacer.report is None or not self._pacer.report.over:
            return False
        if live is not None and not live.ended and now_s < live.heard_s + SILENT_S:
            return False
        self._live = session
        self._say(link_notice("bridge.commands", host=session.peer[0], port=session.peer[1]).text)
        return True

    def _obey(self, session: BridgeEnd, up: Up, now_s: float) -> bool:
        """Pass on what is new; returns whether there was more than a command."""
        before, session.wants = session.wants, msgspec.structs.replace(up, command=None)
        to_ours = session.clock.least_s
        news = False
        # What a station wanted before this session began is over: it has to ask anew.
        if before is not None and up.arming != before.arming and not up.stopped:
            news = True
            self._arming += 1
            session.arming = self._arming
            self._pacer.give(Arm(self._arming, up.arm_at_s + to_ours))
        if up.stopped and (before is None or not before.stopped):
            news = True
            session.arming = None
            self._pacer.give(Stop())
        if before is not None and up.serve is not None and up.serve != before.serve:
            news = True
            self._pacer.give(Serve(up.serve[1], up.serve[2]))
        if up.end and not session.ended:
            news = session.ended = True
            self._say(link_notice("bridge.leaves", host=session.peer[0], port=session.peer[1]).text)
        if up.command is not None and session.arming is not None and not up.end:
            self._pacer.give(Give(session.arming, _shift_deadline(up.command, to_ours)))
        return news

    def _answer(self, session: BridgeEnd) -> None:
        report = self._pacer.report
        if report is None or self._wire is None:
            return
        now = asyncio.get_running_loop().time()
        refused = "" if session is self._live else link_notice("bridge.busy").text
        theirs = 0
        if session.wants is not None and session.arming in (None, report.arming):
            theirs = session.wants.arming  # what it says of this one is true; or this one is over in any case
        down = Down(now, session.up.counter, refused, msgspec.structs.replace(report, arming=theirs))
        why = self._wire.send(session.down.close(down), session.peer)
        if why:
            self.dropped[why] += 1


def _shift_deadline(command: Command, by_s: float) -> Command:
    """``command`` with its deadline on this clock. Its pose's time stays the station's: only its order counts here."""
    return msgspec.structs.replace(command, deadline_s=command.deadline_s + by_s)
