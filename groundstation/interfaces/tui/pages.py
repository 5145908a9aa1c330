"""Pages of the dashboard: the state on top, each one's own matter in the middle, orders and the other pages below."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar

import msgspec
from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.content import Content
from textual.events import Resize
from textual.message import Message
from textual.screen import Screen
from textual.widgets import DataTable, Input, Static

from groundstation.core.messages import Snapshot
from groundstation.core.mission import ON_GROUND
from groundstation.interfaces.tui.drawing import (
    AXES,
    ERROR,
    FLOWN,
    LABEL,
    WARNING,
    Spans,
    bar,
    battery,
    fold,
    row,
    three,
)
from groundstation.interfaces.tui.model import ALARM, GainRow, Picture, gains
from groundstation.interfaces.tui.widgets import (
    Banner,
    Curves,
    ErrorHistory,
    Events,
    HorizonView,
    InTime,
    Knobs,
    Numbers,
    Preflight,
    Tabs,
    TopView,
    content,
    event_row,
)
from links.core import LinkStatus
from links.text import printable

PAGES = ("Fly", "Control", "Links", "Config", "Log")
"""The names of the pages; their keys are 1 to 5."""


SMALL = 72
"""Below it numbers and gains do not stand side by side [columns]."""


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


UNDRAWN: tuple[int, bool, tuple[int, ...]] = (-1, False, ())
"""Key of a page that must be drawn anew: count, stale, and the widths of its parts."""


class Page(Screen[None]):
    """One page. It is told what to draw; a page that is not seen is not."""

    NAME: ClassVar[str]
    DEFAULT_CSS = """
    Page.alarm { background: $alarm-dim; }
    Page.tall Knob { height: 3; }
    .wide-only { display: none; }
    Page.-wide .wide-only { display: block; }
    Page.small #body { layout: vertical; overflow-y: auto; }
    Page.small #body > Vertical { width: 1fr; height: auto; }
    Page.small Curves { height: 3; }
    Page.small DataTable { height: 8; }
    """

    def __init__(self, *, orders: bool, more: tuple[tuple[str, str, str], ...]) -> None:
        """``orders``: whether anything can be ordered here; ``more``: what else there is a key for (bars.Tabs)."""
        super().__init__()
        self._orders, self._more = orders, more
        self._drawn = UNDRAWN

    def compose(self) -> ComposeResult:
        """Yield the parts from top to bottom."""
        yield Banner()
        yield from self.matter()
        if self._orders:
            yield Knobs()
        yield Tabs(PAGES, self.NAME, self._more)

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
        # Text is folded to the width that its part has now: a page may be drawn before its new layout is.
        drawn = picture.count, frame.stale, tuple(part.size.width for part in self.query("*"))
        if drawn != self._drawn:
            self._drawn = drawn
            self.draw(frame)

    def on_resize(self, event: Resize) -> None:
        """Stack the parts where there is no room for them side by side."""
        self.set_class(event.size.width < SMALL and self.NAME != "Fly", "small")
        self._drawn = UNDRAWN

    def on_screen_resume(self) -> None:
        """Draw all anew once the page is in sight again."""
        self._drawn = UNDRAWN


class FlyPage(Page):
    """Fly."""

    NAME = "Fly"
    DEFAULT_CSS = """
    FlyPage #body { height: 1fr; }
    FlyPage #left { width: 1fr; }
    FlyPage #middle { width: 1fr; padding: 0 0 0 1; }
    FlyPage #right { width: 46; padding: 0 0 0 1; }
    FlyPage Numbers { height: 16; max-height: 100%; }
    FlyPage.tall Events { height: 8; }
    FlyPage.tall ErrorHistory { height: 5; }
    FlyPage HorizonView { display: none; }
    FlyPage.tall HorizonView { display: block; height: 1fr; max-height: 12; }
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
                yield HorizonView()
        yield Events()

    def draw(self, frame: PageFrame) -> None:
        """All of it."""
        picture = frame.picture
        snapshot = picture.newest
        if snapshot is None:
            return
        ended = bool(snapshot.checks) and snapshot.state not in ON_GROUND
        ground = snapshot.state in ON_GROUND or ended
        self.set_class(ground, "ground")
        self.set_class(not ground, "air")
        for plot in (*self.query(TopView), *self.query(InTime), *self.query(ErrorHistory)):
            plot.show(snapshot, picture.flown)
        for part in (*self.query(Preflight), *self.query(HorizonView)):
            part.show(snapshot)
        self.query_one(Numbers).show(snapshot, frame.stale)
        self.query_one(Events).show(list(picture.events)[-40:])

    def action_plots(self) -> None:
        """Switch plots from above and in time, or before take-off list and numbers."""
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
    ControlPage #body { height: 1fr; }
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
                yield Curves("", [("|z1| m", AXES[0]), ("|z2| m/s", AXES[1]), ("|z3| m/s²", AXES[2])], 0.01)
                yield Curves("", [("V", ERROR)], 0.001)
            with Vertical(id="right"):
                table: DataTable[str] = DataTable(cursor_type="row", zebra_stripes=True)
                table.add_columns("gain", "now", "begun with")
                yield table

    def draw(self, frame: PageFrame) -> None:
        """All of it."""
        picture = frame.picture
        if picture.newest is not None:
            self.query_one("#law", Static).update(
                whole(law_rows(picture.newest), self.query_one("#left").size.width - 1)
            )
            self._gains(picture.config(), picture.newest.gains)
        errors, v = self.query(Curves)
        errors.show([[one.errors[i] for one in picture.flown] for i in range(3)])
        v.show([[one.v for one in picture.flown]])

    def _gains(self, config: Mapping[str, object], now: Mapping[str, float]) -> None:
        known = gains(config, now)
        if tuple(known) == self._shown:
            return
        self._shown = tuple(known)
        table = self.query_one(DataTable)
        at = table.cursor_row
        table.clear()
        for gain in known:
            name = gain.key.removeprefix("controller.")
            table.add_row(Text(printable(name)), f"{gain.value:.4g}", f"{gain.begun:.4g}", key=gain.key)
        table.move_cursor(row=at)

    def on_data_table_row_selected(self, event: "DataTable.RowSelected") -> None:
        """Change this one."""
        self.post_message(self.Chosen(next(one for one in self._shown if one.key == event.row_key.value)))


def whole(rows: list[Spans], width: int) -> Content:
    """Rows of which nothing is cut off."""
    return content(fold(rows, max(1, width)), max(1, width))


def law_rows(snapshot: Snapshot) -> list[Spans]:
    """Errors, V with its terms, W, and what is promised of them."""
    d, seen = snapshot.diagnostics, snapshot.certificate
    if d is None:
        return [[("no control law runs", LABEL)]]
    rows: list[Spans] = [[("              north     east     down", LABEL)]]
    rows += [row(name, f"{three(z)} {unit}") for name, z, unit in (("z1", d.z1, "m"), ("z2", d.z2, "m/s"))]
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
        shares = (f"{100.0 * share:.1f} %" for share in (seen.violated_fraction, seen.suspended_fraction))
        rows.append(row("", "violated {}  suspended {} of the time".format(*shares)))
    fraction = "-" if seen.b_hat_fraction is None else f"{100.0 * seen.b_hat_fraction:.0f} % of what it may be"
    return [*rows, row("b̂", fraction), row("bound", printable(seen.bound))]


BINS = 8
"""Most steps of a histogram."""


class LinksPage(Page):
    """Links."""

    NAME: ClassVar[str] = "Links"
    DEFAULT_CSS = """
    LinksPage #body { height: 1fr; }
    LinksPage Vertical { width: 1fr; padding: 0 1 0 0; }
    LinksPage Static { height: auto; }
    LinksPage Curves { min-height: 2; }
    """

    def matter(self) -> ComposeResult:
        """Poses on the left, the link on the right."""
        with Horizontal(id="body"):
            with Vertical(id="poses"):
                yield Static(id="pose")
                yield Curves("pose age", [("ms", FLOWN)], 10.0)
            with Vertical(id="links"):
                yield Static(id="link")
                yield Curves("latency", [("ms", ERROR)], 10.0)

    def draw(self, frame: PageFrame) -> None:
        """All of it."""
        picture = frame.picture
        if picture.newest is None:
            return
        ages = [1e3 * one.pose_age_s for one in picture.flown]
        late = [1e3 * one.latency_s for one in picture.flown]
        for name, rows in (("pose", pose_rows(picture.newest, ages)), ("link", link_rows(picture.newest))):
            part = self.query_one(f"#{name}", Static)
            part.update(whole(rows, part.size.width))
        age, latency = self.query(Curves)
        age.show([ages])
        latency.show([late])


def pose_rows(snapshot: Snapshot, ages_ms: Sequence[float]) -> list[Spans]:
    """Rates, latency and counters of the poses, and their ages as seen here."""
    newest = "none yet" if snapshot.pose_id < 0 else f"{snapshot.pose_id}, {1e3 * snapshot.pose_age_s:.0f} ms old"
    mean, most = 1e3 * snapshot.pose_latency_s, 1e3 * snapshot.pose_latency_max_s
    return [
        [("─ poses ─", LABEL)],
        row("newest", newest),
        row("rate", f"{snapshot.pose_rate_hz:.0f} Hz"),
        row("latency", f"mean {mean:.1f} ms, longest {most:.1f} ms"),
        row("gaps", f"{snapshot.pose_gaps}   clock steps {snapshot.pose_clock_steps}"),
        *_drops(snapshot.poses_dropped),
        [("ages seen, ms", LABEL)],
        *histogram_rows(ages_ms),
    ]


def link_rows(snapshot: Snapshot) -> list[Spans]:
    """State, counters and clocks of the command link, and how late frames left."""
    status = snapshot.link
    trip = "not known" if status.rtt_s is None else f"{1e3 * status.rtt_s:.2f} ms (shortest lately)"
    ahead = status.offset_s
    clock = "not known" if ahead is None else f"{abs(ahead):.3f} s {'behind' if ahead < 0.0 else 'ahead of'} ours"
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
        *lateness_rows(snapshot),
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
    return f"{share:.0f} % of frames   {status.uplink_dbm} dBm   {status.uplink_snr_db} dB over noise"


def lateness_rows(snapshot: Snapshot) -> list[Spans]:
    """Show the delays of commands after their frame or their pose."""
    if snapshot.late_us is None:
        return [row("late", "not known")]
    p50, p99, p999 = snapshot.late_us
    counts = [(octave, count) for octave, count in enumerate(snapshot.late_octaves) if count]
    top = max((count for _, count in counts), default=1)
    return [
        row("late", f"50 % {p50} µs   99 % {p99} µs   99.9 % {p999} µs"),
        *(
            [(f"  <{_micros(2**octave):>8} ", LABEL), (bar(count, top, 10), FLOWN), (f" {count}", "")]
            for octave, count in counts[-BINS:]
        ),
    ]


def histogram_rows(values: Iterable[float]) -> list[Spans]:
    """Show a histogram of ``values`` in at most eight steps of a round width."""
    known = [value for value in values if math.isfinite(value)]
    if not known:
        return [[("-", LABEL)]]
    low, high = min(known), max(known)
    width = max(1.0, 10.0 ** math.floor(math.log10(max(high - low, 1.0))))
    width = next(step * width for step in (0.5, 1.0, 2.0, 5.0) if (high - low) / (step * width) <= BINS - 1)
    first = math.floor(low / width)
    counts = [0] * (math.floor(high / width) - first + 1)
    for value in known:
        counts[math.floor(value / width) - first] += 1
    top = max(counts)
    return [
        [(f"{(first + i) * width:6g}… ", LABEL), (bar(count, top, 16), FLOWN), (f" {count}", "")]
        for i, count in enumerate(counts)
    ]


def _drops(dropped: dict[str, int]) -> list[Spans]:
    found = [(reason, count) for reason, count in dropped.items() if count]
    if not found:
        return [row("dropped", "none")]
    return [row("dropped" if i == 0 else "", f"{count} {printable(reason)}") for i, (reason, count) in enumerate(found)]


def _micros(value: int) -> str:
    return f"{value} µs" if value < 1000 else f"{value / 1000:.3g} ms"


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

    def lines(self, frame: PageFrame) -> list[Spans]:
        """Return the page's lines without regard to the search."""
        raise NotImplementedError

    def draw(self, frame: PageFrame) -> None:
        """All of it, where it is not there already."""
        words = self.query_one(Input).value.lower().split()
        lines = [line for line in self.lines(frame) if _has("".join(text for text, _ in line), words)]
        key = (len(lines), lines[-1:], words, len(frame.picture.events))
        if key != self._shown:
            self._shown = key
            self.query_one("#text", Static).update(Content("\n").join([Content.assemble(*line) for line in lines]))

    def on_input_changed(self) -> None:
        """Draw it at the next occasion."""
        self._drawn = UNDRAWN

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
    HINT = "/ searches keys, values and what they mean"

    def lines(self, frame: PageFrame) -> list[Spans]:
        """Each key with its section, so that it can be found by both."""
        hello = frame.picture.hello
        if hello is None or not hello.config:
            return [[("the configuration is not known", LABEL)]]
        head: Spans = [(printable(f"{hello.vehicle}: {hello.origin}"), LABEL)]
        return [head, *config_rows(hello.config)]


class LogPage(TextPage):
    """Log."""

    NAME: ClassVar[str] = "Log"
    HINT = "/ searches the events"

    def on_mount(self) -> None:
        """Stay with the newest."""
        super().on_mount()
        self.query_one(VerticalScroll).anchor()

    def lines(self, frame: PageFrame) -> list[Spans]:
        """The newest last."""
        return [event_row(line) for line in frame.picture.events] or [[("nothing was told yet", LABEL)]]


def config_rows(config: str) -> Iterable[Spans]:
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
