"""A pacer in the simulation's own loop: the very frames of the process that paces in real time, at exact instants."""

import asyncio
import errno
from collections.abc import Callable

from groundstation.runtime import sleep_until
from links.rf import LOOK_S, FramePacer, Give, OpenPacer, Order, PacerReport, RfLinkConfig, StandbyWatch

MODULE = ("module", 1)
"""Where the simulated module listens, on the loop's network in memory."""
STATION = ("station", 1)
"""Where its frames come from."""


class WirePort(asyncio.DatagramProtocol):
    """Implements :class:`links.rf.pacer.Port`: a wire to :data:`MODULE`, a datagram a frame."""

    def __init__(self) -> None:
        """Nothing is opened yet; ``attach`` first."""
        self.cut = False
        """True while the plug is out."""
        self.pacer: InlinePacer | None = None
        """Whoever lets frames go here, or did last; None before the first."""
        self._transport: asyncio.DatagramTransport | None = None
        self._came = b""

    async def attach(self) -> None:
        """Get a place on the network in memory."""
        loop = asyncio.get_running_loop()
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=STATION, remote_addr=MODULE)

    def detach(self) -> None:
        """Give it back."""
        if self._transport is not None:
            self._transport.abort()
            self._transport = None

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take what the module says (called by the event loop)."""
        self._came += data

    def open(self) -> None:
        """Raises OSError while the plug is out."""
        self._wire()

    def write(self, frame: bytes) -> bool:
        """Send one frame."""
        self._wire().sendto(frame)
        return True

    def read(self, limit: int) -> bytes:
        """What has come."""
        self._wire()
        data, self._came = self._came[:limit], b""
        return data

    def close(self) -> None:
        """Nothing to do: the wire is the simulation's."""

    def _wire(self) -> asyncio.DatagramTransport:
        if self.cut or self._transport is None:
            raise OSError(errno.ENODEV, "cannot open the simulated port: it is unplugged")
        return self._transport


class InlinePacer:
    """Implements :class:`links.rf.pacer.Pacer`."""

    why_mute = "the simulated pacer has failed"

    def __init__(
        self, config: RfLinkConfig, thrust_max_n: float, port: WirePort, on_report: Callable[[PacerReport | None], None]
    ) -> None:
        """See :func:`opened_on`."""
        self.manner = config.manner
        self._loop = asyncio.get_running_loop()
        self._period, self._frame_s = config.period_s, 1.01 * config.frame_s
        self._config, self._thrust_max = config, thrust_max_n
        self._port = port
        self._on_report = on_report
        self._pacer = FramePacer(config, thrust_max_n, port, self._loop.time())
        self._struck: tuple[float, str] | None = None
        self._waiting: list[Order] = []
        self._task = asyncio.create_task(self._pace())

    def report(self) -> PacerReport:
        """As it is now."""
        return self._pacer.report(self._loop.time(), note="simulated")

    def give(self, order: Order) -> bool:
        """Hand over ``order``."""
        if self._task.done():
            return False
        if self._struck is None:
            self._pacer.order(order, self._loop.time())
        elif not isinstance(order, Give):
            self._waiting.append(order)
        return True

    def strike(self, *, stopped: bool = False) -> None:
        """The pacer dies, or only stands still: its stand-by lets frames go as soon as it would know of it."""
        knows_s = self._loop.time() + (StandbyWatch(self._period).wait_s + LOOK_S if stopped else 0.0)
        self._struck = knows_s, "the pacer stood still and was ended" if stopped else "the pacer was killed"

    async def wait_for_end(self) -> None:
        """Wait until it has ended."""
        await asyncio.wait([self._task])

    def forget(self) -> None:
        """End at once: the simulation ends here too."""
        self._task.cancel()
        self._port.detach()

    async def _pace(self) -> None:
        pacer, loop = self._pacer, self._loop
        due = loop.time() + self._period
        pacer.prepare(due)
        held = pacer.make_estate()
        while not pacer.done(loop.time()):
            await sleep_until(due)
            if self._struck is not None:
                if due < self._struck[0]:
                    due += self._period
                    continue
                pacer = self._pacer = FramePacer(self._config, self._thrust_max, self._port, loop.time())
                pacer.inherit(held, self._struck[1], loop.time())
                self._struck = None
                for order in self._waiting:
                    pacer.order(order, loop.time())
            pacer.prepare(due)
            held = pacer.make_estate()
            pacer.leave(loop.time())
            pacer.count_frame(loop.time(), 0)
            pacer.tidy(loop.time())
            due += self._period
            if pacer.has_news(loop.time()):
                self._on_report(self.report())
        await sleep_until(loop.time() + self._frame_s)  # the last frame arrives whole
        pacer.close()
        self._port.detach()


def opened_on(port: WirePort) -> OpenPacer:
    """What opens pacers on ``port``, the wire of a simulation."""

    async def open_pacer(
        config: RfLinkConfig, thrust_max_n: float, on_report: Callable[[PacerReport | None], None]
    ) -> InlinePacer:
        await port.attach()
        pacer = port.pacer = InlinePacer(config, thrust_max_n, port, on_report)
        on_report(pacer.report())
        return pacer

    return open_pacer
