"""When work that can wait is done: just after a command has left, as the next pose is then farthest away."""

import asyncio
from collections import deque

WITHIN_S = 0.05
"""Where no command leaves, it is done after so long all the same [s]."""


class Quiet:
    """The quiet moments of one flight, or of one after the other. Belongs to one event loop."""

    def __init__(self) -> None:
        """Nothing waits."""
        self._waiting: deque[asyncio.Future[None]] = deque()

    def begin(self) -> None:
        """A command has just left: what has waited longest has its turn, and nothing else before the next command."""
        while self._waiting:
            moment = self._waiting.popleft()
            if not moment.done():
                moment.set_result(None)
                return

    def moment(self) -> asyncio.Future[None]:
        """The next quiet moment that nobody has before, no later than ``WITHIN_S`` from now; await it, or cancel it."""
        loop = asyncio.get_running_loop()
        moment: asyncio.Future[None] = loop.create_future()
        timer = loop.call_later(WITHIN_S, _come, moment)
        moment.add_done_callback(lambda _: timer.cancel())
        while self._waiting and self._waiting[0].done():  # on the ground no command takes them out
            self._waiting.popleft()
        self._waiting.append(moment)
        return moment


def _come(moment: asyncio.Future[None]) -> None:
    if not moment.done():
        moment.set_result(None)
