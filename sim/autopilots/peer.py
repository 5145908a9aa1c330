"""A simulated autopilot, one by name, and its wires.

On UDP it speaks first, to the ground station, as PX4 does. In a rehearsal it may have to wait at an
address, to accept TCP connections, or to be at the end of a serial port.
"""

import asyncio
import math
from collections import deque
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Protocol, TypeAlias

from sim.autopilots.autopilot import SimulatedAutopilot
from sim.autopilots.dialects import ArduPilotAutopilot, Px4Autopilot


class Wire(Protocol):
    """Transport of outgoing frames."""

    def sendto(self, frame: bytes) -> None:
        """Send one frame, or drop it where nobody is there."""

    def abort(self) -> None:
        """Leave the network."""


Hear = Callable[[bytes, Any], None]
"""Takes bytes and where they came from: whole frames, or pieces of a stream, which the autopilot's
codec joins."""
OpenWire = Callable[[Hear], Awaitable[Wire]]
Address: TypeAlias = tuple[str, int]
"""Host and port."""


class UdpWire(asyncio.DatagramProtocol):
    """Implements :class:`Wire`: to one ground station, or to whoever spoke last where that has to
    speak first.
    """

    def __init__(self, hear: Hear, *, connected: bool) -> None:
        self._hear, self._connected = hear, connected
        self._station: Any = None
        self._transport: Any = None

    def connection_made(self, transport: Any) -> None:
        """Keep it (called by the event loop)."""
        self._transport = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Take one datagram (called by the event loop)."""
        self._station = addr
        self._hear(data, addr)

    def sendto(self, frame: bytes) -> None:
        """Send one frame."""
        if self._connected:
            self._transport.sendto(frame)
        elif self._station is not None:
            self._transport.sendto(frame, self._station)

    def abort(self) -> None:
        """Close the socket."""
        self._transport.abort()


class AcceptingTcp(asyncio.Protocol):
    """Implements :class:`Wire` for one TCP connection at a time: a newer one takes the place of the
    older.
    """

    def __init__(self, hear: Hear) -> None:
        self._hear = hear
        self._transport: Any = None
        self.server: asyncio.AbstractServer | None = None
        """Listening server."""

    def connection_made(self, transport: Any) -> None:
        """Somebody has connected (called by the event loop)."""
        if self._transport is not None:
            self._transport.abort()
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Take bytes (called by the event loop)."""
        self._hear(data, None)

    def sendto(self, frame: bytes) -> None:
        """Send one frame."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.write(frame)

    def abort(self) -> None:
        """Close the connection, and accept none any more."""
        if self.server is not None:
            self.server.close()
        if self._transport is not None:
            self._transport.abort()


async def open_udp(
    hear: Hear, *, local: Address | None = None, remote: Address | None = None
) -> Wire:
    """Open UDP to a ground station that listens at ``remote``, or at ``local``, where it has to
    speak first.
    """
    loop = asyncio.get_running_loop()
    _, wire = await loop.create_datagram_endpoint(
        lambda: UdpWire(hear, connected=remote is not None), local, remote
    )
    return wire


async def open_tcp(hear: Hear, *, address: Address) -> Wire:
    """Accept TCP connections at ``address``."""
    wire = AcceptingTcp(hear)
    wire.server = await asyncio.get_running_loop().create_server(lambda: wire, *address)
    return wire


class FarEnd(Wire, Protocol):
    """The far end of a serial port; :class:`sim.radio.radio.PtyWire` is one."""

    def listen(self, take: Callable[[bytes], None]) -> None:
        """Call ``take`` with whatever is written to the port."""


async def open_far_end(hear: Hear, *, port: FarEnd) -> Wire:
    """Listen at the far end of a serial ``port``."""
    port.listen(lambda data: hear(data, None))
    return port


class AutopilotPeer:
    """Runs on the real and on the virtual loop alike."""

    def __init__(
        self,
        autopilot: SimulatedAutopilot,
        remote: tuple[str, int],
        *,
        delay_s: float = 0.0,
        hearing_s: float = 0.0,
        open_wire: OpenWire | None = None,
    ) -> None:
        """Bring ``autopilot`` to the ground station that listens at ``remote`` (host, port).

        ``delay_s`` is how long what it says takes to leave, ``hearing_s`` how long what it is told
        takes to reach it, on top of what the network takes [s]. ``open_wire`` opens another wire
        instead of that UDP.
        """
        self._open_wire = open_wire or partial(open_udp, remote=remote)
        self._autopilot = autopilot
        self._delay_s = delay_s
        self.hearing_s = hearing_s
        self._unheard: deque[bytes] = deque()
        self._mute = self._deaf = False
        self.overhear: Callable[[float, bytes], None] | None = None
        """Sees every datagram as it comes, and when [s]."""
        self._loop: asyncio.AbstractEventLoop | None = None
        self._transport: Wire | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._timer_s = math.inf
        self._end: asyncio.Future[None] | None = None

    async def run(self) -> None:
        """Live until cancelled; raises what the autopilot or the vehicle under it raises."""
        loop = asyncio.get_running_loop()
        self._end = loop.create_future()
        self._loop = loop
        self._transport = await self._open_wire(self.datagram_received)
        try:
            self._wake()
            await self._end
        finally:
            self._loop = None
            if self._timer is not None:
                self._timer.cancel()
            self._transport.abort()

    def cut(self, cut: bool, *, hears: bool = False, speaks: bool = False) -> None:
        """Let nothing pass but what it still ``hears`` or ``speaks``, or everything again.

        The rest is lost.
        """
        self._mute, self._deaf = cut and not speaks, cut and not hears

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
        """Take what comes by the wire."""
        if self._loop is None:
            return
        if self.overhear is not None:
            self.overhear(self._loop.time(), data)
        if self._deaf:
            return
        if self.hearing_s:
            # Timers of one instant may swap; what they let through stays in order.
            self._unheard.append(data)
            self._loop.call_later(self.hearing_s, self._hear)
        else:
            self._hear(data)

    def _hear(self, data: bytes | None = None) -> None:
        heard = self._unheard.popleft() if data is None else data
        self._ask(lambda now_s: self._autopilot.receive(heard, now_s))

    def _wake(self) -> None:
        self._timer_s = math.inf
        self._ask(self._autopilot.poll)

    def _ask(self, answer: Callable[[float], list[bytes]]) -> None:
        """Send what the autopilot answers now, and wake it again when it is due."""
        if self._loop is None:
            return
        try:
            self._send(answer(self._loop.time()))
        except Exception as error:  # noqa: BLE001  # run() raises it
            self._fail(error)
        else:
            self._schedule()

    def _schedule(self) -> None:
        """Wake when the autopilot has something to do.

        A timer that comes too early does no harm.
        """
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


AUTOPILOTS: dict[str, type[SimulatedAutopilot]] = {
    "px4": Px4Autopilot,
    "ardupilot": ArduPilotAutopilot,
}
"""Simulated autopilots by their name for ``--autopilot``."""
