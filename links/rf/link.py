"""RF link: thrust and rates as channels of a transmitter, in frames that a pacer lets go.

Frames leave all the time, whatever this process does: disarm frames until the operator arms, then
the newest command. Nothing comes back from the vehicle. So "armed" means that the arm channel was
high for a stated time with the throttle down, and "disarmed" that disarm frames left for one. The
pacer itself reports to the link; missing reports have a meaning, too.
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

SAME_ATTITUDE_S = 0.01
"""Difference of stamps up to which an attitude is the last one, reported again [s]."""
SILENT_S = 1.0
"""Silence from which a pacer counts as standing still, or as not heard [s]: without any report, or
without that of an arming after its end. A bridge's station that is silent for so long is gone."""
END_LIMIT_S = DEADLINE_LIMIT_S + BRING_DOWN_LIMIT_S + SILENT_S
"""Longest wait for the end of a pacer [s]: the longest command, its bring-down, and its report."""


class WatchedPacer:
    """Pacer whose reports are watched; it may be opened again. Times are on the event loop's clock
    [s].
    """

    def __init__(
        self,
        manner: Manner,
        open_pacer: Callable[[Hear], Awaitable[Pacer]],
        *,
        news: Hear,
        missed: Callable[[], None],
    ) -> None:
        """Nothing is opened yet.

        ``open_pacer`` starts or finds the pacer, whose own ``manner`` counts from then on. ``news``
        takes each report, and None at the pacer's end; ``missed`` is called where a report is
        missing.
        """
        self.manner = manner
        self.pacer: Pacer | None = None
        """Pacer; None while there is none."""
        self.report: PacerReport | None = None
        """Newest report; None before the first."""
        self._open_pacer = open_pacer
        self._news, self._missed = news, missed
        self._has_died = False
        """Whether the pacer has ended without an order."""
        self._is_mute = False
        """Whether a report of the pacer is overdue."""
        self._watch: asyncio.TimerHandle | None = None

    async def open(self) -> None:
        """Start the pacer, or find it.

        Raises:
            LinkError: it can't be started or found.
        """
        self.report, self._has_died, self._is_mute = None, False, False
        try:
            self.pacer = await self._open_pacer(self._hear)
        except BaseException:
            self._expect_report(None)
            raise
        self.manner = self.pacer.manner

    def give(self, order: Order) -> bool:
        """Hand over ``order`` without waiting; return whether a pacer takes it."""
        return self.pacer is not None and self.pacer.give(order)

    def release(self) -> None:
        """Forget the pacer, and expect no more reports."""
        self.pacer = None
        self._expect_report(None)

    @property
    def newest(self) -> PacerReport:
        """Newest report of a pacer that was opened."""
        assert self.report is not None, "a pacer that was opened has reported"
        return self.report

    def why_lost(self) -> str:
        """Return why commands do not leave; empty where they may.

        A bring-down and disarm frames may still leave.
        """
        return self.why_silent() or (self.report.heir if self.report is not None else "")

    def why_helpless(self) -> str:
        """Return the reason of :meth:`why_silent`, with the part that has to act then."""
        nobody = self._has_died or not self._is_mute
        why = self.why_silent()
        return link_notice("module.failsafe_acts", why=why).text if why and nobody else why

    def why_silent(self) -> str:
        """Return why nothing leaves at all; empty where frames leave."""
        if self._has_died:
            return link_notice("module.dead").text
        if self._is_mute:
            return self.pacer.why_mute if self.pacer is not None else "not connected"
        return self.report.port if self.report is not None else "not connected"

    def words(self) -> str:
        """Return the status of the pacer in words."""
        report = self.report
        if report is None:
            return ""
        counts = f"{report.frames} frames, {report.lost} lost, {report.repeated} repeated"
        return self.why_lost() or f"{counts}, 99 % within {report.late_us[1]} µs; {report.note}"

    def ahead_of_frame(self, now_s: float) -> float:
        """Return the next instant that is ``manner.lead_s`` before a frame."""
        period = self.manner.period_s
        first = self.newest.frame_s - self.manner.lead_s
        return first + math.ceil((now_s - first) / period) * period

    def _hear(self, report: PacerReport | None) -> None:
        if report is None:
            self._has_died = True
            self._news(None)
            self._expect_report(None)
            return
        self.report, self._is_mute = report, False
        self._expect_report(asyncio.get_running_loop().time() + SILENT_S)
        self._news(report)

    def _expect_report(self, when_s: float | None) -> None:
        """Expect a report before ``when_s``; None: expect none.

        Reports that came while this process stood still are read before one counts as missing.
        """
        if self._watch is not None:
            self._watch.cancel()
        self._watch = (
            asyncio.get_running_loop().call_at(when_s, self._miss) if when_s is not None else None
        )

    def _miss(self) -> None:
        self._is_mute = True
        self._missed()


async def end_pacer(pacer: Pacer, linger_s: float) -> None:
    """End ``pacer`` once the vehicle is down and disarm frames have left for ``linger_s`` [s]."""
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
        """Nothing is opened yet; arguments as in :class:`WatchedPacer`."""
        self._watched = WatchedPacer(manner, open_pacer, news=self._hear, missed=self._miss)
        self._deadman = Deadman()
        """Copy of the pacer's own switch: send() knows at once which command will not leave."""
        self._arming = 0
        self._stopped = True
        """Whether the vehicle was killed or disarmed, or the link closed, since the newest
        arming."""
        self._sent = 0
        self._expired = 0
        self._why_over = ""
        """Why the newest arming is over, or soon will be, without an order of ours."""
        self._unmet = ""
        """See :class:`links.core.deadman.LinkStatus`."""
        self._on_attitude: Callable[[Attitude], None] = lambda attitude: None
        self._attitude_s = -math.inf
        self._busy = _CLOSED
        """Why send() is out of place now; empty where it is not."""

    @property
    def period_s(self) -> float:
        """Time between two commands [s]."""
        return self._watched.manner.period_s

    @property
    def follows_poses(self) -> bool:
        """False: a module needs even frames, so a command is due just before its frame."""
        return False

    @property
    def autopilot(self) -> None:
        """None: there is only a receiver."""
        return None

    @property
    def status(self) -> LinkStatus:
        """The link as it is now; ``received`` counts frames that came back from the module."""
        report = self._watched.report
        telemetry = report.telemetry if report is not None else RfTelemetry()
        return LinkStatus(
            battery_v=telemetry.battery_v,
            battery_share=telemetry.battery_share,
            mode=telemetry.mode or "",
            angles_rad=()
            if telemetry.attitude is None
            else Attitude(0.0, telemetry.attitude, None).angles_rad,
            uplink_share=telemetry.uplink_share,
            uplink_dbm=telemetry.uplink_dbm,
            uplink_snr_db=telemetry.uplink_snr_db,
            state=self._state(),
            sent=self._sent,
            expired=self._expired,
            received=report.received if report is not None else 0,
            dropped=dict(report.dropped) if report is not None else {},
            text=""
            if self._state() == "closed"
            else self._watched.why_lost() or self._why_over or self._watched.words(),
            phase="over" if self._watched.pacer is None else self._deadman.phase(_now()),
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
        if self._watched.pacer is None:
            return "connecting"
        if self._watched.why_lost():
            return "lost"
        over = self._busy == _ARMING or self._deadman.phase(_now()) is Phase.OVER
        return "connected" if over else "armed"

    def watch_attitude(self, watch: Callable[[Attitude], None]) -> None:
        """Call ``watch`` with each attitude in the module's telemetry, as in CRSF's."""
        self._on_attitude = watch

    async def connect(self) -> None:
        """Start the pacer and open the port, or find both: disarm frames leave.

        Raises:
            LinkRejected: the pacer follows another station.
            LinkLost: the port can't be opened, or the link was closed meanwhile.
        """
        if self._busy != _CLOSED:
            raise LinkMisuse("the link is connected already, or being closed; close it first")
        self._busy = "while it connects"
        try:
            await self._watched.open()
        except BaseException:
            self._busy = _CLOSED
            raise
        why = self._watched.why_lost()
        if self._busy == _CLOSED or why:
            await self.close()
            raise LinkLost(why or link_notice("module.closed_connecting"))
        self._busy = ""

    async def examine(self) -> None:
        """Do nothing: a receiver can't be examined."""
        self._ensure_free("examine")

    async def arm(self, idle: Callable[[], Command]) -> None:
        """Show a disarmed, then an armed transmitter, the throttle down, and stream ``idle()``.

        The thrust of ``idle()`` leaves once the vehicle counts as armed. It returns just before a
        frame, so that a caller who sends at once, and then every period, stays ahead of the frames.

        Raises:
            LinkError: a command of ``idle()`` has expired, or the motors were killed.
            LinkLost: the pacer or its port is gone, or does not arm.
        """
        self._ensure_free("arm")
        if self._state() == "armed":
            raise LinkMisuse("arm() on a link that is armed")
        loop, watched, manner = asyncio.get_running_loop(), self._watched, self._watched.manner
        self._busy = _ARMING
        try:
            due = watched.ahead_of_frame(loop.time())
            await _sleep_until(due)
            self._arming += 1
            self._deadman.arm()
            self._stopped, self._why_over, self._unmet = False, "", ""
            if not watched.give(Arm(self._arming, due)):
                raise LinkLost(watched.why_lost() or link_notice("module.no_orders"))
            obeys_s = due + manner.arm_low_s + manner.arm_high_s
            while due < obeys_s or watched.newest.arming != self._arming:
                if not self._send(idle(), loop.time()) and not self._stopped:
                    raise LinkError(link_notice("arming.idle_expired"))
                if due > obeys_s + SILENT_S:
                    raise LinkLost(link_notice("arming.not_taken"))
                due += manner.period_s
                if due < loop.time():
                    due = watched.ahead_of_frame(loop.time())
                await _sleep_until(due)
                self._ensure_arming()
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
        if not self._watched.give(Give(self._arming, command)):
            return False
        self._sent += 1
        return True

    async def silent(self) -> None:
        """Return once nothing that lifts may leave any more without a new arming."""
        while self._deadman.phase(_now()) is not Phase.OVER:  # noqa: ASYNC110  # the clock opens it, not an event
            await asyncio.sleep(self._watched.manner.period_s)

    async def kill(self) -> None:
        """Disarm with the next frame; returns when disarm frames have left for ``disarm_s``.

        See the port.
        """
        watched, pacer = self._watched, self._watched.pacer
        self._stop()
        await asyncio.sleep(self._watched.manner.disarm_s)
        if pacer is None or (watched.pacer is pacer and watched.why_silent()):
            why = watched.why_silent() if pacer is not None else link_notice("module.closed").text
            raise LinkLost(link_notice("module.unsent", why=why))

    async def disarm(self) -> None:
        """Send disarm frames.

        The vehicle counts as disarmed once they have left for ``disarm_s``.
        """
        self._ensure_free("disarm")
        self._stop()
        await asyncio.sleep(self._watched.manner.disarm_s)
        self._ensure_connected()

    async def serve(self, service: Service, duration_s: float) -> None:
        """Have the module do ``service`` for ``duration_s`` [s]; return when that is over.

        Raises:
            LinkRejected: the vehicle is armed, or the module can't do that.
            LinkLost: the port went away.
            LinkMisuse: the link is not connected.
        """
        self._ensure_free(service)
        if service not in self._watched.manner.services:
            raise LinkRejected(link_notice("module.no_service", service=service))
        if self._state() == "armed":
            raise LinkRejected(link_notice("module.service_armed", service=service))
        self._watched.give(Serve(service, duration_s))
        await asyncio.sleep(duration_s)
        self._ensure_connected()

    async def close(self) -> None:
        """See the port: disarm frames come last."""
        pacer, busy = self._watched.pacer, self._busy
        self._busy = _CLOSED if pacer is None else _CLOSING
        if busy == _ARMING:
            self._stop()
        if pacer is None:
            return
        linger_s = self._watched.manner.disarm_s if self._arming else 0.0
        try:
            await end_pacer(pacer, linger_s)
        finally:
            if self._watched.pacer is pacer:
                self._watched.release()
                self._busy = _CLOSED
                self._deadman.stop()

    # ----

    def _stop(self) -> None:
        """Let nothing that lifts leave from the next frame on."""
        self._stopped = True
        self._deadman.stop()
        self._watched.give(Stop())

    def _ensure_free(self, what: str) -> None:
        if self._busy:
            raise LinkMisuse(f"{what}() {self._busy}")

    def _ensure_arming(self) -> None:
        self._ensure_connected()
        if self._stopped:
            raise LinkError(link_notice("arming.killed"))

    def _ensure_connected(self) -> None:
        if self._busy in (_CLOSED, _CLOSING):
            raise LinkError(link_notice("module.closed_early"))
        if self._state() == "lost":
            raise LinkLost(self._watched.why_lost())

    def _miss(self) -> None:
        """Take no more commands, as a report is missing: the newest one runs out, and its
        bring-down follows, if frames leave at all.
        """
        self._note_unmet()
        self._deadman.hold()

    def _note_unmet(self) -> None:
        """Note a command or bring-down that cannot leave, also if port or pacer come back."""
        owed = self._busy != _ARMING and self._deadman.phase(_now()) in (
            Phase.FRESH,
            Phase.BRING_DOWN,
        )
        if owed and not self._unmet:
            self._unmet = self._watched.why_helpless()

    def _take_telemetry(self, telemetry: RfTelemetry) -> None:
        """Pass on an attitude that is new."""
        if (
            telemetry.attitude is not None
            and telemetry.attitude_s is not None
            and telemetry.attitude_s > self._attitude_s + SAME_ATTITUDE_S
        ):
            self._attitude_s = telemetry.attitude_s
            self._on_attitude(Attitude(telemetry.attitude_s, telemetry.attitude, None))

    def _hear(self, report: PacerReport | None) -> None:
        self._note_unmet()
        if report is not None:
            self._take_telemetry(report.telemetry)
        # A report from before the newest arming says nothing about it.
        if report is None or (report.arming == self._arming and (report.over or report.port)):
            ends = self._deadman.stop
        elif self._watched.why_lost() or (report.arming == self._arming and report.deaf):
            ends = self._deadman.hold
        else:
            return
        is_ordered = self._stopped or self._busy in (_CLOSED, _CLOSING)
        if not is_ordered and not self._why_over and self._deadman.phase(_now()) is not Phase.OVER:
            self._why_over = self._watched.why_lost() or _UNTIMELY
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

        ``thrust_curve`` is the curve in force (links/core/deadman.py). ``open_pacer`` starts the
        pacer; None: in another process. A simulation has its own.
        """
        if open_pacer is None:
            # Shared memory and ports: not for a bridge's link.
            from links.rf.pacer_process import open_process

            open_pacer = open_process
        config = config.with_thrust_curve(thrust_curve)
        super().__init__(config.manner, partial(open_pacer, config, thrust_max_n))
