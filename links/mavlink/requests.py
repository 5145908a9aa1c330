"""Requests to an autopilot, one hand-shake at a time, on a connection that may end meanwhile."""

import asyncio
from collections.abc import Callable

from links.core.port import LinkError
from links.mavlink.procedures.steps import Handshake
from links.mavlink.protocol.codec import Message

POLL_S = 0.05
"""How often a request without a stream of set-points looks at the time [s]."""


class Requests:
    """Goes through hand-shakes; whoever owns it passes on every message and calls ``wake`` when the wire changes."""

    def __init__(self, leave: Callable[[bytes], object], obstacle: Callable[[], LinkError | None]) -> None:
        """``leave`` sends a frame; ``obstacle()`` is why nothing can be asked now."""
        self._leave = leave
        self._obstacle = obstacle
        self._one_at_a_time = asyncio.Lock()
        self._news = asyncio.Event()
        self._handshake: Handshake | None = None

    def wake(self) -> None:
        """Look again."""
        self._news.set()

    def hear(self, message: Message, now_s: float) -> None:
        """Take a message from the autopilot."""
        if self._handshake is not None:
            self._handshake.hear(message, now_s)
            self._news.set()

    async def see_through(
        self, handshake: Handshake, meanwhile: Callable[[float], None] | None = None, period_s: float = POLL_S
    ) -> None:
        """Go through ``handshake``, calling ``meanwhile(now_s)`` every ``period_s`` [s].

        Raises:
            LinkError: the hand-shake's failure, or the obstacle that came up.
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
                self._leave(frame)
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
