"""Widgets of the pages and dialogs: each keeps what it shows and draws itself.

None knows where data come from.

Themes are three sets of colours, told apart by colour-blind eyes: Okabe and Ito's
(jfly.uni-koeln.de/color), for paper. A style in the texts of drawing.py is a name from here, such
as ``$flown``. Meaning never rests on colour alone.
"""

import os
import sys
from collections.abc import Sequence
from textwrap import wrap
from typing import ClassVar, TypeVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.events import Key
from textual.reactive import reactive
from textual.screen import ModalScreen
from textual.theme import Theme
from textual.widget import Widget
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from groundstation.config import ConfigError
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Check, Notice, Severity, Snapshot, notice
from groundstation.interfaces.tui.drawing import (
    FLOWN,
    LABEL,
    WANTED,
    WARNING,
    WIND,
    PlotLine,
    PlotTrack,
    Spans,
    arrow,
    big,
    check_rows,
    huge,
    in_time,
    number_rows,
    top_view,
)
from groundstation.interfaces.tui.model import (
    ALARM,
    CALM,
    ORDERS,
    BannerText,
    OperatorOrder,
    PlotSample,
    possible,
)
from links.text import printable

TALL = 36
"""Large letters are used from this height of the screen on [rows]."""
WORDS_WIDTH = 30
"""Room for the words beside large letters, with the gap between them [columns]."""


def join_rows(rows: Sequence[Spans]) -> Content:
    """Rows of styled pieces as what a widget draws, wrapped where they are too long."""
    return Content("\n").join([Content.assemble(*row) for row in rows])


def content(rows: Sequence[Spans], width: int) -> Content:
    """Rows of styled pieces as what a widget draws, cut off at ``width``."""
    return Content("\n").join(
        [Content.assemble(*row).truncate(width, ellipsis=True) for row in rows]
    )


class Banner(Widget):
    """The state in large letters, and beside it whose it is and why.

    On a large screen, and for alarms, larger.
    """

    DEFAULT_CSS = "Banner { height: 3; }"

    def __init__(self) -> None:
        super().__init__()
        self._shown = BannerText("", CALM, "")
        self._beside: tuple[str, str] = ("", "")

    def show(self, shown: BannerText, whose: str, holder: str) -> None:
        """Take what to say: the headline, the vehicle and its time, and who holds control."""
        if (shown, (whose, holder)) != (self._shown, self._beside):
            self._shown, self._beside = shown, (printable(whose), printable(holder))
            self.styles.height = len(self._letters())
            self.refresh()

    def _letters(self) -> tuple[str, ...]:
        large = huge(self._shown.big)
        tall = self.screen.size.height >= TALL
        if (tall or self._shown.tone == ALARM) and len(
            large[0]
        ) + WORDS_WIDTH <= self.screen.size.width:
            blank = " " * len(large[0])
            return (blank, *large, blank) if tall else large
        letters = big(self._shown.big)
        return (
            letters
            if len(letters[0]) + WORDS_WIDTH <= self.screen.size.width
            else ("",) * len(letters)
        )

    def on_resize(self) -> None:
        """Other letters may fit now."""
        self.styles.height = len(self._letters())

    def render(self) -> Content:
        """All in the colours of the tone."""
        tone = self._shown.tone
        style = f"bold ${tone}-text on ${tone}-back"
        letters = self._letters()
        beside = f" {letters[0]}  " if letters[0] else " "
        room = max(1, self.size.width - len(beside))
        whose, holder = self._beside
        first = whose if letters[0] else f"{self._shown.big.upper()}  {whose}"
        lines = max(1, len(letters) - 1)
        words = [
            first,
            *wrap(printable(self._shown.detail), room, max_lines=lines, placeholder=" …"),
        ]
        if holder and len(letters) > len(words):
            words += [""] * (len(letters) - len(words) - 1) + [holder]
        words = (words + [""] * len(letters))[: len(letters)]
        return content(
            [
                [((f" {row}  {text}" if row else f" {text}").ljust(self.size.width), style)]
                for row, text in zip(letters, words, strict=True)
            ],
            self.size.width,
        )


class Knob(Widget):
    """One order, to be clicked on; its key says how to do it without a mouse."""

    DEFAULT_CSS = """
    Knob { height: 1; content-align: center middle; text-style: bold; background: $raised; }
    Knob.go { background: $flying-back; color: $flying-text; }
    Knob.calm { background: $calm-back; color: $calm-text; }
    Knob.land, Knob.abort { background: $busy-back; color: $busy-text; }
    Knob.kill { background: $alarm-back; color: $alarm-text; }
    Knob.off { background: $raised; color: $label; text-style: none; }
    Knob.again { text-style: bold reverse blink; }
    Knob:hover { text-style: bold reverse; }
    """

    _again = reactive(default=False)

    def __init__(self, order: OperatorOrder) -> None:
        super().__init__(classes=order.tone)
        self.order = order
        self.styles.width = f"{len(self._both)}fr"

    def show(self, state: str | None, again: bool) -> None:
        """Take the mission's state, and whether this waits for its second press."""
        self.set_class(not possible(self.order, state), "off")
        self.set_class(again, "again")
        self._again = again

    def render(self) -> Content:
        """Keys and name; where there is no room, the key that no multiplexer takes and the name, or
        the name alone.
        """
        fitting = (text for text in (self._both, self._brief) if len(text) <= self.size.width)
        return Content("AGAIN!" if self._again else next(fitting, self.order.label))

    @property
    def _both(self) -> str:
        return f"{self.order.shown} {self.order.label}"

    @property
    def _brief(self) -> str:
        return f"{self.order.shown.rpartition('/')[2]} {self.order.label}"

    async def on_click(self) -> None:
        """As if its key had been pressed."""
        await self.run_action(f"app.{self.order.action}")


class Knobs(Widget):
    """The orders in one row, or in two on a small screen. A dialog has those that act at once."""

    SCOPED_CSS = False  # its look depends on a class of the screen
    DEFAULT_CSS = """
    Knobs { height: auto; layout: horizontal; }
    Knobs Horizontal { height: auto; width: 51fr; }
    Knobs #go { width: 28fr; }  /* as long as their words */
    Knobs Knob { margin: 0 0 0 1; }
    .-small Knobs { layout: vertical; }
    .-small Knobs Horizontal, .-small Knobs #go { width: 1fr; }
    """

    def __init__(self, *, always_only: bool = False) -> None:
        """``always_only``: none that asks back."""
        super().__init__()
        self._always_only = always_only

    def compose(self) -> ComposeResult:
        """Those that ask back or need control, then those that act at once."""
        for name, always in (("go", False), ("always", True)):
            if always or not self._always_only:
                with Horizontal(id=name):
                    yield from (
                        Knob(order) for order in ORDERS if order.key and order.always == always
                    )

    def show(self, state: str | None, again: bool) -> None:
        """Take the mission's state, and whether a kill waits for its second press."""
        for knob in self.query(Knob):
            knob.show(state, again and knob.order.tone == "kill")


WIND_S2 = 0.5
"""The arrow of b̂ is so long in the view from above [m per m/s²]."""


class TopView(Widget):
    """The path seen from above, beside its reference."""

    DEFAULT_CSS = "TopView { height: 1fr; }"

    _wind: Vec3 | None = None
    _flown: Sequence[PlotSample] = ()

    def show(self, snapshot: Snapshot, flown: Sequence[PlotSample]) -> None:
        """Take what was flown, which is drawn as it is then, and b̂, which has an arrow."""
        self._wind = None if snapshot.diagnostics is None else snapshot.diagnostics.b_hat
        self._flown = flown
        self.refresh()

    def render(self) -> Content:
        """The plot, its scale in the last row."""
        width, height = self.size.width, self.size.height - 1
        if width < 8 or height < 3:
            return Content("")
        tracks = [
            PlotTrack(
                points=[one.reference_neh[:2] for one in self._flown], style=WANTED, head="+"
            ),
            PlotTrack(points=[one.position_neh[:2] for one in self._flown], style=FLOWN, head="●"),
        ]
        slim = width < 28  # its signs alone then
        legend: Spans = [("●" if slim else "● flown", FLOWN), ("+" if slim else " + ref", WANTED)]
        if self._wind is not None and self._flown:
            north, east, _ = self._flown[-1].position_neh
            tip = (north + WIND_S2 * self._wind[0], east + WIND_S2 * self._wind[1])
            tracks.insert(
                1,
                PlotTrack(
                    points=[(north, east), tip], style=WIND, head=arrow((*self._wind[:2], 0.0))
                ),
            )
            legend.append(("→" if slim else " → b̂", WIND))
        rows, cell_m = top_view(tracks, width, height)
        cells = max(1, min(width - 30, 10))
        scale = (
            f"├{'─' * (cells - 2)}┤ {cells * cell_m:.2g} m  N↑  "
            if cells > 2
            else f"─ {cell_m:.2g} m "
        )
        return content([*rows, [(scale, LABEL), *legend]], width)


class Curves(Widget):
    """Some numbers in time, each by its own name, on one pair of axes."""

    DEFAULT_CSS = "Curves { height: 1fr; min-height: 3; }"

    def __init__(
        self, title: str, names: Sequence[tuple[str, str]], least: float, id: str | None = None
    ) -> None:
        """``names`` with their styles; at least ``least`` lies between bottom and top."""
        super().__init__(id=id)
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
        lines = [
            PlotLine(values, style)
            for values, (_, style) in zip(self._values, self._names, strict=False)
        ]
        drawn, low, high = in_time(lines, width, height, self._least)
        head: Spans = [(f"{self._title} {low:.3g} to {high:.3g}  ", LABEL)]
        return content(
            [[*head, *((f"{name} ", f"bold {style}") for name, style in self._names)], *drawn],
            width,
        )


class Preflight(Widget):
    """The pre-flight list."""

    DEFAULT_CSS = "Preflight { height: 1fr; }"
    _checks: reactive[tuple[Check, ...]] = reactive(())

    def show(self, snapshot: Snapshot) -> None:
        """Take the checks."""
        self._checks = snapshot.checks

    def render(self) -> Content:
        """One below the other, what stands in the way first."""
        return join_rows(check_rows(self._checks))


class Numbers(Widget):
    """All numbers of the newest snapshot."""

    _snapshot: reactive[Snapshot | None] = reactive(None)
    _stale = reactive(default=False)

    def show(self, snapshot: Snapshot, stale: bool) -> None:
        """Take the snapshot; a stale one is shown faint, because it is no longer true."""
        self._snapshot, self._stale = snapshot, stale

    def render(self) -> Content:
        """Its rows."""
        rows = [] if self._snapshot is None else number_rows(self._snapshot)
        if self._stale:
            rows = [[(text, f"dim {LABEL}") for text, _ in row] for row in rows]
        return content(rows, self.content_size.width)


class Events(Widget):
    """The newest events, the newest last."""

    DEFAULT_CSS = "Events { height: 3; }"
    _events: reactive[tuple[Notice, ...]] = reactive(())

    def show(self, events: Sequence[Notice]) -> None:
        """Take the newest events, oldest first."""
        self._events = tuple(events)

    def render(self) -> Content:
        """As many as there is room for."""
        room = max(1, self.size.height - 1)
        rows: list[Spans] = [[("─ events ".ljust(self.size.width, "─"), LABEL)]]
        return content([*rows, *map(event_row, self._events[-room:])], self.size.width)


def event_row(event: Notice) -> Spans:
    """One event, with a mark where it is a warning."""
    grave = event.severity is Severity.WARNING
    return [(f"{event.time_s:9.3f} ", LABEL), (printable(event.says), WARNING if grave else "")]


T = TypeVar("T")
CSS = """
Dialog { align: center middle; background: $background 60%; }
Dialog #box { width: 70; max-width: 96%; height: auto; max-height: 90%; padding: 1 2;
    background: $raised;
    border: heavy $flown; }
Dialog #title { text-style: bold; margin: 0 0 1 0; }
Dialog #says { color: $label; margin: 1 0 0 0; }
Dialog Input { margin: 1 0 0 0; }
Dialog OptionList { height: auto; max-height: 12; margin: 1 0 0 0; }
Dialog Knobs { dock: bottom; }
Dialog VerticalScroll { height: auto; max-height: 100%; }
"""


class Dialog(ModalScreen[T]):
    """A box above the page; escape leaves it, and nothing was done."""

    DEFAULT_CSS = CSS
    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape", "leave", "back")]

    def __init__(self, title: str, text: str, *, orders: bool = True) -> None:
        """Its words; ``orders``: whether anything can be ordered here."""
        super().__init__()
        self._title, self._text, self._orders = printable(title), printable(text, keep="\n"), orders

    def compose(self) -> ComposeResult:
        """Title, text, and what is to be answered."""
        with Vertical(id="box"):
            yield Static(Content(self._title), id="title")
            yield Static(Content(self._text))
            yield from self.answers()
        if self._orders:
            yield Knobs(always_only=True)

    def answers(self) -> ComposeResult:
        """Yield the widgets that take the answer."""
        yield from ()

    def action_leave(self) -> None:
        """Leave without an answer."""
        self.dismiss(None)


class Line(Input):
    """A line that acts on its keys in the order in which they were pressed.

    Textual hands a key that edits up to the app, and a letter that came at once with it, over a
    slow connection, overtakes it there: "1.5", Backspace, "2" became "1.5".
    """

    EDITS: ClassVar[dict[str, str]] = {
        key: binding.action
        for binding in Input.BINDINGS
        if isinstance(binding, Binding)
        for key in binding.key.split(",")
    }
    """Key that edits or submits the line → its action."""

    async def on_key(self, event: Key) -> None:
        """Run the action of a key that edits before the next key is read."""
        if action := self.EDITS.get(event.key):
            event.prevent_default()
            event.stop()
            await self.run_action(action)


class Typed(Dialog[str]):
    """Asks for a line, which ``wanted`` must equal where it is given."""

    def __init__(
        self, title: str, text: str, *, wanted: str | None = None, value: str = ""
    ) -> None:
        """``value`` stands there at first."""
        super().__init__(title, text)
        self._wanted, self._value = wanted, value

    def answers(self) -> ComposeResult:
        """One line."""
        yield Line(self._value)
        yield Static(Content("Enter: do it   Escape: leave"), id="says")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Take what was typed, where it is right."""
        typed = event.value.strip()
        if self._wanted is not None and typed != self._wanted:
            self.query_one("#says", Static).update(
                Content(str(notice("screen.other_name", typed=typed, wanted=self._wanted)))
            )
            event.input.clear()  # what is typed next is a name of its own
            return
        self.dismiss(typed)


class Choice(Dialog[str]):
    """Asks for one of several answers; the first is the one that does least."""

    def __init__(
        self, title: str, text: str, options: Sequence[tuple[str, str]], *, orders: bool = True
    ) -> None:
        """``options``: what each answers, and its words."""
        super().__init__(title, text, orders=orders)
        self._options = options

    def answers(self) -> ComposeResult:
        """One below the other."""
        yield OptionList(*(Option(Content(words), id=name) for name, words in self._options))

    def on_option_list_option_selected(self, event: OptionList.OptionSelected) -> None:
        """Take it."""
        self.dismiss(event.option_id)


class Help(Dialog[None]):
    """All keys."""

    DEFAULT_CSS = """
    Help Horizontal { height: auto; }
    Help .key { width: 11; padding: 0 2 0 0; text-align: right; text-style: bold; }
    Help .says { width: 1fr; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("question_mark,q", "leave", "back")]

    def __init__(self, keys: Sequence[tuple[str, str]], *, orders: bool) -> None:
        super().__init__("Keys", "", orders=orders)
        self._keys = keys

    def answers(self) -> ComposeResult:
        """One below the other."""
        with VerticalScroll():
            for key, says in self._keys:
                with Horizontal():
                    yield Static(Content(key), classes="key")
                    yield Static(Content(says), classes="says")


def _theme(name: str, *, dark: bool, background: str, text: str, **colours: str) -> Theme:
    return Theme(
        name=name,
        primary=colours["flown"],
        secondary=colours["wind"],
        warning=colours["warn"],
        error=colours["bad"],
        success=colours["wind"],
        accent=colours["warn"],
        foreground=text,
        background=background,
        surface=colours["raised"],
        panel=colours["raised"],
        dark=dark,
        variables={
            "block-cursor-background": colours["flown"],
            "block-cursor-foreground": background,
            **{key.replace("_", "-"): colour for key, colour in colours.items()},
        },
    )


COLOURS = {
    "background": ("#101214", "#FFFFFF", "#000000"),
    "text": ("#E8E8E8", "#101010", "#FFFFFF"),
    "raised": ("#202428", "#E6E8EA", "#000000"),
    "label": ("#9AA0A6", "#5A5F64", "#FFFFFF"),
    "flown": ("#56B4E9", "#0067A5", "#5CC8FF"),
    "wanted": ("#B0B0B0", "#808080", "#FFFFFF"),
    "mark": ("#F0E442", "#7A6A00", "#FFF25C"),
    "wind": ("#00B386", "#00755A", "#2CFFC6"),
    "warn": ("#E69F00", "#9A5B00", "#FFB000"),
    "bad": ("#FF7A33", "#B34100", "#FF8040"),
    "axis_1": ("#56B4E9", "#0067A5", "#5CC8FF"),
    "axis_2": ("#E69F00", "#9A5B00", "#FFB000"),
    "axis_3": ("#CC79A7", "#9B3D75", "#FF9AD5"),
    "alarm_text": ("#FFFFFF", "#FFFFFF", "#000000"),
    "alarm_back": ("#A03000", "#B33A00", "#FF8040"),
    "alarm_dim": ("#381808", "#FFE3D6", "#000000"),
    "busy_text": ("#000000", "#000000", "#000000"),
    "busy_back": ("#E69F00", "#F0B030", "#FFF25C"),
    "calm_text": ("#FFFFFF", "#000000", "#000000"),
    "calm_back": ("#444444", "#C8CCD0", "#FFFFFF"),
    "flying_text": ("#FFFFFF", "#FFFFFF", "#000000"),
    "flying_back": ("#005A9C", "#0067A5", "#5CC8FF"),
}
"""Colours by name: in the dark theme, in the light one, and in the one with most contrast."""
THEMES = tuple(
    _theme(name, dark=name != "light", **{key: colours[number] for key, colours in COLOURS.items()})
    for number, name in enumerate(("dark", "light", "contrast"))
)
"""The first is the usual one."""


def require_terminal(otherwise: str) -> None:
    """Raise ConfigError without a terminal to draw on.

    The screen follows the terminal's own size: one that a shell exports stays as it was, and the
    orders, which stand at the bottom, would be drawn outside of a terminal that has become smaller.
    """
    for name in ("LINES", "COLUMNS"):
        os.environ.pop(name, None)
    drawn = (sys.stdin, sys.stdout, sys.stderr)  # Textual draws on the last
    if not all(stream.isatty() for stream in drawn):
        raise ConfigError("tui", notice("screen.no_terminal", otherwise=otherwise))
