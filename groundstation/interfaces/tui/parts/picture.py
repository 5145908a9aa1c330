"""What a dashboard knows: the newest of everything, and what its plots remember. Knows no screen. Sans-IO."""

import math
from collections import deque
from typing import Any

import msgspec

from groundstation.config import toml
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Snapshot
from groundstation.core.mission import FINAL
from groundstation.interfaces.tui.parts.feed import Answer, Hello, Holder, Jump, News, Trouble
from groundstation.interfaces.tui.parts.headline import Headline, headline

KEPT = 600
"""Snapshots kept for the plots: two minutes at 5 Hz."""
EVENTS_KEPT = 2000
_ENDED = frozenset(state.value for state in FINAL)


class Flown(msgspec.Struct, frozen=True):
    """What the plots remember of a snapshot."""

    time_s: float
    position_ned: Vec3
    reference_ned: Vec3
    error_m: float
    errors: tuple[float, float, float]
    """|z1| [m], |z2| [m/s], |z3| [m/s²]; NaN where no law ran."""
    v: float
    """V; NaN where it is not known."""
    pose_age_s: float
    latency_s: float


class Picture:
    """Takes the news; screens read it."""

    def __init__(self, now_s: float) -> None:
        """Nothing is known; ``now_s``: the event loop's clock [s]."""
        self.newest: Snapshot | None = None
        self.arrived_s = now_s
        self.trouble = ""
        self.hello: Hello | None = None
        self.holder = Holder("", yours=False)
        self.flown: deque[Flown] = deque(maxlen=KEPT)
        self.events: deque[str] = deque(maxlen=EVENTS_KEPT)
        self.answer = Answer(done=True, says="")
        self.count = 0
        """How many news there were: a screen that has drawn this number needs no new drawing."""

    def take(self, news: News, now_s: float) -> None:
        """One more piece of news."""
        self.count += 1
        match news:
            case Snapshot():
                self._snapshot(news, now_s)
            case Hello():
                if self.hello is not None and news.origin != self.hello.origin:
                    self._begin_anew()
                self.hello = news
            case Holder():
                self.holder = news
            case Trouble(text):
                self.trouble, self.holder = text, Holder("", yours=False)
            case Jump():
                self._begin_anew()

    def headline(self, now_s: float) -> Headline:
        """What matters most now."""
        return headline(self.newest, now_s - self.arrived_s, self.trouble)

    def config(self) -> dict[str, Any]:
        """The configuration in force; empty where it is not known."""
        try:
            return toml(self.hello.config) if self.hello is not None else {}
        except ValueError:
            return {}

    def _begin_anew(self) -> None:
        """Another flight, or another time of it."""
        self.flown.clear()
        self.events.clear()

    def _snapshot(self, new: Snapshot, now_s: float) -> None:
        last = self.newest
        if last is not None and (new.vehicle != last.vehicle or new.time_s < last.time_s - 1.0):
            self._begin_anew()
        elif last is not None and last.state in _ENDED and new.state not in _ENDED:
            self.flown.clear()  # the next flight of a daemon
        self.newest, self.arrived_s, self.trouble = new, now_s, ""
        self.events.extend(fresh(self.events, new.events))
        law, seen = new.diagnostics, new.certificate
        self.flown.append(
            Flown(
                new.time_s,
                new.position_ned,
                new.reference_ned,
                new.error_m,
                (math.nan,) * 3 if law is None else (_norm(law.z1), _norm(law.z2), _norm(law.z3)),
                math.nan if seen is None else seen.v,
                new.pose_age_s if new.pose_id >= 0 else math.nan,
                new.pose_latency_s if new.pose_id >= 0 else math.nan,
            )
        )


def fresh(known: deque[str], told: tuple[str, ...]) -> tuple[str, ...]:
    """Those of ``told`` (the newest events, oldest first) that come after the last of ``known``."""
    if not known:
        return told
    last = known[-1]
    for i in reversed(range(len(told))):
        if told[i] == last:
            return told[i + 1 :]
    return told


def _norm(v: Vec3) -> float:
    return math.hypot(*v)
