"""The page to fly by: where it is and should be, all numbers, and before take-off what stands in its way."""

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical

from groundstation.core.mission import ON_GROUND
from groundstation.interfaces.tui.pages.page import Frame, Page
from groundstation.interfaces.tui.parts import ErrorHistory, Events, Horizon, InTime, Numbers, Preflight, TopView

_GROUND = frozenset(state.value for state in ON_GROUND)


class FlyPage(Page):
    """Fly."""

    NAME = "Fly"
    DEFAULT_CSS = """
    FlyPage #body { height: 1fr; }
    FlyPage #left { width: 1fr; }
    FlyPage #middle { width: 1fr; padding: 0 0 0 1; }
    FlyPage #right { width: 46; padding: 0 0 0 1; }
    FlyPage Numbers { height: 16; }
    FlyPage.tall Events { height: 8; }
    FlyPage.tall ErrorHistory { height: 5; }
    FlyPage Horizon { display: none; }
    FlyPage.tall Horizon { display: block; height: 1fr; max-height: 12; }
    FlyPage Preflight, FlyPage.ground TopView, FlyPage.ground ErrorHistory { display: none; }
    FlyPage.ground Preflight { display: block; }
    FlyPage.-narrow.ground #right { display: none; }
    FlyPage.-narrow.ground.times #right { display: block; }
    FlyPage #left InTime { display: none; }
    FlyPage.-narrow.times.air #left InTime { display: block; }
    FlyPage.-narrow.times.air #left TopView { display: none; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("p", "plots", "other plots")]

    def matter(self) -> ComposeResult:
        """Plots beside numbers, events below."""
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield Preflight()
                yield TopView()
                yield InTime()
                yield ErrorHistory()
            with Vertical(id="middle", classes="wide-only"):
                yield InTime()
            with Vertical(id="right"):
                yield Numbers()
                yield Horizon()
        yield Events()

    def draw(self, frame: Frame) -> None:
        """All of it."""
        picture = frame.picture
        snapshot = picture.newest
        if snapshot is None:
            return
        ended = bool(snapshot.checks) and snapshot.state not in _GROUND
        ground = snapshot.state in _GROUND or ended
        self.set_class(ground, "ground")
        self.set_class(not ground, "air")
        for plot in (*self.query(TopView), *self.query(InTime), *self.query(ErrorHistory)):
            plot.show(snapshot, picture.flown)
        for part in (*self.query(Preflight), *self.query(Horizon)):
            part.show(snapshot)
        self.query_one(Numbers).show(snapshot, frame.stale)
        self.query_one(Events).show(list(picture.events)[-40:])

    def action_plots(self) -> None:
        """From above, or in time; before take-off the list, or all numbers: a narrow screen has room for one."""
        self.toggle_class("times")
