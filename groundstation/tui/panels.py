"""The parts of the screen. Each keeps what it shows and draws itself; none knows the others or where data come from."""

from collections import deque
from textwrap import wrap

import msgspec
from textual.content import Content
from textual.widget import Widget

from groundstation.snapshot import Snapshot
from groundstation.tui.headline import ALARM, BUSY, CALM, FLYING, Headline
from groundstation.tui.letters import big
from groundstation.tui.plot import Spans, Track, history, nice_top, top_view
from groundstation.tui.words import GREY, LABEL, ORANGE, SKY, YELLOW, clean, numbers

KEPT = 600
"""Snapshots kept for the plots: two minutes at 5 Hz."""
_TONES = {
    ALARM: "bold #FFFFFF on #A03000",
    BUSY: "bold #000000 on #E69F00",
    CALM: "bold #FFFFFF on #444444",
    FLYING: "bold #FFFFFF on #005A9C",
}


class Flown(msgspec.Struct, frozen=True):
    """What the plots remember of a snapshot."""

    position: tuple[float, float]
    """(north, east) [m]"""
    reference: tuple[float, float]
    """(north, east) [m]"""
    error_m: float


def content(rows: list[Spans], width: int) -> Content:
    """Rows of styled pieces as what a widget draws, cut off at ``width``."""
    return Content("\n").join([Content.assemble(*row).truncate(width) for row in rows])


class Banner(Widget):
    """The state in large letters, and beside it whose it is and why."""

    DEFAULT_CSS = "Banner { height: 3; }"

    def __init__(self) -> None:
        super().__init__()
        self._shown = Headline("", CALM, "")
        self._whose = ""

    def show(self, shown: Headline, snapshot: Snapshot | None) -> None:
        """Take what to say, and the snapshot for vehicle and time."""
        name = f"{clean(snapshot.vehicle)}  {snapshot.flight_time_s:.1f} s" if snapshot is not None else ""
        if (shown, name) != (self._shown, self._whose):
            self._shown, self._whose = shown, name
            self.refresh()

    def render(self) -> Content:
        """Three rows, all in the colours of the tone."""
        style = _TONES[self._shown.tone]
        letters = big(self._shown.big)
        room = max(0, self.size.width - len(letters[0]) - 3)
        words = [self._whose, *wrap(clean(self._shown.detail), max(room, 1)), "", ""][:3]
        rows: list[Spans] = [
            [(f" {row}  {text}".ljust(self.size.width), style)] for row, text in zip(letters, words, strict=True)
        ]
        return content(rows, self.size.width)


class TopView(Widget):
    """The path seen from above, beside its reference."""

    DEFAULT_CSS = "TopView { height: 1fr; }"

    def __init__(self, flown: deque[Flown]) -> None:
        super().__init__()
        self._flown = flown

    def render(self) -> Content:
        """The plot, its scale in the last row."""
        width, height = self.size.width, self.size.height - 1
        if width < 8 or height < 3:
            return Content("")
        tracks = (
            Track(points=[one.reference for one in self._flown], style=GREY, head="+"),
            Track(points=[one.position for one in self._flown], style=SKY, head="●"),
        )
        rows, cell_m = top_view(tracks, width, height)
        cells = max(1, min(width - 24, 10))
        scale = f"├{'─' * (cells - 2)}┤ {cells * cell_m:.2g} m  N↑  " if cells > 2 else ""
        return content([*rows, [(scale, LABEL), ("● flown", SKY), (" + ref", LABEL)]], width)


class ErrorHistory(Widget):
    """The distance from the reference over the last snapshots."""

    DEFAULT_CSS = "ErrorHistory { height: 4; }"

    def __init__(self, flown: deque[Flown]) -> None:
        super().__init__()
        self._flown = flown

    def render(self) -> Content:
        """One row of words above blocks."""
        errors = [one.error_m for one in self._flown][-self.size.width :]
        top = nice_top(errors, 0.01)
        newest = f"{100.0 * errors[-1]:.1f} cm" if errors else "-"
        head = [("error ", LABEL), (newest, ""), (f"   full height {100.0 * top:g} cm", LABEL)]
        rows = history(errors, top, self.size.width, max(1, self.size.height - 1))
        return content([head, *([(row, YELLOW)] for row in rows)], self.size.width)


class Numbers(Widget):
    """All numbers of the newest snapshot."""

    def __init__(self) -> None:
        super().__init__()
        self._rows: list[Spans] = []

    def show(self, snapshot: Snapshot, stale: bool) -> None:
        """Take the snapshot; a stale one is shown faint, because it is no longer true."""
        rows = numbers(snapshot)
        self._rows = [[(text, f"dim {GREY}") for text, _ in row] for row in rows] if stale else rows
        self.refresh()

    def render(self) -> Content:
        """Its rows."""
        return content(self._rows, self.content_size.width)


class Events(Widget):
    """The newest events, the newest last."""

    def __init__(self) -> None:
        super().__init__()
        self._events: tuple[str, ...] = ()

    def show(self, events: tuple[str, ...]) -> None:
        """Take the newest events, oldest first."""
        if events != self._events:
            self._events = events
            self.refresh()

    def render(self) -> Content:
        """As many as there is room for."""
        room = max(1, self.size.height - 1)
        rows: list[Spans] = [[("─ events ".ljust(self.size.width, "─"), LABEL)]]
        for event in self._events[-room:]:
            time, _, text = clean(event).partition(" ")
            rows.append([(f"{time:>9} ", LABEL), (text, ORANGE if text.startswith(("aborted", "warning")) else "")])
        return content(rows, self.size.width)
