"""Pose: what every pose source delivers of the vehicle and of other bodies, and the port it implements."""

import math
from collections import Counter, deque
from collections.abc import Callable, Iterable
from typing import ClassVar, Literal, NamedTuple, Protocol, runtime_checkable

import msgspec

from groundstation.core.geometry import Quat, Vec3
from links.text import Sentence


class Pose(msgspec.Struct, frozen=True, gc=False):
    """One pose of the vehicle as its source measured it, in our frames and on our clock."""

    id: int
    """Running number of accepted poses of this source, from 0."""
    time_s: float
    """When the pose was true, on the event loop's clock [s]."""
    arrival_s: float
    """When its bytes reached us, on the event loop's clock [s]."""
    position_ned: Vec3
    """Position [m], world NED."""
    attitude: Quat
    """Unit quaternion w, x, y, z, body FRD to world NED."""
    velocity_ned: Vec3 | None = None
    """The source's own velocity [m/s], world NED, where it sends one."""
    reset_count: int = 0
    """Changes whenever the source moved its own origin or attitude (MAVLink reset_counter)."""


class PoseStatus(msgspec.Struct, frozen=True):
    """State of a source, for screens and telemetry."""

    accepted: int
    """Poses delivered."""
    dropped: dict[str, int]
    """Datagrams or records dropped, counted by reason."""
    rate_hz: float = 0.0
    """Poses per second by the source's own stamps [1/s]; 0 before the second pose."""
    latency_s: float = 0.0
    """Time from the instant of a pose to its arrival here, averaged over some fifty poses [s]."""
    latency_max_s: float = 0.0
    """The longest of them [s]."""
    drift: float = 0.0
    """Drift of the source's clock: slower than ours, or than its configured rate, by this share."""
    gaps: int = 0
    """Number of gaps between two stamps."""
    clock_steps: int = 0
    """Number of forward steps of the source's clock."""
    clock_restarts: int = 0
    """Number of restarts of the source's clock."""
    late_s: float = 0.0
    """Lasting delay of poses above their best [s]; 0 where there is none."""
    stamp_rate: float | None = None
    """Seconds that pass by the stamps in one second of ours [-]; None where it is not known."""
    origin_moves: int = 0
    """Number of times that the source moved its origin of late."""
    unsteady_clock: bool = False
    """Whether the source's clock steps again and again: it does not tell how old a pose is."""
    advice: str = ""
    """The source's finding why no poses come, for the operator; empty where there is none."""


class PoseEvent(msgspec.Struct, frozen=True):
    """Something about the poses that the operator and the safety rules should know."""

    kind: Literal[
        "dropping", "passed", "lost", "back", "late", "punctual", "unsteady", "steady", "reset", "moved", "strays"
    ]
    """``dropping`` begins and ``passed`` ends an outbreak; ``lost``: no pose for as long as commands may rest on one,
    ``back``: there is one again; ``late``: they come later than they did, ``punctual``: no longer; ``unsteady``:
    the source's clock steps again and again, ``steady``: no longer; ``reset``,
    ``moved``: poses are elsewhere, as the source said or did not say; ``strays``: two in a row were dropped that fit
    each other, and not those before."""
    reason: str
    """Reason of an outbreak of drops; else empty."""
    text: Sentence | None
    """For the operator; None where it is for the safety rules alone."""


class SourceError(OSError):
    """A source can't be started; the text says why, and what to look at."""


class PoseKind(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """Beside the configuration of a pose source: what is asked of it, with the answer of a kind that has none."""

    recorded: ClassVar[bool] = False
    """They play a recording: they must never fly a vehicle."""
    by_autopilot: ClassVar[bool] = False
    """They are the autopilot's own estimate, and come by the link."""
    shares_link: ClassVar[bool] = False
    """They are an autopilot's own, or such as bridges send to autopilots, too."""
    shows_others: ClassVar[bool] = False
    """Other bodies can be looked for."""
    is_relayed: ClassVar[bool] = False
    """Its datagrams can be handed on, each to several programs that listen."""
    body_key: ClassVar[str] = ""
    """The key that names the vehicle's body; empty where poses are of nothing else."""
    address_key: ClassVar[str] = ""
    """The key that says where poses come from, or come in; empty where no socket brings them."""
    stamp_field: ClassVar[str] = ""
    """Field of the source's time stamp, in its own words; empty where nobody can set it wrong."""
    stamp_unit_s: ClassVar[float] = 1.0
    """Unit of that field [s]."""
    latency_key: ClassVar[str] = "latency_s"
    """The key of the shortest time from the instant of a pose to its arrival."""

    @property
    def kind(self) -> str:
        """The name of the kind."""
        return str(self.__struct_config__.tag)

    @property
    def body_name(self) -> str:
        """The vehicle's body in the capture system; empty where poses are of nothing else."""
        return str(getattr(self, self.body_key)) if self.body_key else ""

    @property
    def body_id(self) -> str:
        """The body's name as other flights of this machine compare it."""
        return self.body_name

    @property
    def address(self) -> str:
        """Where poses come from, or come in; empty where no socket brings them."""
        return str(getattr(self, self.address_key)) if self.address_key else ""

    @property
    def stream(self) -> tuple[object, ...]:
        """Key of the camera stream, equal for all vehicles that it shows."""
        return (self.kind, self.address)

    @property
    def real(self) -> str | None:
        """The key by which real poses may come, and its value; None where all stays on this machine."""
        return f"kind = {self.kind}"

    @property
    def never_flies(self) -> tuple[str, str] | None:
        """The key by which these poses must never fly a vehicle, and why; None where they may."""
        if self.recorded:
            return "pose.kind", "a recording must not fly a vehicle; look at it with `groundstation replay`"
        return None

    @property
    def rate_hz(self) -> float | None:
        """Poses a second that it is told to expect [1/s]; None where nobody tells."""
        return None

    @property
    def latency_s(self) -> float | None:
        """Shortest time from the instant of a pose to its arrival, as told [s]; None where the source tells it."""
        return None


class PoseSource(Protocol):
    """Where poses come from. ``start`` and ``close`` run on the event loop; neither blocks it."""

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Begin to listen; ``deliver`` is called on the event loop for each pose, in order of arrival.

        Raises:
            SourceError: it can't.
        """

    async def close(self) -> None:
        """Stop listening; no pose is delivered afterwards."""


@runtime_checkable
class Distrusts(Protocol):
    """Whoever goes on by our poses beside the flight, and must stop where they have been found to be wrong."""

    def distrust(self) -> None:
        """Our poses are wrong: for the rest of this flight, nothing is to rest on them."""


class OverheardSource:
    """A source whose poses somebody else sees too, before they are delivered."""

    def __init__(self, source: PoseSource, hear: Callable[[Pose], None]) -> None:
        self._source = source
        self._hear = hear

    @property
    def status(self) -> PoseStatus:
        """The source's."""
        return self._source.status

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Start the source."""

        def both(pose: Pose) -> None:
            self._hear(pose)
            deliver(pose)

        await self._source.start(both)

    async def close(self) -> None:
        """Close the source."""
        await self._source.close()


BASE_S = 0.1
"""Speeds are measured over at least this time [s]."""
GAP_S = 0.5
"""Places further apart than this say nothing of the speed between them [s]."""
FAR_M = 1e6
"""Nothing is further from an origin than this; more is absurd [m]. An autopilot's may lie beyond the horizon."""
BODIES_MAX = 64
"""At most this many other bodies are remembered."""


class BodySighting(NamedTuple):
    """One body as it was seen last."""

    time_s: float
    """When it was there, on the event loop's clock [s]."""
    position_ned: Vec3
    """[m]"""
    velocity_ned: Vec3
    """[m/s]; zero where it has not been seen for long enough."""

    def at(self, time_s: float) -> Vec3:
        """Where it is at ``time_s`` [s] if it keeps its speed."""
        dt = time_s - self.time_s
        (x, y, z), (u, v, w) = self.position_ned, self.velocity_ned
        return x + dt * u, y + dt * v, z + dt * w


class Others:
    """The bodies whose names are looked for, beside the vehicle's own; before take-off, every one."""

    def __init__(self, names: Iterable[str], own: str | None = None) -> None:
        """None of them has been seen yet. With ``own``, the vehicle's, all bodies but that one count, too."""
        self.names = tuple(names)
        """Those that are looked for."""
        self._recent: dict[str, deque[tuple[float, Vec3]]] = {name: deque() for name in self.names}
        self._own = own
        self.every = own is not None
        """Whether bodies count that nobody looks for."""
        self.dropped: Counter[str] = Counter()
        """Places that were none, by reason: not_finite, absurd."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """All that were seen or are looked for."""
        return tuple(self._recent)

    def __contains__(self, name: str) -> bool:
        if not self.every or name in self.names:
            return name in self.names
        return name != self._own and (name in self._recent or len(self._recent) < BODIES_MAX)

    def see(self, name: str, time_s: float, position_ned: Vec3) -> None:
        """``name`` was at ``position_ned`` [m] at ``time_s`` [s]; what is not newer than the last is ignored."""
        recent = self._recent.setdefault(name, deque())
        x, y, z = position_ned
        if not math.isfinite(x + y + z + time_s):
            self.dropped["not_finite"] += 1
            return
        if max(abs(x), abs(y), abs(z)) > FAR_M:
            self.dropped["absurd"] += 1
            return
        if recent and not 0.0 < time_s - recent[-1][0] < GAP_S:
            if time_s <= recent[-1][0]:
                return
            recent.clear()
        recent.append((time_s, position_ned))
        while len(recent) > 2 and recent[1][0] <= time_s - BASE_S:
            recent.popleft()

    def unseen(self, since_s: float) -> tuple[str, ...]:
        """Those that have not been seen since ``since_s`` [s], or never."""
        recent = {name: self._recent[name] for name in self.names}
        return tuple(name for name, seen in recent.items() if not seen or not seen[-1][0] >= since_s)

    def sighting(self, name: str) -> BodySighting | None:
        """``name`` as it was seen last; None where it never was."""
        recent = self._recent[name]
        if not recent:
            return None
        (then, (x, y, z)), (now, (u, v, w)) = recent[0], recent[-1]
        dt = now - then
        if dt < 0.5 * BASE_S:
            return BodySighting(now, (u, v, w), (0.0, 0.0, 0.0))
        return BodySighting(now, (u, v, w), ((u - x) / dt, (v - y) / dt, (w - z) / dt))
