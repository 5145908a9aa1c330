"""Runner of hand-shakes: polls their steps, sends their frames, and passes answers on to them."""

import asyncio
from collections.abc import Callable

from links.core import LinkError
from links.mavlink.protocol import Handshake, Message

POLL_S = 0.05
"""Period at which a request without a set-point stream checks the time [s]."""


class HandshakeRunner:
    """Goes through hand-shakes with one autopilot, one after the other."""

    def __init__(
        self, send: Callable[[bytes], object], obstacle: Callable[[], LinkError | None]
    ) -> None:
        """``send`` sends a frame; ``obstacle()`` returns why nothing can be asked now.

        The caller passes on every message (:meth:`hear`), and wakes it when the wire changes.
        """
        self._send = send
        self._obstacle = obstacle
        self._one_at_a_time = asyncio.Lock()
        self._news = asyncio.Event()
        self._handshake: Handshake | None = None

    def wake(self) -> None:
        """Check obstacle and hand-shake now."""
        self._news.set()

    def hear(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot."""
        if self._handshake is not None:
            self._handshake.hear(message, now_s)
            self._news.set()

    async def see_through(
        self,
        handshake: Handshake,
        meanwhile: Callable[[float], None] | None = None,
        period_s: float = POLL_S,
    ) -> None:
        """Go through ``handshake``, one at a time, with ``meanwhile(now_s)`` each ``period_s`` [s].

        Raises:
            LinkRejected: the autopilot refused.
            LinkLost: it did not answer.
            LinkError: another failure, or the obstacle that came up.
        """
        async with self._one_at_a_time:
            self._handshake = handshake
            try:
                await self._go_through(handshake, meanwhile, period_s)
            finally:
                self._handshake = None

    async def _go_through(
        self, handshake: Handshake, meanwhile: Callable[[float], None] | None, period_s: float
    ) -> None:
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            if (obstacle := self._obstacle()) is not None:
                raise obstacle
            now = loop.time()
            if now >= due_s:
                if meanwhile is not None:
                    meanwhile(now)
                due_s += period_s
                if due_s <= now:
                    due_s = now + period_s  # a late frame is left out, never made up for
            for frame in handshake.poll(now):
                self._send(frame)
            if handshake.failure is not None:
                raise handshake.failure
            if handshake.done:
                return
            self._news.clear()
            try:
                async with asyncio.timeout_at(due_s):
                    await self._news.wait()
            except TimeoutError:
                pass
