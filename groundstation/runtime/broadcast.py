"""Broadcast: the newest value to any number of readers, without a queue: a slow one misses values and delays nobody."""

import asyncio
from collections.abc import AsyncIterator
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Holds one value on one event loop. ``put`` never waits, and costs the same for any number of readers."""

    def __init__(self) -> None:
        """Begin without a value."""
        self.newest: tuple[int, T] | None = None
        """Running number (from 1) and value of the newest; None before the first."""
        self._waiting: asyncio.Future[None] | None = None

    def put(self, value: T) -> None:
        """Replace the value and wake whoever waits for it."""
        self.newest = (1 if self.newest is None else self.newest[0] + 1, value)
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting.set_result(None)

    async def newer(self, number: int = 0) -> tuple[int, T]:
        """The newest value and its number, as soon as there is one numbered above ``number``."""
        while self.newest is None or self.newest[0] <= number:
            if self._waiting is None:
                self._waiting = asyncio.get_running_loop().create_future()
            await asyncio.shield(self._waiting)  # all readers share it: one that is cancelled must not cancel it
        return self.newest

    async def values(self, period_s: float = 0.0) -> AsyncIterator[T]:
        """The newest value at once, then the newest one again and again, never two within ``period_s`` [s]."""
        number = 0
        while True:
            number, value = await self.newer(number)
            yield value
            await asyncio.sleep(period_s)
