"""Runner of hand-shakes: polls their steps, sends their frames, and passes answers on to them."""

import asyncio
from collections.abc import Callable

from links.core import LinkError
from links.mavlink.protocol import Handshake, Message

POLL_S = 0.05
"""Longest time between two polls of a hand-shake without a set-point stream [s]: no longer than the
shortest repetition of a request."""


class HandshakeRunner:
    """Runs hand-shakes with one autopilot, one after the other."""

    def __init__(
        self, send: Callable[[bytes], object], obstacle: Callable[[], LinkError | None]
    ) -> None:
        """``send`` sends a frame; ``obstacle()`` returns why nothing can be requested now.

        The caller passes on every message of the autopilot (:meth:`take_message`), and calls
        :meth:`wake` when ``obstacle`` may have changed.
        """
        self._send = send
        self._obstacle = obstacle
        self._one_at_a_time = asyncio.Lock()
        self._wake = asyncio.Event()
        """Set to poll the hand-shake before its period is over."""
        self._handshake: Handshake | None = None
        """Hand-shake under way; None without one."""

    def wake(self) -> None:
        """Check the obstacle and poll the hand-shake now."""
        self._wake.set()

    def take_message(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot, received at ``now_s`` on the event loop's clock
        [s].
        """
        if self._handshake is not None:
            self._handshake.take_message(message, now_s)
            self._wake.set()

    async def run(
        self,
        handshake: Handshake,
        stream: Callable[[float], None] | None = None,
        period_s: float = POLL_S,
    ) -> None:
        """Run ``handshake``, after those before it.

        Args:
            handshake: the steps.
            stream: sends a set-point at the time that it is called with [s]; None for none.
            period_s: period of ``stream``, or longest time between two polls [s].

        Raises:
            LinkRejected: the autopilot refused.
            LinkLost: it did not answer.
            LinkError: another failure, or the obstacle that came up.
        """
        async with self._one_at_a_time:
            self._handshake = handshake
            try:
                await self._poll_to_end(handshake, stream, period_s)
            finally:
                self._handshake = None

    async def _poll_to_end(
        self, handshake: Handshake, stream: Callable[[float], None] | None, period_s: float
    ) -> None:
        """Poll ``handshake`` each period, and at each message, until it is done or has failed."""
        loop = asyncio.get_running_loop()
        due_s = loop.time()
        while True:
            if (obstacle := self._obstacle()) is not None:
                raise obstacle
            now = loop.time()
            if now >= due_s:
                if stream is not None:
                    stream(now)
                due_s += period_s
                if due_s <= now:
                    due_s = now + period_s  # a set-point that is late by a period is skipped
            for frame in handshake.poll(now):
                self._send(frame)
            if handshake.failure is not None:
                raise handshake.failure
            if handshake.done:
                return
            self._wake.clear()
            try:
                async with asyncio.timeout_at(due_s):
                    await self._wake.wait()
            except TimeoutError:
                pass
