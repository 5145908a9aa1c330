"""A pacer that is started again whenever it ends, and what the operator of its machine is told of it."""

import asyncio
from collections.abc import Callable

import msgspec

from links.pacer_messages import End, OpenPacer, Order, Pacer, Report
from links.port import LinkError
from links.rf_codec import RfLinkConfig

AGAIN_S = 1.0
"""Wait before a pacer that ended is started again [s]."""


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

    async def run(self) -> None:
        """Pace until cancelled; then what flies is brought down before this returns."""
        while True:
            await self._paced()
            await asyncio.sleep(AGAIN_S)

    def give(self, order: Order) -> None:
        """Hand over ``order``, where there is a pacer."""
        if self._pacer is not None:
            self._pacer.give(order)

    async def _paced(self) -> None:
        try:
            pacer = self._pacer = await self._open_pacer(self._config, 1.0, self._hear)
        except LinkError as error:
            self._say(str(error))
            return
        try:
            await pacer.ended()
            self._say("the pacer's process ended: starting it again, disarmed")
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
        if report is None and before is not None:
            gone = "the pacer's process ended; it is being started again"
            report = msgspec.structs.replace(before, port=gone, over=True)
        self.report = report
        if report is not None:
            self._tell(report, before)
        self._heard(ended)

    def _tell(self, report: Report, before: Report | None) -> None:
        if report.port and (before is None or before.port != report.port):
            self._say(report.port)
        if before is not None and before.port and not report.port:
            self._say("the port is back, disarmed")
        if before is not None and before.over != report.over:
            self._say("the vehicle is disarmed" if report.over else "the vehicle is armed")
