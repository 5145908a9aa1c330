"""What every page has at its edges: the state in large letters, the orders, and the way to the other pages."""

from collections.abc import Sequence
from textwrap import wrap

from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.content import Content
from textual.widget import Widget

from groundstation.interfaces.tui.parts.headline import ALARM, CALM, Headline
from groundstation.interfaces.tui.parts.letters import big, huge
from groundstation.interfaces.tui.parts.orders import ORDERS, Order, possible
from groundstation.interfaces.tui.parts.plot import Spans
from groundstation.interfaces.tui.parts.themes import LABEL
from links.core import printable

TALL, WORDS_WIDTH = 36, 30
"""From this height on letters may be large [rows]; they leave this room for the words beside them [columns]."""


def content(rows: Sequence[Spans], width: int) -> Content:
    """Rows of styled pieces as what a widget draws, cut off at ``width``."""
    return Content("\n").join([Content.assemble(*row).truncate(width) for row in rows])


class Banner(Widget):
    """The state in large letters, and beside it whose it is and why. On a large screen, and for alarms, larger."""

    DEFAULT_CSS = "Banner { height: 3; }"

    def __init__(self) -> None:
        """Nothing to say yet."""
        super().__init__()
        self._shown = Headline("", CALM, "")
        self._beside: tuple[str, str] = ("", "")

    def show(self, shown: Headline, whose: str, holder: str) -> None:
        """Take what to say: the headline, the vehicle and its time, and who holds control."""
        if (shown, (whose, holder)) != (self._shown, self._beside):
            self._shown, self._beside = shown, (printable(whose), printable(holder))
            self.styles.height = len(self._letters())
            self.refresh()

    def _letters(self) -> tuple[str, ...]:
        large = huge(self._shown.big)
        tall = self.screen.size.height >= TALL
        if (tall or self._shown.tone == ALARM) and len(large[0]) + WORDS_WIDTH <= self.screen.size.width:
            blank = " " * len(large[0])
            return (blank, *large, blank) if tall else large
        return big(self._shown.big)

    def on_resize(self) -> None:
        """Other letters may fit now."""
        self.styles.height = len(self._letters())

    def render(self) -> Content:
        """All in the colours of the tone."""
        tone = self._shown.tone
        style = f"bold ${tone}-text on ${tone}-back"
        letters = self._letters()
        room = max(0, self.size.width - len(letters[0]) - 3)
        whose, holder = self._beside
        words = [whose, *wrap(printable(self._shown.detail), max(room, 1))]
        if holder and len(letters) > len(words):
            words += [""] * (len(letters) - len(words) - 1) + [holder]
        words = (words + [""] * len(letters))[: len(letters)]
        return content(
            [[(f" {row}  {text}".ljust(self.size.width), style)] for row, text in zip(letters, words, strict=True)],
            self.size.width,
        )


class Knob(Widget):
    """One order, to be clicked on; its key says how to do it without a mouse."""

    DEFAULT_CSS = """
    Knob { width: 1fr; height: 1; content-align: center middle; text-style: bold; background: $raised; }
    Knob.go { background: $flying-back; color: $flying-text; }
    Knob.calm { background: $calm-back; color: $calm-text; }
    Knob.land, Knob.abort { background: $busy-back; color: $busy-text; }
    Knob.kill { background: $alarm-back; color: $alarm-text; }
    Knob.off { background: $raised; color: $label; text-style: none; }
    Knob.again { text-style: bold reverse blink; }
    Knob:hover { text-style: bold reverse; }
    """

    def __init__(self, order: Order) -> None:
        """For ``order``."""
        super().__init__(classes=order.tone)
        self.order = order
        self._again = False

    def show(self, state: str | None, again: bool) -> None:
        """Take the mission's state, and whether this has been pressed once and waits for the second press."""
        self.set_class(not possible(self.order, state), "off")
        self.set_class(again, "again")
        if again != self._again:
            self._again = again
            self.refresh()

    def render(self) -> Content:
        """Key and name."""
        return Content("AGAIN!" if self._again else f"{self.order.shown} {self.order.label}")

    async def on_click(self) -> None:
        """As if its key had been pressed."""
        await self.run_action(f"app.order('{self.order.ask}')")


class Knobs(Horizontal):
    """The orders in a row. In a dialog only those that act at once."""

    DEFAULT_CSS = """
    Knobs { height: 1; }
    Knobs Knob { margin: 0 0 0 1; }
    """

    def __init__(self, *, always_only: bool = False) -> None:
        """``always_only``: none that asks back."""
        super().__init__()
        self._orders = [order for order in ORDERS if order.key and (order.always or not always_only)]

    def compose(self) -> ComposeResult:
        """One after the other."""
        for order in self._orders:
            yield Knob(order)

    def show(self, state: str | None, again: bool) -> None:
        """Take the mission's state, and whether a kill waits for its second press."""
        for knob in self.query(Knob):
            knob.show(state, again and knob.order.tone == "kill")


class Tabs(Widget):
    """The keys that lead to the other pages, and out; each can be clicked on."""

    DEFAULT_CSS = "Tabs { height: 1; link-style: none; }"

    def __init__(self, names: Sequence[str], here: str, more: Sequence[tuple[str, str, str]]) -> None:
        """``names`` of the pages, the one that this is on, and more: key, word, action."""
        super().__init__()
        self._names, self._here, self._more = names, here, more

    def render(self) -> Content:
        """All in one row."""
        row: Spans = []
        for number, name in enumerate(self._names, 1):
            action = f"@click=app.page('{name.lower()}')"
            row.append((f" {number} {name} ", f"bold reverse {action}" if name == self._here else f"{action}"))
        row.append((" ", ""))
        for key, word, action in self._more:
            row += [(f" {key}", f"bold @click={action}"), (f" {word}", f"{LABEL} @click={action}")]
        return content([row], self.size.width)
