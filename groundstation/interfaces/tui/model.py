"""Dashboard model: the port of its feeds, what it knows, what its banner says, and what may be
ordered. Sans-IO.
"""

import math
from collections import deque
from collections.abc import AsyncIterator
from typing import Protocol

import msgspec

from groundstation.config import parse_number
from groundstation.core.geometry import Vec3
from groundstation.core.messages import Ask, Notice, Reply, Sentence, Snapshot, notice
from groundstation.core.mission import ALARMING, EVENT_OF, FINAL, IN_AIR, REPEAT_S, TABLE, State
from groundstation.core.safety import RAMP_S, STEP_FACTOR
from groundstation.interfaces.api import Control, new_events


class FlightIdentity(msgspec.Struct, frozen=True):
    """Whom the dashboard looks at."""

    vehicle: str
    origin: str
    """Where the data come from, for the operator: ``process 1234, groundstation 0.1`` or the name
    of a recording."""
    config: str
    """The configuration in force, as TOML; empty where it is not known."""


class FeedTrouble(msgspec.Struct, frozen=True):
    """Why nothing comes just now."""

    text: str


class Jump(msgspec.Struct, frozen=True):
    """Break in a recording, wound forward or back."""


News = FlightIdentity | Snapshot | Control | FeedTrouble | Jump


NOBODY = Reply.of(False, notice("screen.recording"))
NO_HOLDER = Control(holder=None, yours=False)


class Feed(Protocol):
    """A running ground station, or a recording of one, which can't be asked for anything."""

    @property
    def live(self) -> bool:
        """True where something flies that can be asked for something."""
        return False

    def news(self) -> AsyncIterator[News]:
        """Everything that is to be shown, as it comes; it may end, but never raises.

        Iterated once.
        """

    async def ask(self, ask: Ask, why: str, vehicle: str = "") -> Reply:
        """Ask for ``ask`` now or never: what can't be said at once is not said later.

        Arming names the ``vehicle``.
        """
        del ask, why, vehicle
        return NOBODY

    async def control(self, *, take: bool) -> Reply:
        """Take control, or give it back."""
        del take
        return NOBODY

    async def set_gain(self, key: str, value: float) -> Reply:
        """Change a gain in flight."""
        del key, value
        return NOBODY


FRAME_S = 0.2
"""Time between two drawings of a screen, and between two snapshots of a recording [s]."""
SILENCE_S = 1.5
"""Without a snapshot for this long, what is on the screen is no longer true [s]."""
OLD_POSE_S = 0.2
"""A pose older than this, in the air, is worth an alarm [s]."""

ALARM, BUSY, CALM, FLYING = "alarm", "busy", "calm", "flying"
_TONES: dict[str, str] = {
    **dict.fromkeys(("hold", "tracking", "moving", "returning"), FLYING),
    **dict.fromkeys(("arming", "takeoff", "landing", "disarming"), BUSY),
    **dict.fromkeys(ALARMING, ALARM),
}


class BannerText(msgspec.Struct, frozen=True):
    """The banner's words."""

    big: str
    """One or two words, shown large."""
    tone: str
    """``alarm``, ``busy``, ``calm`` or ``flying``."""
    detail: str
    """A sentence for the operator."""


def headline(snapshot: Snapshot | None, silence_s: float, trouble: str) -> BannerText:
    """Choose the most important fact of now.

    Args:
        snapshot: The newest; None before the first.
        silence_s: Time since it came, or since the screen was opened [s].
        trouble: Why the status socket can't be read; empty while it can.
    """
    silent = silence_s > SILENCE_S
    if snapshot is None:
        return BannerText(
            "NO DATA", ALARM, f"since {silence_s:.0f} s: {trouble or 'attached, nothing came yet'}"
        )
    if silent and snapshot.state in FINAL:
        reason = f"{snapshot.reason}; ended {silence_s:.0f} s ago"
        return BannerText(_big(snapshot), _TONES.get(snapshot.state, CALM), reason)
    if silent:
        return BannerText(
            "NO DATA",
            ALARM,
            f"since {silence_s:.0f} s, it was {snapshot.state}. {trouble}".rstrip(),
        )
    if snapshot.link.phase == "bring_down":
        return BannerText("COMING DOWN", ALARM, snapshot.reason)
    if snapshot.state == "aborted":
        return BannerText("ABORTED", ALARM, snapshot.reason)
    if snapshot.link.state == "lost":
        return BannerText("LINK LOST", ALARM, f"while {snapshot.state}: {snapshot.reason}")
    if snapshot.state in IN_AIR and not snapshot.pose_age_s < OLD_POSE_S:
        return BannerText(
            "NO POSE",
            ALARM,
            f"for {snapshot.pose_age_s:.1f} s while {snapshot.state}: {snapshot.reason}",
        )
    return BannerText(_big(snapshot), _TONES.get(snapshot.state, CALM), snapshot.reason)


def _big(snapshot: Snapshot) -> str:
    return snapshot.state.replace("_", " ")


TWICE_S = 1.0
"""The second press that kills comes within this time of the first [s]."""


class OperatorOrder(msgspec.Struct, frozen=True):
    """One order."""

    ask: Ask
    key: str
    """Key as Textual calls it; empty: only by the palette."""
    label: str
    """Name on the screen, in capitals."""
    says: str
    """Effect, for the operator."""
    second_key: str = ""
    """Second key, for terminals in which something takes the first one."""
    always: bool = False
    """True where anyone attached may order it, at once, on every screen, dialog and text field."""
    tone: str = "go"
    """Its colours: ``go``, ``calm``, ``land``, ``abort`` or ``kill``."""
    everywhere: bool = False
    """True where it is asked of every flight of this user on this machine."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys as Textual calls them."""
        return tuple(key for key in (self.key, self.second_key) if key)

    @property
    def shown(self) -> str:
        """Keys as written on the screen; ×2: to be pressed twice."""
        shown = "/".join(
            key.upper().replace("CTRL+", "^") if "+" in key else key for key in self.keys
        )
        return f"{shown}×2" if self.ask is Ask.KILL else shown

    @property
    def action(self) -> str:
        """Textual's action that orders it."""
        return "land_all" if self.everywhere else f"order('{self.ask}')"


ORDERS = (
    OperatorOrder(
        Ask.ARM, "a", "ARM", "start the motors and take off; asks for the vehicle's name"
    ),
    OperatorOrder(Ask.TRACK, "t", "FLY", "leave the hold for the trajectory; asks once more"),
    OperatorOrder(Ask.HOLD, "h", "HOLD", "stop and stay there", tone="calm"),
    OperatorOrder(
        Ask.RETURN, "r", "RETURN", "fly back over the place of take-off and land there", tone="calm"
    ),
    OperatorOrder(
        Ask.LAND,
        "ctrl+l",
        "LAND",
        "land here; before take-off, end the flight",
        "ctrl+d",
        always=True,
        tone="land",
    ),
    OperatorOrder(
        Ask.LAND,
        "ctrl+a",
        "LAND ALL",
        "land every flight of yours on this machine, as groundstation stop-all does",
        "ctrl+e",
        always=True,
        tone="land",
        everywhere=True,
    ),
    OperatorOrder(
        Ask.ABORT,
        "ctrl+x",
        "ABORT",
        "commands stop; the link brings it down",
        "ctrl+r",
        always=True,
        tone="abort",
    ),
    OperatorOrder(
        Ask.KILL,
        "ctrl+k",
        "KILL",
        "motors off, also in the air: twice within 1 s",
        "ctrl+y",
        always=True,
        tone="kill",
    ),
    OperatorOrder(
        Ask.DESCEND,
        "",
        "DESCEND",
        "level and down by attitude and speed alone",
        always=True,
        tone="abort",
    ),
)
"""Orders of the screen.

No terminal multiplexer or serial terminal takes the second keys as delivered: GNU screen, picocom
and minicom take Ctrl-A, tmux Ctrl-B, Zellij Ctrl-B, G, H, N, O, P, Q, S and T, dvtm Ctrl-G, tio
Ctrl-T, docker Ctrl-P and Ctrl-Q, byobu the function keys. Ctrl-U, V and W are left out, too,
because people press them to edit a line.
"""
BY_ASK = {order.ask: order for order in ORDERS if not order.everywhere}
STOP_KEYS = frozenset(key for order in ORDERS if order.always for key in order.keys)
"""Keys that bring vehicles down, wherever they are pressed."""


def possible(order: OperatorOrder, state: str | None) -> bool:
    """Whether the mission's table has a move by it.

    From a state that is not known, everything may be tried.
    """
    if order.everywhere:
        return True
    try:
        known = State(state or "")
    except ValueError:
        return True
    return (known, EVENT_OF[order.ask]) in TABLE and (known not in FINAL or order.ask is Ask.KILL)


class Twice:
    """Keys that must be pressed twice.

    One that is held down repeats itself, which is no second press.
    """

    def __init__(self) -> None:
        self._first_s = self._newest_s = -math.inf
        self.is_held = False
        """Whether the newest press was the repetition of a key that is held down."""

    def press(self, now_s: float) -> bool:
        """Take one press; return whether it is the second in time.

        It counts if no repetition follows it.
        """
        second = self.waits(now_s)
        self.is_held = not second and now_s - self._newest_s < REPEAT_S
        self._first_s = -math.inf if second or self.is_held else now_s
        self._newest_s = now_s
        return second

    def waits(self, now_s: float) -> bool:
        """Whether one more press now would do it."""
        return now_s - self._first_s <= TWICE_S


class GainRow(msgspec.Struct, frozen=True):
    """One gain."""

    key: str
    """Dotted, as in the configuration."""
    value: float
    """As it is now."""

    def text(self) -> str:
        """For who is to change it."""
        least, most = self.value / STEP_FACTOR, self.value * STEP_FACTOR
        return str(notice("screen.gain", now=self.value, least=least, most=most, ramp_s=RAMP_S))

    def read(self, typed: str) -> float | Sentence:
        """The value that was typed, or why it can't be taken.

        Bounds are the ground station's to judge.
        """
        try:
            value = parse_number(typed)
        except ValueError:
            return notice("screen.no_number", typed=typed)
        return value if math.isfinite(value) else notice("screen.no_gain", typed=typed)


KEPT = 600
"""Snapshots kept for the plots, and events for the list [-]: two minutes at 5 Hz, and some screens
to scroll through."""


class PlotSample(msgspec.Struct, frozen=True):
    """Values of a snapshot for the plots."""

    time_s: float
    position_neh: Vec3
    """North, east and height above the floor [m]."""
    reference_neh: Vec3
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
        self.hello: FlightIdentity | None = None
        self.holder = NO_HOLDER
        self.flown: deque[PlotSample] = deque(maxlen=KEPT)
        self.events: deque[Notice] = deque(maxlen=KEPT)
        self.count = 0
        """Number of changes: a screen that has drawn this number needs no new drawing."""

    def take(self, news: News, now_s: float) -> None:
        """One more piece of news."""
        self.count += 1
        match news:
            case Snapshot():
                self._snapshot(news, now_s)
            case FlightIdentity():
                if self.hello is not None and news.origin != self.hello.origin:
                    self._begin_anew()
                self.hello = news
            case Control():
                self.holder = news
            case FeedTrouble(text):
                self.trouble, self.holder = text, NO_HOLDER
            case Jump():
                self._begin_anew()

    def headline(self, now_s: float) -> BannerText:
        """Choose the most important fact of now."""
        return headline(self.newest, now_s - self.arrived_s, self.trouble)

    def describe_holder(self) -> str:
        """Say who holds control; empty while no ground station answers."""
        if self.trouble:
            return ""
        if self.holder.yours:
            return str(notice("control.yours"))
        return str(
            notice("control.held", client=self.holder.holder)
            if self.holder.holder
            else notice("screen.control_free")
        )

    def _begin_anew(self) -> None:
        """Another flight, or another time of it."""
        self.flown.clear()
        self.events.clear()

    def _snapshot(self, new: Snapshot, now_s: float) -> None:
        last = self.newest
        if last is not None and (new.vehicle != last.vehicle or new.time_s < last.time_s - 1.0):
            self._begin_anew()
        elif last is not None and last.state in FINAL and new.state not in FINAL:
            self.flown.clear()  # the next flight of a daemon
        self.newest, self.arrived_s, self.trouble = new, now_s, ""
        self.events.extend(
            new_events(last.events if last is not None and self.events else (), new.events)
        )
        law, seen = new.diagnostics, new.certificate
        self.flown.append(
            PlotSample(
                new.time_s,
                _above_floor(new.position_ned, new.floor_z_m),
                _above_floor(new.reference_ned, new.floor_z_m),
                new.error_m,
                (math.nan,) * 3 if law is None else (_norm(law.z1), _norm(law.z2), _norm(law.z3)),
                math.nan if seen is None else seen.v,
                new.pose_age_s if new.pose_id >= 0 else math.nan,
                new.pose_latency_s if new.pose_id >= 0 else math.nan,
            )
        )


def _above_floor(place_ned: Vec3, floor_z_m: float) -> Vec3:
    """North, east and height."""
    north, east, down = place_ned
    return north, east, floor_z_m - down


def _norm(v: Vec3) -> float:
    return math.hypot(*v)
