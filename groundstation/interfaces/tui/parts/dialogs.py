"""What asks back. In each of them the keys that bring the vehicle down act at once, as everywhere."""

from collections.abc import Sequence
from typing import ClassVar, TypeVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Vertical, VerticalScroll
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from groundstation.interfaces.tui.parts.bars import Knobs
from links.core import printable

T = TypeVar("T")
CSS = """
Dialog { align: center middle; background: $background 60%; }
Dialog #box { width: 70; max-width: 96%; height: auto; max-height: 90%; padding: 1 2; background: $raised;
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
        """What is to be answered."""
        yield from ()

    def action_leave(self) -> None:
        """Leave without an answer."""
        self.dismiss(None)


class Typed(Dialog[str]):
    """Asks for a line, which ``wanted`` must equal where it is given."""

    def __init__(self, title: str, text: str, *, wanted: str | None = None, value: str = "") -> None:
        """``value`` stands there at first."""
        super().__init__(title, text)
        self._wanted, self._value = wanted, value

    def answers(self) -> ComposeResult:
        """One line."""
        yield Input(self._value)
        yield Static(Content("Enter: do it   Escape: leave"), id="says")

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Take what was typed, where it is right."""
        typed = event.value.strip()
        if self._wanted is not None and typed != self._wanted:
            self.query_one("#says", Static).update(Content(f"{typed!r} is not {self._wanted!r}: nothing was done"))
            event.input.clear()  # what is typed next is a name of its own
            return
        self.dismiss(typed)


class Choice(Dialog[str]):
    """Asks for one of several answers; the first is the one that does least."""

    def __init__(self, title: str, text: str, options: Sequence[tuple[str, str]], *, orders: bool = True) -> None:
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

    BINDINGS: ClassVar[list[BindingType]] = [Binding("question_mark,q", "leave", "back")]

    def __init__(self, keys: Sequence[tuple[str, str]], *, orders: bool) -> None:
        """``keys`` and what they do."""
        super().__init__("Keys", "", orders=orders)
        self._keys = keys

    def answers(self) -> ComposeResult:
        """One below the other."""
        with VerticalScroll():
            rows = [Content.assemble((f"{key:>9}  ", "bold"), says) for key, says in self._keys]
            yield Static(Content("\n").join(rows))
