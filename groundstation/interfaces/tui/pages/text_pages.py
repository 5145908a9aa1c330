"""The pages of text: the configuration in force, and all that was told; both can be searched."""

from collections.abc import Iterable
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.content import Content
from textual.widgets import Input, Static

from groundstation.interfaces.tui.pages.page import Frame, Page
from groundstation.interfaces.tui.parts import LABEL, Spans, event
from links.core import printable


class TextPage(Page):
    """Lines, and a field to search them by."""

    DEFAULT_CSS = """
    TextPage VerticalScroll { height: 1fr; }
    TextPage Input { height: 1; border: none; background: $raised; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("slash", "search", "search"), Binding("escape", "read", "read")]
    HINT: ClassVar[str]
    _shown: object = None

    def matter(self) -> ComposeResult:
        """The field above the text."""
        yield Input(placeholder=self.HINT)
        with VerticalScroll():
            yield Static(id="text")

    def on_mount(self) -> None:
        """One reads before one searches."""
        self.query_one(VerticalScroll).focus()

    def lines(self, frame: Frame) -> list[Spans]:
        """What is to be read, where the words that are searched for do not matter."""
        raise NotImplementedError

    def draw(self, frame: Frame) -> None:
        """All of it, where it is not there already."""
        words = self.query_one(Input).value.lower().split()
        lines = [line for line in self.lines(frame) if _has("".join(text for text, _ in line), words)]
        key = (len(lines), lines[-1:], words, len(frame.picture.events))
        if key != self._shown:
            self._shown = key
            self.query_one("#text", Static).update(Content("\n").join([Content.assemble(*line) for line in lines]))

    def on_input_changed(self) -> None:
        """Draw it at the next occasion."""
        self._drawn = (-1, False)

    def on_input_submitted(self) -> None:
        """Read what was found."""
        self.action_read()

    def action_search(self) -> None:
        """Type what to look for."""
        self.query_one(Input).focus()

    def action_read(self) -> None:
        """Back to the text."""
        self.query_one(VerticalScroll).focus()


class ConfigPage(TextPage):
    """Config."""

    NAME: ClassVar[str] = "Config"
    HINT = "/ searches the configuration: words of a key or its value"

    def lines(self, frame: Frame) -> list[Spans]:
        """Each key with its section, so that it can be found by both."""
        hello = frame.picture.hello
        if hello is None or not hello.config:
            return [[("the configuration is not known", LABEL)]]
        head: Spans = [(printable(f"{hello.vehicle}: {hello.origin}"), LABEL)]
        return [head, *flat(hello.config)]


class LogPage(TextPage):
    """Log."""

    NAME: ClassVar[str] = "Log"
    HINT = "/ searches the events"

    def on_mount(self) -> None:
        """Stay with the newest."""
        super().on_mount()
        self.query_one(VerticalScroll).anchor()

    def lines(self, frame: Frame) -> list[Spans]:
        """The newest last."""
        return [event(line) for line in frame.picture.events] or [[("nothing was told yet", LABEL)]]


def flat(config: str) -> Iterable[Spans]:
    """The lines of a TOML text as ``section.key = value``."""
    section = ""
    for line in config.splitlines():
        text = printable(line.strip())
        if text.startswith("["):
            section = text.strip("[]") + "."
        elif text and not text.startswith("#"):
            key, _, value = text.partition("=")
            yield [(section, LABEL), (f"{key.strip()} ", "bold"), (f"= {value.strip()}", "")]


def _has(text: str, words: list[str]) -> bool:
    low = text.lower()
    return all(word in low for word in words)
