"""RF link: thrust and rates as channels of a transmitter, in frames that a pacer lets go.

Frames leave all the time, whatever this process does: disarm frames until the operator arms, then
the newest command. Nothing comes back from the vehicle. So "armed" means that the arm channel was
held up for a stated time with the throttle down, and "disarmed" that disarm frames left for one. Of
the pacer itself the link hears reports; that none comes means something, too.
"""

import asyncio
import math
from collections.abc import Awaitable, Callable
from functools import partial

from links.core import (
    BRING_DOWN_LIMIT_S,
    DEADLINE_LIMIT_S,
    Attitude,
    Command,
    Deadman,
    LinkError,
    LinkLost,
    LinkMisuse,
    LinkRejected,
    LinkStatus,
    Phase,
)
from links.rf.codec import Manner, RfLinkConfig, RfTelemetry, Service
from links.rf.pacer import Arm, End, Give, Hear, OpenPacer, Order, Pacer, PacerReport, Serve, Stop
from links.text import link_notice

ANEW_S = 0.01
"""An attitude that is not so much newer than the last is the same one, reported again [s]."""
SILENT_S = 1.0
"""A pacer that reports nothing for so long, or no arming so long after its end, stands still, or
can't be heard [s]; a bridge's station that sends nothing for so long is gone."""
END_LIMIT_S = DEADLINE_LIMIT_S + BRING_DOWN_LIMIT_S + SILENT_S
"""Longest wait for a pacer to end [s]: the longest command, its bring-down, and its word of it."""


class HeardPacer:
    """One pacer after the other. Times are on the event loop's clock [s]."""

    def __init__(
        self,
        manner: Manner,
        open_pacer: Callable[[Hear], Awaitable[Pacer]],
        *,
        news: Hear,
        missed: Callable[[], None],
    ) -> None:
        """Nothing is opened yet.

        ``open_pacer`` gets at the pacer, whose ``manner`` counts from then on.

        ``news`` takes each report, and None at the pacer's end; ``missed`` is called where a report
        is missing.
        """
        self.manner = manner
        self.pacer: Pacer | None = None
        """None while there is none."""
        self.report: PacerReport | None = None
        """The newest; None before the first."""
        self._open_pacer = open_pacer
        self._news, self._missed = news, missed
        self._dead = False
        """True once the pacer has ended without being told to."""
        self._mute = False
        """True while the pacer should have reported and has not."""
        self._watch: asyncio.TimerHandle | None = None

    async def open(self) -> None:
        """Start the pacer, or find it.

        Raises:
            LinkError: as the pacer's kind has it.
        """
        self.report, self._dead, self._mute = None, False, False
        try:
            self.pacer = await self._open_pacer(self._hear)
        except BaseException:
            self._listen_until(None)
            raise
        self.manner = self.pacer.manner

    def give(self, order: Order) -> bool:
        """Hand over ``order`` without waiting; False where nobody takes it."""
        return self.pacer is not None and self.pacer.give(order)

    def let_go(self) -> None:
        """There is none any more, and nothing is expected of it."""
        self.pacer = None
        self._listen_until(None)

    @property
    def newest(self) -> PacerReport:
        """The newest report of a pacer that was opened."""
        assert self.report is not None, "a pacer that was opened has reported"
        return self.report

    def why_lost(self) -> str:
        """Why nothing leaves but a bring-down and disarm frames, or nothing at all.

        Empty where commands may.
        """
        return self.why_silent() or (self.report.heir if self.report is not None else "")

    def why_helpless(self) -> str:
        """Reason of :meth:`why_silent`, with who has to act then."""
        nobody = self._dead or not self._mute
        why = self.why_silent()
        return link_notice("module.failsafe_acts", why=why).text if why and nobody else why

    def why_silent(self) -> str:
        """Why nothing leaves at all; empty where it does."""
        if self._dead:
            return link_notice("module.dead").text
        if self._mute:
            return self.pacer.why_mute if self.pacer is not None else "not connected"
        return self.report.port if self.report is not None else "not connected"

    def words(self) -> str:
        """Status of the pacer in words."""
        report = self.report
        if report is None:
            return ""
        counts = f"{report.frames} frames, {report.lost} lost, {report.repeated} repeated"
        return self.why_lost() or f"{counts}, 99 % within {report.late_us[1]} µs; {report.note}"

    def ahead_of_frame(self, now_s: float) -> float:
        """The next instant that lies ``manner.lead_s`` before a frame."""
        period = self.manner.period_s
        first = self.newest.frame_s - self.manner.lead_s
        return first + math.ceil((now_s - first) / period) * period

    def _hear(self, report: PacerReport | None) -> None:
        if report is None:
            self._dead = True
            self._news(None)
            self._listen_until(None)
            return
        self.report, self._mute = report, False
        self._listen_until(asyncio.get_running_loop().time() + SILENT_S)
        self._news(report)

    def _listen_until(self, when_s: float | None) -> None:
        """Expect a report before ``when_s``.

        What came while this process stood still is read before it is missed.
        """
        if self._watch is not None:
            self._watch.cancel()
        self._watch = (
            asyncio.get_running_loop().call_at(when_s, self._miss) if when_s is not None else None
        )

    def _miss(self) -> None:
        self._mute = True
        self._missed()


async def end_pacer(pacer: Pacer, linger_s: float) -> None:
    """Have ``pacer`` end once the vehicle is down and disarm frames have left for ``linger_s`` [s].

    Then let go.
    """
    try:
        if pacer.give(End(linger_s)):
            async with asyncio.timeout(END_LIMIT_S + linger_s):
                await pacer.wait_for_end()
    except TimeoutError:
        pass  # it is frozen; should it ever wake up, it finds itself alone and disarms
    finally:
        pacer.forget()


_UNTIMELY = link_notice("module.untimely").text

_CLOSED = "on a link that is not connected"
_CLOSING = "on a link that is being closed"
_ARMING = "while arm() streams"


class PacedLink:
    """Implements :class:`links.core.deadman.CommandLink` (see there)."""

    def __init__(self, manner: Manner, open_pacer: Callable[[Hear], Awaitable[Pacer]]) -> None:
        """Nothing is opened yet.

        ``open_pacer`` gets at the pacer, whose ``manner`` counts from then on.
        """
        self._heard = HeardPacer(manner, open_pacer, news=self._hear, missed=self._miss)
        self._deadman = Deadman()
        """A likeness of the pacer's own, so that send() knows at once what will not leave."""
        self._arming = 0
        self._stopped = True
        """Killed, disarmed or closed since the newest arming began."""
        self._sent = 0
        self._expired = 0
        self._why_over = ""
        """Why the newest arming is over, or soon will be, though nobody here has ended it."""
        self._unmet = ""
        """See :class:`links.core.deadman.LinkStatus`."""
        self._watch: Callable[[Attitude], None] = lambda told: None
        self._felt_s = -math.inf
        self._busy = _CLOSED
        """Why send() is out of place now; empty where it is not."""

    @property
    def period_s(self) -> float:
        """Time between two commands [s]."""
        return self._heard.manner.period_s

    @property
    def follows_poses(self) -> bool:
        """False: a module wants its frames evenly, so a command's time is just before its frame."""
        return False

    @property
    def autopilot(self) -> None:
        """None: the receiver is told alone."""
        return None

    @property
    def status(self) -> LinkStatus:
        """The link as it is now; ``received`` counts frames that came back from the module."""
        report = self._heard.report
        told = report.telemetry if report is not None else RfTelemetry()
        return LinkStatus(
            battery_v=told.battery_v,
            battery_share=told.battery_share,
            mode=told.mode or "",
            angles_rad=()
            if told.attitude is None
            else Attitude(0.0, told.attitude, None).angles_rad,
            uplink_share=told.uplink_share,
            uplink_dbm=told.uplink_dbm,
            uplink_snr_db=told.uplink_snr_db,
            state=self._state(),
            sent=self._sent,
            expired=self._expired,
            received=report.received if report is not None else 0,
            dropped=dict(report.dropped) if report is not None else {},
            text=""
            if self._state() == "closed"
            else self._heard.why_lost() or self._why_over or self._heard.words(),
            phase="over" if self._heard.pacer is None else self._deadman.phase(_now()),
            slept_s=report.slept_s if report is not None else 0.0,
            late_octaves=report.late_octaves if report is not None else (),
            period_s=self.period_s if report is not None else 0.0,
            hears_vehicle=False,
            warning=report.warning if report is not None else "",
            unmet=self._unmet,
        )

    def _state(self) -> str:
        if self._busy == _CLOSED:
            return "closed"
        if self._heard.pacer is None:
            return "connecting"
        if self._heard.why_lost():
            return "lost"
        over = self._busy == _ARMING or self._deadman.phase(_now()) is Phase.OVER
        return "connected" if over else "armed"

    def watch_attitude(self, watch: Callable[[Attitude], None]) -> None:
        """Call ``watch`` with the attitudes that come back through the module, as CRSF's do."""
        self._watch = watch

    async def connect(self) -> None:
        """Start the pacer and open the port, or find both: disarm frames leave.

        LinkRejected where it obeys another.
        """
        if self._busy != _CLOSED:
            raise LinkMisuse("the link is connected already, or being closed; close it first")
        self._busy = "while it connects"
        try:
            await self._heard.open()
        except BaseException:
            self._busy = _CLOSED
            raise
        why = self._heard.why_lost()
        if self._busy == _CLOSED or why:
            await self.close()
            raise LinkLost(why or link_notice("module.closed_connecting"))
        self._busy = ""

    async def examine(self) -> None:
        """Nothing can be asked: no receiver tells of itself."""
        self._free_for("examine")

    async def arm(self, idle: Callable[[], Command]) -> None:
        """Show a disarmed, then an armed transmitter, the throttle down, and stream ``idle()``.

        Only a fresh ``idle()`` keeps this alive, else a LinkError tells; its thrust leaves once the
        vehicle counts as armed. Returns so that a caller who sends at once, and then every period,
        stays just ahead of the frames.
        """
        self._free_for("arm")
        if self._state() == "armed":
            raise LinkMisuse("arm() on a link that is armed")
        loop, heard, manner = asyncio.get_running_loop(), self._heard, self._heard.manner
        self._busy = _ARMING
        try:
            due = heard.ahead_of_frame(loop.time())
            await _sleep_until(due)
            self._arming += 1
            self._deadman.arm()
            self._stopped, self._why_over, self._unmet = False, "", ""
            if not heard.give(Arm(self._arming, due)):
                raise LinkLost(heard.why_lost() or link_notice("module.no_orders"))
            obeys_s = due + manner.arm_low_s + manner.arm_high_s
            while due < obeys_s or heard.newest.arming != self._arming:
                if not self._send(idle(), loop.time()) and not self._stopped:
                    raise LinkError(link_notice("arming.idle_expired"))
                if due > obeys_s + SILENT_S:
                    raise LinkLost(link_notice("arming.not_taken"))
                due += manner.period_s
                if due < loop.time():
                    due = heard.ahead_of_frame(loop.time())
                await _sleep_until(due)
                self._still_arming()
            self._busy = ""
        except BaseException:
            self._stop()
            raise
        finally:
            if self._busy == _ARMING:  # not closed meanwhile
                self._busy = ""

    def send(self, command: Command) -> bool:
        """See the port; it leaves with the next frame. False also where the port is gone."""
        if self._busy:
            raise LinkMisuse(f"send() {self._busy}")
        return self._send(command, _now())

    def _send(self, command: Command, now_s: float) -> bool:
        if not self._deadman.take(command, now_s):
            self._expired += 1
            return False
        if not self._heard.give(Give(self._arming, command)):
            return False
        self._sent += 1
        return True

    async def silent(self) -> None:
        """Return once nothing that lifts may leave any more without a new arming."""
        while self._deadman.phase(_now()) is not Phase.OVER:  # noqa: ASYNC110  # the clock opens it, not an event
            await asyncio.sleep(self._heard.manner.period_s)

    async def kill(self) -> None:
        """Disarm with the next frame; returns when disarm frames have left for ``disarm_s``.

        See the port.
        """
        heard, pacer = self._heard, self._heard.pacer
        self._stop()
        await asyncio.sleep(self._heard.manner.disarm_s)
        if pacer is None or (heard.pacer is pacer and heard.why_silent()):
            why = heard.why_silent() if pacer is not None else link_notice("module.closed").text
            raise LinkLost(link_notice("module.unsent", why=why))

    async def disarm(self) -> None:
        """Send disarm frames.

        The vehicle counts as disarmed once they have left for ``disarm_s``.
        """
        self._free_for("disarm")
        self._stop()
        await asyncio.sleep(self._heard.manner.disarm_s)
        self._still_there()

    async def serve(self, service: Service, duration_s: float) -> None:
        """Have the module do ``service`` for ``duration_s`` [s]; returns when that is over.

        Raises:
            LinkRejected: the vehicle is armed, or the module can't do that.
            LinkLost: the port went away.
            LinkMisuse: the link is not connected.
        """
        self._free_for(service)
        if service not in self._heard.manner.services:
            raise LinkRejected(link_notice("module.no_service", service=service))
        if self._state() == "armed":
            raise LinkRejected(link_notice("module.service_armed", service=service))
        self._heard.give(Serve(service, duration_s))
        await asyncio.sleep(duration_s)
        self._still_there()

    async def close(self) -> None:
        """See the port: disarm frames come last."""
        pacer, busy = self._heard.pacer, self._busy
        self._busy = _CLOSED if pacer is None else _CLOSING
        if busy == _ARMING:
            self._stop()
        if pacer is None:
            return
        linger_s = self._heard.manner.disarm_s if self._arming else 0.0
        try:
            await end_pacer(pacer, linger_s)
        finally:
            if self._heard.pacer is pacer:
                self._heard.let_go()
                self._busy = _CLOSED
                self._deadman.stop()

    # ----

    def _stop(self) -> None:
        """Nothing that lifts from the next frame on."""
        self._stopped = True
        self._deadman.stop()
        self._heard.give(Stop())

    def _free_for(self, what: str) -> None:
        if self._busy:
            raise LinkMisuse(f"{what}() {self._busy}")

    def _still_arming(self) -> None:
        self._still_there()
        if self._stopped:
            raise LinkError(link_notice("arming.killed"))

    def _still_there(self) -> None:
        if self._busy in (_CLOSED, _CLOSING):
            raise LinkError(link_notice("module.closed_early"))
        if self._state() == "lost":
            raise LinkLost(self._heard.why_lost())

    def _miss(self) -> None:
        """Nobody tells what leaves: where frames do, the newest command runs out and its bring-down
        follows.
        """
        self._note_unmet()
        self._deadman.hold()

    def _note_unmet(self) -> None:
        """Note a command or bring-down that cannot leave.

        That the port comes back, or a pacer, changes nothing.
        """
        owed = self._busy != _ARMING and self._deadman.phase(_now()) in (
            Phase.FRESH,
            Phase.BRING_DOWN,
        )
        if owed and not self._unmet:
            self._unmet = self._heard.why_helpless()

    def _feel(self, told: RfTelemetry) -> None:
        """The vehicle may have told how it lies."""
        if (
            told.attitude is not None
            and told.attitude_s is not None
            and told.attitude_s > self._felt_s + ANEW_S
        ):
            self._felt_s = told.attitude_s
            self._watch(Attitude(told.attitude_s, told.attitude, None))

    def _hear(self, report: PacerReport | None) -> None:
        self._note_unmet()
        if report is not None:
            self._feel(report.telemetry)
        # A report from before the newest arming says nothing about it.
        if report is None or (report.arming == self._arming and (report.over or report.port)):
            ends = self._deadman.stop
        elif self._heard.why_lost() or (report.arming == self._arming and report.deaf):
            ends = self._deadman.hold
        else:
            return
        asked = self._stopped or self._busy in (_CLOSED, _CLOSING)
        if not asked and not self._why_over and self._deadman.phase(_now()) is not Phase.OVER:
            self._why_over = self._heard.why_lost() or _UNTIMELY
        ends()


def _now() -> float:
    return asyncio.get_running_loop().time()


async def _sleep_until(when_s: float) -> None:
    await asyncio.sleep(max(0.0, when_s - _now()))


class SerialRfLink(PacedLink):
    """Implements :class:`links.core.deadman.CommandLink` (see there)."""

    def __init__(
        self,
        config: RfLinkConfig,
        *,
        thrust_max_n: float,
        thrust_curve: float = 0.0,
        open_pacer: OpenPacer | None = None,
    ) -> None:
        """Nothing is opened yet; ``thrust_max_n`` is the thrust at full throttle [N].

        ``thrust_curve`` is the curve in force (links/core/deadman.py); ``open_pacer`` starts the
        pacer: in another process where there is None, or wherever a simulation has it.
        """
        if open_pacer is None:
            # Shared memory and ports: not for a bridge's link.
            from links.rf.pacer_process import open_process

            open_pacer = open_process
        config = config.with_thrust_curve(thrust_curve)
        super().__init__(config.manner, partial(open_pacer, config, thrust_max_n))
