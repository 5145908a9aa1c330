"""A pacer that is started again whenever it ends, and what the operator of its machine is told of it."""

import asyncio
from collections.abc import Callable

import msgspec

from links.core.port import LinkError
from links.rf.codecs.codec import RfLinkConfig
from links.rf.pacer_messages import End, OpenPacer, Order, Pacer, Report

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
        self.report: Report | None = None
        """The newest, or what is true of a pacer that ended; None before the first."""
        self._config = config
        self._open_pacer = open_pacer
        self._say, self._heard = say, heard
        self._pacer: Pacer | None = None
        self._ends = False
        self._disarmed = True
        """Whether that is what the operator was told last."""
        self._quiet: Report | None = None
        """The first report after which nothing that lifts has left; None where something has."""

    async def run(self) -> None:
        """Pace until cancelled; then what flies is brought down before this returns."""
        loop = asyncio.get_running_loop()
        while True:
            began = loop.time()
            await self._paced()
            if loop.time() < began + AGAIN_S:
                await asyncio.sleep(AGAIN_S)

    def give(self, order: Order) -> None:
        """Hand over ``order``, where there is a pacer."""
        if self._pacer is not None:
            self._pacer.give(order)

    async def _paced(self) -> None:
        self._quiet = None
        try:
            pacer = self._pacer = await self._open_pacer(self._config, 1.0, self._hear)
        except LinkError as error:
            self._say(str(error))
            return
        try:
            await pacer.ended()
            self._say("the pacer ended: starting it again, disarmed")
        except asyncio.CancelledError:
            self._ends = True
            pacer.give(End(self._config.disarm_s))
            await pacer.ended()
            raise
        finally:
            self._pacer = None
            pacer.forget()

    def _hear(self, report: Report | None) -> None:
        """Take the pacer's report; None means that it ended."""
        before, ended = self.report, report is None
        if self._ends and ended:
            return
        if report is not None:
            self._tell(report, before)
            if report.heir and self._pacer is not None and not (before is not None and before.heir):
                self._pacer.give(End(self._config.disarm_s))  # once all is down, a pacer with a stand-by follows
        elif before is not None:  # what flew then may still do so: nobody sends it anything until there is another
            report = msgspec.structs.replace(before, port="the pacer ended; it is being started again")
        self.report = report
        self._heard(ended)

    def _tell(self, report: Report, before: Report | None) -> None:
        if report.port and (before is None or before.port != report.port):
            self._say(report.port)
        if before is not None and before.port and not report.port:
            self._say("the port is back, disarmed")
        if report.heir and not (before is not None and before.heir):
            self._say(report.heir)
        if not report.over:
            if self._disarmed:
                self._say("the vehicle is armed")
            self._disarmed, self._quiet = False, None
        elif report.port:
            self._quiet = None
        elif self._quiet is None:
            self._quiet = report
        elif not self._disarmed:
            left = report.frames - self._quiet.frames + 1  # one had left before the first such report
            if left * self._config.period_s >= self._config.disarm_s:
                self._say("the vehicle is disarmed")
                self._disarmed = True
