"""A fleet in words: one row a vehicle, the banner above them, and all about one of them."""

import math
from collections import Counter
from collections.abc import Callable, Iterable
from typing import NamedTuple

from groundstation.interfaces.mqtt import Seen
from groundstation.interfaces.tui.parts import ALARM, BUSY, CALM, FLYING
from links.core import printable

COLUMNS = (("vehicle", 10), ("state", 14), ("pose", 7), ("error", 7), ("RMS", 7), ("batt", 6), ("link", 8), ("data", 6))
"""Heading and width of all columns but the last, which is the newest event."""
EVENT = "newest event"
TONES = (ALARM, FLYING, CALM, CALM)
"""By urgency."""
MARKS = ("!!", "▲ ", "· ", "  ")
"""The same for those who see no colours."""


class Row(NamedTuple):
    """One vehicle."""

    name: str
    urgency: int
    cells: tuple[str, ...]
    """As in :data:`CSV_COLUMNS`, and the newest event."""


def row(seen: Seen, now_s: float) -> Row:
    """What is known of it."""
    urgency = seen.urgency(now_s)
    state = MARKS[urgency] + seen.word(now_s)
    event = seen.events[-1].text if seen.events else ""
    shot = seen.snapshot
    if shot is None:
        return Row(seen.name, urgency, (seen.name, state, "-", "-", "-", "-", "-", "never", event))
    share, volts = shot.link.battery_share, shot.link.battery_v
    battery = f"{100.0 * share:.0f} %" if share is not None else f"{volts:.1f}V" if volts is not None else "-"
    if not event and shot.events:
        event = shot.events[-1].partition(" ")[2]
    metres = (_short(shot.error_m, "m"), _short(shot.rms_m, "m"))
    cells = (
        seen.name, state, _short(shot.pose_age_s, "s"), *metres, battery, shot.link.state[:7],
        _short(seen.age_s(now_s), "s"), event,
    )  # fmt: skip
    return Row(seen.name, urgency, tuple(map(printable, cells)))


def _number(value: float) -> float:
    """For sorting: what is not known comes last, and of the others the largest first."""
    return -value if math.isfinite(value) else math.inf


Key = Callable[[Seen, float], tuple[float, str]]
ORDERS: dict[str, Key] = {
    "what needs somebody": lambda seen, now: (seen.urgency(now), seen.name),
    "name": lambda seen, _: (0.0, seen.name),
    "error": lambda seen, _: (math.inf if seen.snapshot is None else _number(seen.snapshot.error_m), seen.name),
    "age of data": lambda seen, now: (_number(round(seen.age_s(now))), seen.name),
}
"""What the rows can be sorted by."""


def rows(fleet: Iterable[Seen], order: str, now_s: float) -> list[Row]:
    """All vehicles in that order."""
    key = ORDERS[order]
    return [row(seen, now_s) for seen in sorted(fleet, key=lambda seen: key(seen, now_s))]


class Headline(NamedTuple):
    """What is shown large."""

    big: str
    tone: str
    detail: str


def headline(shown: list[Row], trouble: str) -> Headline:
    """The worst, and how many of each; ``trouble`` is why the broker is not heard, empty where it is."""
    if trouble:
        return Headline("NO BROKER", ALARM, trouble)
    if not shown:
        return Headline("NO VEHICLE", BUSY, "none has published below this prefix yet")
    count = Counter(one.urgency for one in shown)
    words = ("ALARM", "FLYING", "ON GROUND", "OFFLINE")
    worst = min(count)
    detail = ", ".join(f"{count[i]} {words[i].lower()}" for i in sorted(count))
    return Headline(f"{count[worst]} {words[worst]}", TONES[worst], detail)


def details(seen: Seen, now_s: float) -> list[str]:
    """All about one vehicle, the most important first; its newest events last."""
    shot = seen.snapshot
    lines = [f"{seen.name}: {seen.word(now_s)}"]
    if shot is not None:
        lines[0] += f" - {shot.reason}" if shot.reason else ""
        at, to, speed = shot.position_ned, shot.reference_ned, shot.velocity_ned
        certificate = "none" if shot.certificate is None else shot.certificate.state
        lines += [
            f"at {_ned(at)}, to {_ned(to)} m NED, {math.hypot(*speed):.2f} m/s, "
            f"{max(shot.flight_time_s, 0.0):.0f} s on trajectory",
            f"thrust {shot.thrust_n:.2f} of {shot.thrust_max_n:.2f} N{', AT ITS LIMIT' if shot.saturated else ''}, "
            f"certificate {certificate}",
            f"poses {shot.pose_rate_hz:.0f} 1/s, {shot.pose_gaps} gaps; link sent {shot.link.sent}, "
            f"late {shot.link.expired}, says {shot.link.text or 'nothing'}",
        ]
    texts = [f"{one.time_s:9.1f} {one.text}" for one in seen.events]
    return [printable(line) for line in lines + (texts or list(shot.events if shot else ()))[::-1]]


def _short(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.2f}{unit}" if value < 9.995 else f"{value:.0f}{unit}"


def _ned(vector: tuple[float, float, float]) -> str:
    return "({:.2f} {:.2f} {:.2f})".format(*vector)
