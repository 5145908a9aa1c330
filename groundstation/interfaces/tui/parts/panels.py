"""The parts of the pages. Each keeps what it shows and draws itself; none knows the others or where data come from."""

import math
from collections.abc import Sequence

from textual.content import Content
from textual.widget import Widget

from groundstation.core.geometry import Vec3, euler_zyx
from groundstation.core.messages import Check, Snapshot
from groundstation.interfaces.tui.parts.bars import content
from groundstation.interfaces.tui.parts.picture import Flown
from groundstation.interfaces.tui.parts.plot import Line, Spans, Track, history, horizon, in_time, nice_top, top_view
from groundstation.interfaces.tui.parts.themes import ERROR, FLOWN, LABEL, WANTED, WARNING, WIND
from groundstation.interfaces.tui.parts.words import arrow, checks, numbers
from links.core import printable

WIND_S2 = 0.5
"""The arrow of b̂ is so long in the view from above [m per m/s²]."""


class TopView(Widget):
    """The path seen from above, beside its reference."""

    DEFAULT_CSS = "TopView { height: 1fr; }"

    def __init__(self) -> None:
        """Nothing flown yet."""
        super().__init__()
        self._flown: Sequence[Flown] = ()
        self._wind: Vec3 | None = None

    def show(self, snapshot: Snapshot, flown: Sequence[Flown]) -> None:
        """Take b̂, which has an arrow, and what was flown, which is drawn as it is then."""
        self._flown = flown
        self._wind = None if snapshot.diagnostics is None else snapshot.diagnostics.b_hat
        self.refresh()

    def render(self) -> Content:
        """The plot, its scale in the last row."""
        width, height = self.size.width, self.size.height - 1
        if width < 8 or height < 3:
            return Content("")
        tracks = [
            Track(points=[one.reference_ned[:2] for one in self._flown], style=WANTED, head="+"),
            Track(points=[one.position_ned[:2] for one in self._flown], style=FLOWN, head="●"),
        ]
        legend: Spans = [("● flown", FLOWN), (" + ref", WANTED)]
        if self._wind is not None and self._flown:
            north, east, _ = self._flown[-1].position_ned
            tip = (north + WIND_S2 * self._wind[0], east + WIND_S2 * self._wind[1])
            tracks.insert(1, Track(points=[(north, east), tip], style=WIND, head=arrow((*self._wind[:2], 0.0))))
            legend.append((" → b̂", WIND))
        rows, cell_m = top_view(tracks, width, height)
        cells = max(1, min(width - 30, 10))
        scale = f"├{'─' * (cells - 2)}┤ {cells * cell_m:.2g} m  N↑  " if cells > 2 else f"{cell_m:.2g} m a column "
        return content([*rows, [(scale, LABEL), *legend]], width)


class InTime(Widget):
    """North, east and height with their references, one below the other."""

    DEFAULT_CSS = "InTime { height: 1fr; }"

    def __init__(self) -> None:
        """Nothing flown yet."""
        super().__init__()
        self._flown: Sequence[Flown] = ()

    def show(self, _: Snapshot, flown: Sequence[Flown]) -> None:
        """Take what was flown, which is drawn as it is then."""
        self._flown = flown
        self.refresh()

    def render(self) -> Content:
        """Three plots."""
        width, height = self.size.width, self.size.height // 3 - 1
        if width < 8 or height < 1:
            return Content("")
        rows: list[Spans] = []
        for axis, (name, sign) in enumerate((("north", 1.0), ("east", 1.0), ("height", -1.0))):
            lines = [
                Line([sign * one.reference_ned[axis] for one in self._flown], WANTED),
                Line([sign * one.position_ned[axis] for one in self._flown], FLOWN),
            ]
            drawn, low, high = in_time(lines, width, height, 0.1)
            now = f"{lines[1].values[-1]:+.2f} m" if self._flown else "-"
            rows += [[(f"{name} ", LABEL), (now, FLOWN), (f"   {low:+.3g} to {high:+.3g} m", LABEL)], *drawn]
        return content(rows, width)


class Curves(Widget):
    """Some numbers in time, each by its own name, on one pair of axes."""

    DEFAULT_CSS = "Curves { height: 1fr; min-height: 3; }"

    def __init__(self, title: str, names: Sequence[tuple[str, str]], least: float) -> None:
        """``names`` with their styles; at least ``least`` lies between bottom and top."""
        super().__init__()
        self._title, self._names, self._least = title, names, least
        self._values: Sequence[Sequence[float]] = ()

    def show(self, values: Sequence[Sequence[float]]) -> None:
        """For each name its values, oldest first."""
        self._values = values
        self.refresh()

    def render(self) -> Content:
        """A row of words above the plot."""
        width, height = self.size.width, max(1, self.size.height - 1)
        if width < 8:
            return Content("")
        lines = [Line(values, style) for values, (_, style) in zip(self._values, self._names, strict=False)]
        drawn, low, high = in_time(lines, width, height, self._least)
        head: Spans = [(f"{self._title} {low:.3g} to {high:.3g}  ", LABEL)]
        return content([[*head, *((f"{name} ", f"bold {style}") for name, style in self._names)], *drawn], width)


class ErrorHistory(Widget):
    """The distance from the reference over the last snapshots."""

    DEFAULT_CSS = "ErrorHistory { height: 3; }"

    def __init__(self) -> None:
        """Nothing flown yet."""
        super().__init__()
        self._flown: Sequence[Flown] = ()

    def show(self, _: Snapshot, flown: Sequence[Flown]) -> None:
        """Take what was flown, which is drawn as it is then."""
        self._flown = flown
        self.refresh()

    def render(self) -> Content:
        """One row of words above blocks."""
        errors = [one.error_m for one in self._flown][-max(1, self.size.width) :]
        top = nice_top(errors, 0.01)
        newest = f"{100.0 * errors[-1]:.1f} cm" if errors else "-"
        head = [("error ", LABEL), (newest, ""), (f"   full height {100.0 * top:g} cm", LABEL)]
        rows = history(errors, top, self.size.width, max(1, self.size.height - 1))
        return content([head, *([(row, ERROR)] for row in rows)], self.size.width)


class Horizon(Widget):
    """The horizon as it is seen from the vehicle, and where its nose points."""

    DEFAULT_CSS = "Horizon { height: 8; }"

    def __init__(self) -> None:
        """Level."""
        super().__init__()
        self._attitude = (0.0, 0.0, 0.0)

    def show(self, snapshot: Snapshot) -> None:
        """Take the attitude."""
        self._attitude = euler_zyx(snapshot.attitude)
        self.refresh()

    def render(self) -> Content:
        """A row of words above the drawing."""
        roll, pitch, yaw = self._attitude
        width, height = self.size.width, max(1, self.size.height - 1)
        compass = "?" if not math.isfinite(yaw) else arrow((math.cos(yaw), math.sin(yaw), 0.0))
        head: Spans = [("horizon, ±30° from top to bottom   nose ", LABEL), (compass, FLOWN)]
        return content([head, *horizon(roll, pitch, width, height, FLOWN, "bold $mark")], width)


class Preflight(Widget):
    """The pre-flight list."""

    DEFAULT_CSS = "Preflight { height: 1fr; }"

    def __init__(self) -> None:
        """None made yet."""
        super().__init__()
        self._checks: tuple[Check, ...] | None = None

    def show(self, snapshot: Snapshot) -> None:
        """Take the checks."""
        if snapshot.checks != self._checks:
            self._checks = snapshot.checks
            self.refresh()

    def render(self) -> Content:
        """One below the other, wrapped where there is room for all."""
        rows = [Content.assemble(*row) for row in checks(self._checks or ())]
        width, room = max(1, self.size.width), self.size.height
        wrapped = [line for row in rows for line in row.wrap(width)]
        return Content("\n").join(
            wrapped if len(wrapped) <= room else [row.truncate(width, ellipsis=True) for row in rows]
        )


class Numbers(Widget):
    """All numbers of the newest snapshot."""

    def __init__(self) -> None:
        """Nothing seen yet."""
        super().__init__()
        self._rows: list[Spans] = []

    def show(self, snapshot: Snapshot, stale: bool) -> None:
        """Take the snapshot; a stale one is shown faint, because it is no longer true."""
        rows = numbers(snapshot)
        self._rows = [[(text, f"dim {LABEL}") for text, _ in row] for row in rows] if stale else rows
        self.refresh()

    def render(self) -> Content:
        """Its rows."""
        return content(self._rows, self.content_size.width)


class Events(Widget):
    """The newest events, the newest last."""

    DEFAULT_CSS = "Events { height: 3; }"

    def __init__(self) -> None:
        """Nothing heard yet."""
        super().__init__()
        self._events: tuple[str, ...] = ()

    def show(self, events: Sequence[str]) -> None:
        """Take the newest events, oldest first."""
        newest = tuple(events)
        if newest != self._events:
            self._events = newest
            self.refresh()

    def render(self) -> Content:
        """As many as there is room for."""
        room = max(1, self.size.height - 1)
        rows: list[Spans] = [[("─ events ".ljust(self.size.width, "─"), LABEL)]]
        return content([*rows, *map(event, self._events[-room:])], self.size.width)


def event(line: str) -> Spans:
    """One event, with a mark where it is a warning."""
    time, _, text = printable(line).partition(" ")
    warns = text.lower().startswith(("aborted", "warning", "killed", "not ", "pre-flight fail"))
    return [(f"{time:>9} ", LABEL), (text, WARNING if warns else "")]
