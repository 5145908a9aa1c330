"""What every page is: the state on top, its own matter in the middle, orders and the way to the others below."""

from typing import ClassVar

import msgspec
from textual.app import ComposeResult
from textual.screen import Screen

from groundstation.interfaces.tui.parts import ALARM, Banner, Knobs, Picture, Tabs

PAGES = ("Fly", "Control", "Links", "Config", "Log")
"""The names of the pages; their keys are 1 to 5."""


class Frame(msgspec.Struct, frozen=True):
    """What is drawn at one instant."""

    picture: Picture
    now_s: float
    """On the event loop's clock [s]."""
    stale: bool
    """True where the newest snapshot is no longer true."""
    again: bool
    """True where a kill waits for its second press."""
    whose: str
    """Vehicle and time."""
    holder: str
    """Who holds control, or where a recording is."""


class Page(Screen[None]):
    """One page. It is told what to draw; a page that is not seen is not."""

    NAME: ClassVar[str]
    DEFAULT_CSS = """
    Page.alarm { background: $alarm-dim; }
    Page.tall Knobs { height: 3; }
    Page.tall Knob { height: 3; }
    .wide-only { display: none; }
    Page.-wide .wide-only { display: block; }
    """

    def __init__(self, *, orders: bool, more: tuple[tuple[str, str, str], ...]) -> None:
        """``orders``: whether anything can be ordered here; ``more``: what else there is a key for (bars.Tabs)."""
        super().__init__()
        self._orders, self._more = orders, more
        self._drawn: tuple[int, bool] = (-1, False)

    def compose(self) -> ComposeResult:
        """From top to bottom."""
        yield Banner()
        yield from self.matter()
        if self._orders:
            yield Knobs()
        yield Tabs(PAGES, self.NAME, self._more)

    def matter(self) -> ComposeResult:
        """The middle."""
        raise NotImplementedError

    def draw(self, frame: Frame) -> None:
        """Draw what is new in the middle."""
        raise NotImplementedError

    def show(self, frame: Frame) -> None:
        """Draw what is new."""
        picture = frame.picture
        headline = picture.headline(frame.now_s)
        self.query_one(Banner).show(headline, frame.whose, frame.holder)
        self.set_class(headline.tone == ALARM, "alarm")
        for knobs in self.query(Knobs):
            knobs.show(None if picture.newest is None else picture.newest.state, frame.again)
        if (picture.count, frame.stale) != self._drawn:
            self._drawn = (picture.count, frame.stale)
            self.draw(frame)

    def on_screen_resume(self) -> None:
        """It is seen again: all of it is new."""
        self._drawn = (-1, False)
