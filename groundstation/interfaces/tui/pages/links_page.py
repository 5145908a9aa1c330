"""The page of what comes in and goes out: poses, the command link, and how old and how late things are."""

import math
from collections.abc import Iterable, Sequence
from typing import ClassVar

from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import Static

from groundstation.core.messages import Snapshot
from groundstation.interfaces.tui.pages.page import Frame, Page
from groundstation.interfaces.tui.parts import ERROR, FLOWN, LABEL, Curves, Spans, bar, battery, content, row
from links.core import printable

BINS = 8


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

    def draw(self, frame: Frame) -> None:
        """All of it."""
        picture = frame.picture
        if picture.newest is None:
            return
        ages = [1e3 * one.pose_age_s for one in picture.flown]
        late = [1e3 * one.latency_s for one in picture.flown]
        for name, rows in (("pose", poses(picture.newest, ages)), ("link", link(picture.newest))):
            part = self.query_one(f"#{name}", Static)
            part.update(content(rows, max(1, part.size.width)))
        age, latency = self.query(Curves)
        age.show([ages])
        latency.show([late])


def poses(snapshot: Snapshot, ages_ms: Sequence[float]) -> list[Spans]:
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
        *histogram(ages_ms),
    ]


def link(snapshot: Snapshot) -> list[Spans]:
    """State, counters and clocks of the command link, and how late frames left."""
    status = snapshot.link
    trip = "not known" if status.rtt_s is None else f"{1e3 * status.rtt_s:.2f} ms (shortest lately)"
    clock = "not known" if status.offset_s is None else f"{status.offset_s:+.3f} s ahead of ours"
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
        *late(snapshot),
    ]


def late(snapshot: Snapshot) -> list[Spans]:
    """How late commands left, after their frame or their pose."""
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


def histogram(values: Iterable[float]) -> list[Spans]:
    """How often values lay where, in at most eight steps of a round width."""
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
