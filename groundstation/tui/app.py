"""The live screen of one vehicle: a process of its own that reads the status socket and can change nothing."""

import asyncio
from collections import deque
from pathlib import Path
from typing import ClassVar

from textual.app import App, ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, Vertical

from groundstation.api.client import snapshots
from groundstation.api.place import ApiError
from groundstation.snapshot import Snapshot
from groundstation.tui.headline import SILENCE_S, headline
from groundstation.tui.panels import KEPT, Banner, ErrorHistory, Events, Flown, Numbers, TopView

FRAME_S = 0.2
"""Time between two drawings [s]."""
RETRY_S = 0.5
"""Time between two tries to attach [s]."""


def run(socket_path: Path) -> int:
    """Show the vehicle whose status socket is at ``socket_path`` until the operator quits; returns the exit code."""
    screen = StatusScreen(socket_path)
    screen.run(mouse=False)
    return screen.return_code or 0


class StatusScreen(App[None]):
    """One screen; q leaves. It may be started before the ground station, and stays when that goes away."""

    CSS = """
    #body { height: 1fr; }
    Numbers { width: 46; padding: 0 0 0 1; }
    Events { height: 21%; min-height: 5; max-height: 21; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [("q", "quit", "quit")]
    ENABLE_COMMAND_PALETTE = False

    def __init__(self, socket_path: Path) -> None:
        """Attach to ``socket_path`` as soon as the screen is up."""
        super().__init__()
        self._path = socket_path
        self._flown: deque[Flown] = deque(maxlen=KEPT)
        self._newest: Snapshot | None = None
        self._drawn: tuple[Snapshot | None, bool] = (None, False)
        self._arrived_s = 0.0
        self._trouble = ""

    def compose(self) -> ComposeResult:
        """Banner on top, plots beside numbers, events below."""
        yield Banner()
        with Horizontal(id="body"):
            with Vertical():
                yield TopView(self._flown)
                yield ErrorHistory(self._flown)
            yield Numbers()
        yield Events()

    def on_mount(self) -> None:
        """Begin to read."""
        self._arrived_s = asyncio.get_running_loop().time()
        self.run_worker(self._watch())

    def on_ready(self) -> None:
        """Begin to draw: only now are all parts of the screen there."""
        self.set_interval(FRAME_S, self._draw)

    async def _watch(self) -> None:
        """Read the socket for ever, attaching again whenever it is lost."""
        loop = asyncio.get_running_loop()
        while True:
            try:
                async for snapshot in snapshots(self._path):
                    self._newest, self._arrived_s, self._trouble = snapshot, loop.time(), ""
                self._trouble = "The ground station closed its status socket."
            except FileNotFoundError:
                self._trouble = f"No ground station serves {self._path}."
            except OSError as error:
                self._trouble = f"{self._path}: {error.strerror or error}"
            except ApiError as error:
                self._trouble = str(error)
            await asyncio.sleep(RETRY_S)

    def _draw(self) -> None:
        newest = self._newest
        silence_s = asyncio.get_running_loop().time() - self._arrived_s
        self.query_one(Banner).show(headline(newest, silence_s, self._trouble), newest)
        stale = silence_s > SILENCE_S
        if newest is None or (newest, stale) == self._drawn:
            return
        last, _ = self._drawn
        self._drawn = (newest, stale)
        self.query_one(Numbers).show(newest, stale)
        self.query_one(Events).show(newest.events)
        if newest is last:
            return
        if last is not None and (newest.vehicle != last.vehicle or newest.flight_time_s < last.flight_time_s):
            self._flown.clear()  # another flight
        north, east, _ = newest.position_ned
        reference_north, reference_east, _ = newest.reference_ned
        self._flown.append(Flown((north, east), (reference_north, reference_east), newest.error_m))
        self.query_one(TopView).refresh()
        self.query_one(ErrorHistory).refresh()
