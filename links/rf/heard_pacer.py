"""A pacer as its link hears it: its newest report, and what it means that none comes."""

import asyncio
import math
from collections.abc import Awaitable, Callable

from links.rf.codecs.codec import Manner
from links.rf.pacer_messages import End, Hear, Order, Pacer, Report

END_LIMIT_S = 4.0
"""Longest wait for a pacer to end [s]: the longest command, its bring-down, and then some."""
SILENT_S = 1.0
"""A pacer that reports nothing for so long stands still, or can't be heard [s]."""


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
        """Nothing is opened yet; ``open_pacer`` gets at the pacer, whose ``manner`` counts from then on.

        ``news`` takes each report, and None at the pacer's end; ``missed`` is called where a report is missing.
        """
        self.manner = manner
        self.pacer: Pacer | None = None
        """None while there is none."""
        self.report: Report | None = None
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
    def newest(self) -> Report:
        """The newest report of a pacer that was opened."""
        assert self.report is not None, "a pacer that was opened has reported"
        return self.report

    def why_lost(self) -> str:
        """Why nothing leaves but a bring-down and disarm frames, or nothing at all; empty where commands may."""
        return self.why_silent() or (self.report.heir if self.report is not None else "")

    def why_silent(self) -> str:
        """Why nothing leaves at all; empty where it does."""
        if self._dead:
            return "the pacer and its stand-by ended, and with them every frame: close the link, and connect it again"
        if self._mute:
            return self.pacer.why_mute if self.pacer is not None else "not connected"
        return self.report.port if self.report is not None else "not connected"

    def words(self) -> str:
        """What an operator wants to know of it."""
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

    def _hear(self, report: Report | None) -> None:
        if report is None:
            self._dead = True
            self._news(None)
            self._listen_until(None)
            return
        self.report, self._mute = report, False
        self._listen_until(asyncio.get_running_loop().time() + SILENT_S)
        self._news(report)

    def _listen_until(self, when_s: float | None) -> None:
        """Expect a report before ``when_s``. What came while this process stood still is read before it is missed."""
        if self._watch is not None:
            self._watch.cancel()
        self._watch = asyncio.get_running_loop().call_at(when_s, self._miss) if when_s is not None else None

    def _miss(self) -> None:
        self._mute = True
        self._missed()


async def end(pacer: Pacer, linger_s: float) -> None:
    """Have ``pacer`` end once the vehicle is down and disarm frames have left for ``linger_s`` [s]; then let go."""
    try:
        if pacer.give(End(linger_s)):
            async with asyncio.timeout(END_LIMIT_S + linger_s):
                await pacer.ended()
    except TimeoutError:
        pass  # it is frozen; should it ever wake up, it finds itself alone and disarms
    finally:
        pacer.forget()
