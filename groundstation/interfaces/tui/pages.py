"""Pages of the dashboard: the state on top, each one's own matter in the middle, orders and the
other pages below.
"""

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import msgspec
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.message import Message
from textual.screen import Screen
from textual.widgets import DataTable, Footer, Static

from groundstation.core.messages import Snapshot
from groundstation.core.mission import ON_GROUND
from groundstation.interfaces.tui.drawing import (
    AXES,
    ERROR,
    FLOWN,
    LABEL,
    WANTED,
    WARNING,
    Spans,
    battery,
    row,
    three,
)
from groundstation.interfaces.tui.model import ALARM, GainRow, Picture
from groundstation.interfaces.tui.widgets import (
    Banner,
    Curves,
    Events,
    Knobs,
    Numbers,
    Preflight,
    TopView,
    event_row,
    join_rows,
)
from links.core import LinkStatus
from links.text import printable

PAGES = ("Fly", "Control", "Links", "Config", "Log")
"""The names of the pages; their keys are 1 to 5."""


class PageFrame(msgspec.Struct, frozen=True):
    """Data of one drawing."""

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
    """Holder of control, or the place in a recording."""


class Page(Screen[None]):
    """One page. It is told what to draw; a page that is not seen is not."""

    NAME: ClassVar[str]
    DEFAULT_CSS = """
    Page.alarm { background: $alarm-dim; }
    Page.tall Knob { height: 3; }
    Page #body { height: 1fr; }
    Page.-small #body { layout: vertical; overflow-y: auto; }
    Page.-small #body > Vertical { width: 1fr; height: auto; }
    Page.-small Curves { height: 3; }
    Page.-small DataTable { height: 8; }
    """

    def __init__(self, *, orders: bool) -> None:
        """``orders``: whether anything can be ordered here."""
        super().__init__()
        self._orders = orders
        self._drawn: tuple[int, bool] | None = None

    def compose(self) -> ComposeResult:
        """Yield the parts from top to bottom."""
        yield Banner()
        yield from self.matter()
        if self._orders:
            yield Knobs()
        yield Footer(compact=True, show_command_palette=False)

    def matter(self) -> ComposeResult:
        """The middle."""
        raise NotImplementedError

    def draw(self, frame: PageFrame) -> None:
        """Draw what is new in the middle."""
        raise NotImplementedError

    def show(self, frame: PageFrame) -> None:
        """Draw what is new."""
        picture = frame.picture
        headline = picture.headline(frame.now_s)
        self.query_one(Banner).show(headline, frame.whose, frame.holder)
        self.set_class(headline.tone == ALARM, "alarm")
        for knobs in self.query(Knobs):
            knobs.show(None if picture.newest is None else picture.newest.state, frame.again)
        drawn = picture.count, frame.stale
        if drawn != self._drawn:
            self.draw(frame)
            self._drawn = drawn


class FlyPage(Page):
    """Fly."""

    NAME = "Fly"
    DEFAULT_CSS = """
    FlyPage #left { width: 1fr; }
    FlyPage #middle { width: 1fr; padding: 0 0 0 1; }
    FlyPage #right { width: 46; padding: 0 0 0 1; }
    FlyPage.-small #body { layout: horizontal; }
    FlyPage.-small #body > #right { width: 46; }
    FlyPage #error { height: 4; }
    FlyPage.tall #error { height: 6; }
    FlyPage.tall Events { height: 8; }
    FlyPage Preflight, FlyPage.ground TopView, FlyPage.ground #error { display: none; }
    FlyPage.ground Preflight { display: block; }
    FlyPage #middle { display: none; }
    FlyPage.times #middle, FlyPage.-wide #middle { display: block; }
    FlyPage.times #left { display: none; }
    FlyPage.-wide #left { display: block; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [Binding("p", "plots", "plots")]

    def matter(self) -> ComposeResult:
        """Plots beside numbers, events below."""
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield Preflight()
                yield TopView()
                yield Curves("error", [("cm", ERROR)], 1.0, id="error")
            with Vertical(id="middle"):
                for name in ("north", "east", "height"):
                    yield Curves(f"{name} m", [("reference", WANTED), ("flown", FLOWN)], 0.1)
            with Vertical(id="right"):
                yield Numbers()
        yield Events()

    def draw(self, frame: PageFrame) -> None:
        """All of it."""
        picture = frame.picture
        snapshot = picture.newest
        if snapshot is None:
            return
        ended = bool(snapshot.checks) and snapshot.state not in ON_GROUND
        self.set_class(snapshot.state in ON_GROUND or ended, "ground")
        flown = picture.flown
        self.query_one(TopView).show(snapshot, flown)
        self.query_one("#error", Curves).show([[100.0 * one.error_m for one in flown]])
        for axis, plot in enumerate(self.query("#middle Curves").results(Curves)):
            plot.show(
                [
                    [one.reference_neh[axis] for one in flown],
                    [one.position_neh[axis] for one in flown],
                ]
            )
        self.query_one(Preflight).show(snapshot)
        self.query_one(Numbers).show(snapshot, frame.stale)
        self.query_one(Events).show(list(picture.events)[-40:])

    def action_plots(self) -> None:
        """Switch between what is left and the plots in time, where there is no room for both."""
        self.toggle_class("times")


class ControlPage(Page):
    """Control."""

    _shown: tuple[GainRow, ...] = ()

    class Chosen(Message):
        """A gain shall be changed."""

        def __init__(self, gain: GainRow) -> None:
            super().__init__()
            self.gain = gain

    NAME: ClassVar[str] = "Control"
    DEFAULT_CSS = """
    ControlPage #left { width: 1fr; padding: 0 1 0 0; }
    ControlPage #right { width: 34; }
    ControlPage #law { height: auto; }
    ControlPage DataTable { height: 1fr; }
    """

    def matter(self) -> ComposeResult:
        """Errors and V beside the gains."""
        with Horizontal(id="body"):
            with Vertical(id="left"):
                yield Static(id="law")
                errors = [("|z1| m", AXES[0]), ("|z2| m/s", AXES[1]), ("|z3| m/s²", AXES[2])]
                yield Curves("", errors, 0.01, id="errors")
                yield Curves("", [("V", ERROR)], 0.001, id="v")
            with Vertical(id="right"):
                table: DataTable[str] = DataTable(cursor_type="row", zebra_stripes=True)
                table.add_columns("gain", "now")
                yield table

    def draw(self, frame: PageFrame) -> None:
        """All of it."""
        picture = frame.picture
        if picture.newest is not None:
            self.query_one("#law", Static).update(join_rows(law_rows(picture.newest)))
            self._gains(picture.newest.gains)
        errors = [[one.errors[i] for one in picture.flown] for i in range(3)]
        self.query_one("#errors", Curves).show(errors)
        self.query_one("#v", Curves).show([[one.v for one in picture.flown]])

    def _gains(self, now: Mapping[str, float]) -> None:
        known = tuple(GainRow(key, value) for key, value in now.items())
        if known == self._shown:
            return
        self._shown = known
        table = self.query_one(DataTable)
        at = table.cursor_row
        table.clear()
        for gain in known:
            name = gain.key.removeprefix("controller.")
            table.add_row(Text(printable(name)), f"{gain.value:.4g}", key=gain.key)
        table.move_cursor(row=at)

    def on_data_table_row_selected(self, event: "DataTable.RowSelected") -> None:
        """Change this one."""
        self.post_message(
            self.Chosen(next(one for one in self._shown if one.key == event.row_key.value))
        )


def law_rows(snapshot: Snapshot) -> list[Spans]:
    """Errors, V with its terms, W, and what is promised of them."""
    d, seen = snapshot.diagnostics, snapshot.certificate
    if d is None:
        return [[("no control law runs", LABEL)]]
    rows: list[Spans] = [[("              north     east     down", LABEL)]]
    rows += [
        row(name, f"{three(z)} {unit}")
        for name, z, unit in (("z1", d.z1, "m"), ("z2", d.z2, "m/s"))
    ]
    rows += [row("z3", f"{three(d.z3)} m/s²"), row("u*", f"{three(d.u_star)} m/s²")]
    rows += [row("b̂ rate", f"{three(d.b_hat_dot)} m/s³")]
    v, w = d.v_terms, d.w_terms
    rows.append(row("V known", f"{d.v_known:.4g} = φ {v[0]:.3g} + Ω {v[1]:.3g} + z3 {v[2]:.3g}"))
    rows.append(row("W", f"{d.w:.4g} = σ {w[0]:.3g} + ρ {w[1]:.3g} + z3 {w[2]:.3g}"))
    if seen is None:
        return [*rows, row("bound", printable(d.certificate))]
    bad = seen.state == "violated"
    excess = f"{seen.state}!, {seen.excess:.3g} above its bound" if bad else seen.state
    rows.append(row("V", f"{seen.v:.4g}  {printable(excess)}", WARNING if bad else ""))
    if seen.violated_fraction >= 0.0:  # a recording does not tell
        shares = (
            f"{100.0 * share:.1f} %" for share in (seen.violated_fraction, seen.suspended_fraction)
        )
        rows.append(row("", "violated {}  suspended {} of the time".format(*shares)))
    fraction = (
        "-"
        if seen.b_hat_fraction is None
        else f"{100.0 * seen.b_hat_fraction:.0f} % of what it may be"
    )
    return [*rows, row("b̂", fraction), row("bound", printable(seen.bound))]


class LinksPage(Page):
    """Links."""

    NAME: ClassVar[str] = "Links"
    DEFAULT_CSS = """
    LinksPage Vertical { width: 1fr; padding: 0 1 0 0; }
    LinksPage Static { height: auto; }
    LinksPage Curves { min-height: 2; }
    """

    def matter(self) -> ComposeResult:
        """Poses on the left, the link on the right."""
        with Horizontal(id="body"):
            with Vertical(id="poses"):
                yield Static(id="pose")
                yield Curves("pose age", [("ms", FLOWN)], 10.0, id="age")
            with Vertical(id="links"):
                yield Static(id="link")
                yield Curves("latency", [("ms", ERROR)], 10.0, id="latency")

    def draw(self, frame: PageFrame) -> None:
        """All of it."""
        picture = frame.picture
        if picture.newest is None:
            return
        self.query_one("#pose", Static).update(join_rows(pose_rows(picture.newest)))
        self.query_one("#link", Static).update(join_rows(link_rows(picture.newest)))
        ages = [[1e3 * one.pose_age_s for one in picture.flown]]
        self.query_one("#age", Curves).show(ages)
        latencies = [[1e3 * one.latency_s for one in picture.flown]]
        self.query_one("#latency", Curves).show(latencies)


def pose_rows(snapshot: Snapshot) -> list[Spans]:
    """Rates, latency and counters of the poses."""
    newest = (
        "none yet"
        if snapshot.pose_id < 0
        else f"{snapshot.pose_id}, {1e3 * snapshot.pose_age_s:.0f} ms old"
    )
    mean, most = 1e3 * snapshot.pose_latency_s, 1e3 * snapshot.pose_latency_max_s
    return [
        [("─ poses ─", LABEL)],
        row("newest", newest),
        row("rate", f"{snapshot.pose_rate_hz:.0f} Hz"),
        row("latency", f"mean {mean:.1f} ms, longest {most:.1f} ms"),
        row("gaps", f"{snapshot.pose_gaps}   clock steps {snapshot.pose_clock_steps}"),
        *_drops(snapshot.poses_dropped),
    ]


def link_rows(snapshot: Snapshot) -> list[Spans]:
    """State, counters and clocks of the command link, and how late frames left."""
    status = snapshot.link
    trip = "not known" if status.rtt_s is None else f"{1e3 * status.rtt_s:.2f} ms (shortest lately)"
    ahead = status.offset_s
    clock = (
        "not known"
        if ahead is None
        else f"{abs(ahead):.3f} s {'behind' if ahead < 0.0 else 'ahead of'} ours"
    )
    return [
        [("─ command link ─", LABEL)],
        row(
            "state",
            f"{printable(status.state)}, {printable(status.phase)}"
            + (f", {printable(status.taken)}" * bool(status.taken)),
        ),
        row("sent", f"{status.sent}   expired {status.expired}"),
        row("received", f"{status.received}"),
        row("trip", trip),
        row("its clock", clock),
        row("battery", battery(status)),
        *_drops(status.dropped),
        row("says", printable(status.text) or "-"),
        row("late", _lateness(snapshot)),
        row("mode", printable(status.mode) or "not told"),
        row("attitude", _angles(status.angles_rad)),
        row("hears us", _uplink(status)),
    ]


def _angles(angles_rad: Sequence[float]) -> str:
    """As the vehicle itself believes that it lies."""
    if not angles_rad:
        return "not told"
    roll, pitch, yaw = (math.degrees(angle) for angle in angles_rad)
    return f"roll {roll:+.0f}°   pitch {pitch:+.0f}°   yaw {yaw:+.0f}° (its own north)"


def _uplink(status: LinkStatus) -> str:
    if status.uplink_share is None:
        return "not told"
    share = 100.0 * status.uplink_share
    return (
        f"{share:.0f} % of frames   {status.uplink_dbm} dBm   {status.uplink_snr_db} dB over noise"
    )


def _lateness(snapshot: Snapshot) -> str:
    """Delay of commands behind their frame or their pose."""
    if snapshot.late_us is None:
        return "not known"
    p50, p99, p999 = snapshot.late_us
    return f"50 % {p50} µs   99 % {p99} µs   99.9 % {p999} µs"


def _drops(dropped: dict[str, int]) -> list[Spans]:
    found = [(reason, count) for reason, count in dropped.items() if count]
    if not found:
        return [row("dropped", "none")]
    return [
        row("dropped" if i == 0 else "", f"{count} {printable(reason)}")
        for i, (reason, count) in enumerate(found)
    ]


class TextPage(Page):
    """Lines that can be scrolled."""

    DEFAULT_CSS = "TextPage VerticalScroll { height: 1fr; }"
    _shown: list[Spans] | None = None

    def matter(self) -> ComposeResult:
        """The text."""
        with VerticalScroll():
            yield Static(id="text")

    def on_mount(self) -> None:
        """Have the keys scroll it."""
        self.query_one(VerticalScroll).focus()

    def lines(self, picture: Picture) -> list[Spans]:
        """Return the page's lines."""
        raise NotImplementedError

    def draw(self, frame: PageFrame) -> None:
        """All of it, where it is not there already."""
        lines = self.lines(frame.picture)
        if lines != self._shown:
            self._shown = lines
            self.query_one("#text", Static).update(join_rows(lines))


class ConfigPage(TextPage):
    """Config."""

    NAME: ClassVar[str] = "Config"

    def lines(self, picture: Picture) -> list[Spans]:
        """As a file has it."""
        hello = picture.hello
        if hello is None or not hello.config:
            return [[("the configuration is not known", LABEL)]]
        head: Spans = [(printable(f"{hello.vehicle}: {hello.origin}"), LABEL)]
        return [head, *([(printable(line), "")] for line in hello.config.splitlines())]


class LogPage(TextPage):
    """Log."""

    NAME: ClassVar[str] = "Log"

    def on_mount(self) -> None:
        """Stay with the newest."""
        super().on_mount()
        self.query_one(VerticalScroll).anchor()

    def lines(self, picture: Picture) -> list[Spans]:
        """The newest last."""
        return [event_row(line) for line in picture.events] or [[("nothing was told yet", LABEL)]]
