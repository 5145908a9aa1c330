"""A simulated autopilot, one by name, on a UDP socket: it speaks first, to the ground station, as PX4 does."""

import asyncio
import math
from collections import deque
from collections.abc import Callable
from typing import Any

from sim.autopilots.ardupilot import ArduPilotAutopilot
from sim.autopilots.base import SimulatedAutopilot
from sim.autopilots.px4 import Px4Autopilot


class AutopilotPeer(asyncio.DatagramProtocol):
    """Runs on the real and on the virtual loop alike."""

    def __init__(
        self, autopilot: SimulatedAutopilot, remote: tuple[str, int], *, delay_s: float = 0.0, hearing_s: float = 0.0
    ) -> None:
        """Bring ``autopilot`` to the ground station that listens at ``remote`` (host, port).

        ``delay_s`` is how long what it says takes to leave, ``hearing_s`` how long what it is told takes to reach
        it, on top of what the network takes [s].
        """
        self._autopilot = autopilot
        self._delay_s = delay_s
        self._hearing_s = hearing_s
        self._unheard: deque[bytes] = deque()
        self._mute = self._deaf = False
        self._remote = remote
        self.overhear: Callable[[float, bytes], None] | None = None
        """Sees every datagram as it comes, and when [s]."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._transport: asyncio.DatagramTransport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._timer_s = math.inf
        self._end: asyncio.Future[None] | None = None

    async def run(self) -> None:
        """Live until cancelled; raises what the autopilot or the vehicle under it raises."""
        loop = asyncio.get_running_loop()
        self._end = loop.create_future()
        self._loop = loop
        self._transport, _ = await loop.create_datagram_endpoint(lambda: self, remote_addr=self._remote)
        try:
            self._wake()
            await self._end
        finally:
            self._loop = None
            if self._timer is not None:
                self._timer.cancel()
            self._transport.abort()

    def silence(self) -> None:
        """Let nothing leave any more, as a telemetry radio that dies; it still hears and flies."""
        self._mute = True

    def cut(self, cut: bool) -> None:
        """Let nothing pass either way, or everything again; what would have passed is lost."""
        self._mute = self._deaf = cut

    def reboot(self, lasts_s: float) -> None:
        """Restart the autopilot, which neither hears nor speaks for ``lasts_s`` [s]."""
        loop = asyncio.get_running_loop()

        def back() -> None:
            self.cut(False)
            self._wake()

        self.cut(True)
        self._autopilot.reboot(loop.time())
        loop.call_later(lasts_s, back)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        if self._loop is None:
            return
        if self.overhear is not None:
            self.overhear(self._loop.time(), data)
        if self._deaf:
            return
        if self._hearing_s:
            # Timers of one instant may swap; what they let through stays in order.
            self._unheard.append(data)
            self._loop.call_later(self._hearing_s, self._hear)
        else:
            self._hear(data)

    def _hear(self, data: bytes | None = None) -> None:
        if self._loop is None:
            return
        try:
            heard = self._unheard.popleft() if data is None else data
            self._send(self._autopilot.receive(heard, self._loop.time()))
        except Exception as error:  # noqa: BLE001  # run() raises it
            self._fail(error)
        else:
            self._schedule()

    def _wake(self) -> None:
        if self._loop is None:
            return
        self._timer_s = math.inf
        try:
            self._send(self._autopilot.poll(self._loop.time()))
        except Exception as error:  # noqa: BLE001  # run() raises it
            self._fail(error)
        else:
            self._schedule()

    def _schedule(self) -> None:
        """Wake when the autopilot has something to do; a timer that comes too early does no harm."""
        due_s = self._autopilot.next_due_s
        if due_s < self._timer_s and self._loop is not None:
            if self._timer is not None:
                self._timer.cancel()
            self._timer = self._loop.call_at(due_s, self._wake)
            self._timer_s = due_s

    def _send(self, frames: list[bytes]) -> None:
        if self._delay_s and frames and self._loop is not None:
            self._loop.call_later(self._delay_s, self._leave, frames)
        else:
            self._leave(frames)

    def _leave(self, frames: list[bytes]) -> None:
        if self._transport is not None and not self._mute:
            for frame in frames:
                self._transport.sendto(frame)

    def _fail(self, error: Exception) -> None:
        if self._end is not None and not self._end.done():
            self._end.set_exception(error)


AUTOPILOTS: dict[str, type[SimulatedAutopilot]] = {"px4": Px4Autopilot, "ardupilot": ArduPilotAutopilot}
"""What ``--autopilot`` takes."""
