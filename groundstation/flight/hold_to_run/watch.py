"""Looks how the operator's hold stands, for as long as a flight lasts."""

import asyncio
from collections.abc import Callable
from typing import Protocol

from groundstation.flight.hold_to_run.hold import Hold, InputLost

LOOK_S = 0.01
"""How often it is asked how it stands [s]: letting go is known after this, and the time of a bounce, twice at most."""


class Input(Protocol):
    """A key, an axis, or a channel."""

    what: str
    """Its name, for the operator."""

    def share(self) -> float | None:
        """How far it is pressed, 0 to 1; None before anything was heard of it.

        Raises:
            InputLost: it can't be asked any more.
        """
        ...

    def close(self) -> None:
        """Release it."""
        ...


class HoldWatch:
    """One flight's."""

    def __init__(self, what: str, above: float, connect: Callable[[], Input]) -> None:
        """``connect`` makes the input as the flight begins; ``what`` is its name until then."""
        self.hold = Hold(what, above)
        self._connect = connect

    async def run(self, looked: Callable[[], None]) -> None:
        """Look until cancelled, and call ``looked`` each time, also where it can't be asked any more."""
        loop, held = asyncio.get_running_loop(), None
        try:
            held = self._connect()
            self.hold.name(held.what)
            while True:
                try:
                    self.hold.see(held.share(), loop.time())
                except InputLost as lost:
                    self.hold.lose(str(lost))
                looked()
                await asyncio.sleep(LOOK_S)
        except Exception as error:  # noqa: BLE001  # whatever it is, nobody knows any more whether it is held
            self.hold.lose(str(error) or type(error).__name__)
        finally:
            if held is not None:
                held.close()
        while True:
            looked()
            await asyncio.sleep(LOOK_S)
