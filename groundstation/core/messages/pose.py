"""Pose: the record that every pose source delivers, the port that it implements, and the sightings
of other bodies.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Iterable
from typing import ClassVar, NamedTuple, Protocol, TypeAlias, runtime_checkable

import msgspec

from groundstation.core.geometry import Quat, Vec3
from links.text import Sentence

Excess: TypeAlias = tuple[float, float]
"""Value and limit, in the limit's unit."""


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
    excesses: dict[str, Excess] = {}
    """Value and limit of the newest drop by reason, in the limit's unit, where there is a limit."""
    rate_hz: float = 0.0
    """Poses per second by the source's own stamps [1/s]; 0 before the second pose."""
    latency_s: float = 0.0
    """Mean time from the instant of a pose to its arrival here, over about fifty poses [s]."""
    latency_max_s: float = 0.0
    """Longest of these times [s]."""
    drift: float = 0.0
    """Share by which the source's clock is slower than ours, or than its configured rate [-]."""
    gaps: int = 0
    """Number of gaps between two stamps."""
    clock_steps: int = 0
    """Number of forward steps of the source's clock."""
    clock_restarts: int = 0
    """Number of restarts of the source's clock."""
    late_s: float = 0.0
    """Lasting rise of the latency above its least value [s]; 0 without one."""
    stamp_rate: float | None = None
    """Seconds by the source's stamps per second of our clock [-]; None where it is not known."""
    origin_moves: int = 0
    """Number of recent moves of the source's origin."""
    unsteady_clock: bool = False
    """Whether the source's clock steps again and again, so that the age of its poses is unknown."""
    advice: str = ""
    """Reason why no poses arrive, for the operator; empty without a finding."""


class SourceError(OSError):
    """A source can't be started; the text says why, and what to look at."""


class PoseKind(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"
):
    """Base of the configuration of every kind of pose source: traits of the kind.

    A kind overrides those in which it differs from the defaults here.
    """

    by_autopilot: ClassVar[bool] = False
    """Whether the poses are the autopilot's own estimate, received by the link."""
    shares_link: ClassVar[bool] = False
    """Whether the poses are an autopilot's own, or the message in which bridges send poses to
    autopilots."""
    shows_others: ClassVar[bool] = False
    """Whether the source shows other bodies, too."""
    is_relayed: ClassVar[bool] = False
    """Whether a relay can pass its datagrams on to several listening programs."""
    body_key: ClassVar[str] = ""
    """Configuration key that names the vehicle's body; empty for a source with a single body."""
    address_key: ClassVar[str] = ""
    """Configuration key of the address of listening or of the server; empty for a source without a
    socket."""
    stamp_field: ClassVar[str] = ""
    """The source's name for the field of its time stamp; empty where the sender can't set it
    wrong."""
    stamp_unit_s: ClassVar[float] = 1.0
    """Unit of that field [s]."""
    latency_key: ClassVar[str] = "latency_s"
    """Configuration key of the shortest time from the instant of a pose to its arrival."""

    @property
    def kind(self) -> str:
        """The name of the kind."""
        return str(self.__struct_config__.tag)

    @property
    def body_name(self) -> str:
        """The vehicle's body in the capture system; empty for a source with a single body."""
        return str(getattr(self, self.body_key)) if self.body_key else ""

    @property
    def body_id(self) -> str:
        """The body's name in the form in which flights on this machine compare it."""
        return self.body_name

    @property
    def address(self) -> str:
        """The address of listening or of the server; empty for a source without a socket."""
        return str(getattr(self, self.address_key)) if self.address_key else ""

    @property
    def stream(self) -> tuple[object, ...]:
        """Key of the camera stream, equal for all vehicles that it shows."""
        return (self.kind, self.address)

    @property
    def real(self) -> str | None:
        """The setting ("key = value") by which poses of a real vehicle may arrive.

        None if none can.
        """
        return f"kind = {self.kind}"

    @property
    def never_flies(self) -> tuple[str, Sentence] | None:
        """Configuration key and reason that forbid these poses to fly a vehicle.

        None if they may.
        """
        return None

    @property
    def rate_hz(self) -> float | None:
        """Configured rate of the poses [1/s]; None without one."""
        return None

    @property
    def latency_s(self) -> float | None:
        """Configured shortest time from the instant of a pose to its arrival [s].

        None where the source measures it.
        """
        return None


class PoseSource(Protocol):
    """Port of a pose source. ``start`` and ``close`` run on the event loop; neither blocks it."""

    @property
    def status(self) -> PoseStatus:
        """Present counters."""

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Begin to listen; ``deliver`` is called on the event loop for each pose, in order of
        arrival.

        Raises:
            SourceError: it can't.
        """

    async def close(self) -> None:
        """Stop listening; no pose is delivered afterwards."""


@runtime_checkable
class Distrusts(Protocol):
    """Port of a part that uses our poses beside the flight, such as the forwarder to the
    autopilot.
    """

    def distrust(self) -> None:
        """Stop using our poses for the rest of this flight: they have been found wrong."""


class OverheardSource:
    """A source that gives each pose to a second receiver before it delivers it."""

    def __init__(self, source: PoseSource, tap: Callable[[Pose], None]) -> None:
        """``tap`` is the second receiver."""
        self._source = source
        self._tap = tap

    @property
    def status(self) -> PoseStatus:
        """Present counters of the source."""
        return self._source.status

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Start the source."""

        def both(pose: Pose) -> None:
            self._tap(pose)
            deliver(pose)

        await self._source.start(both)

    async def close(self) -> None:
        """Close the source."""
        await self._source.close()


BASE_S = 0.1
"""Time over which a body's speed is measured [s]: noise of 1 mm gives 0.014 m/s, and the speed is
0.05 s old."""
SIGHTING_S = 0.5
"""Time for which a sighting counts [s]: for a body's place, for the prediction by its velocity, and
as the begin of a measured speed. A vehicle that brakes by 1 m/s² is 0.13 m off the prediction by
then."""
RESETS_S = 5.0
"""Time within which resets of the estimate behind the poses, or moves of a source's origin, are
counted [s]."""
FAR_M = 1e6
"""Largest coordinate of a plausible position [m]: an autopilot's origin may lie beyond the
horizon."""
BODIES_MAX = 64
"""Limit of the other bodies that are remembered [-]: it bounds memory, and no room has so many."""


class BodySighting(NamedTuple):
    """The newest sighting of a body."""

    time_s: float
    """Time of the sighting, on the event loop's clock [s]."""
    position_ned: Vec3
    """Position [m]."""
    velocity_ned: Vec3
    """Velocity [m/s]; zero within half of ``BASE_S`` of the first sighting."""

    def at(self, time_s: float) -> Vec3:
        """Position at ``time_s`` [s], with the speed kept."""
        dt = time_s - self.time_s
        (x, y, z), (u, v, w) = self.position_ned, self.velocity_ned
        return x + dt * u, y + dt * v, z + dt * w


class Others:
    """Sightings of the other bodies: those of the configured names, and before take-off all but the
    vehicle's own.
    """

    def __init__(self, names: Iterable[str], own: str | None = None) -> None:
        """Start without sightings.

        ``own`` is the vehicle's body; with None only the configured ``names`` count.
        """
        self.names = tuple(names)
        """Configured names."""
        self._recent: dict[str, deque[tuple[float, Vec3]]] = {name: deque() for name in self.names}
        """Newest times [s] and positions [m] by name, oldest first."""
        self._own = own
        self.every = own is not None
        """Whether bodies count whose names are not configured."""
        self.dropped: Counter[str] = Counter()
        """Number of dropped positions by reason: not_finite, absurd."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names that are configured or were sighted."""
        return tuple(self._recent)

    def __contains__(self, name: str) -> bool:
        """Whether sightings of ``name`` are to be given to :meth:`see`."""
        if name in self.names:
            return True
        return (
            self.every
            and name != self._own
            and (name in self._recent or len(self._recent) < BODIES_MAX)
        )

    def see(self, name: str, time_s: float, position_ned: Vec3) -> None:
        """Note that ``name`` was at ``position_ned`` [m] at ``time_s`` [s].

        Older than its newest is ignored.
        """
        recent = self._recent.setdefault(name, deque())
        x, y, z = position_ned
        if not math.isfinite(x + y + z + time_s):
            self.dropped["not_finite"] += 1
            return
        if max(abs(x), abs(y), abs(z)) > FAR_M:
            self.dropped["absurd"] += 1
            return
        if recent and not 0.0 < time_s - recent[-1][0] < SIGHTING_S:
            if time_s <= recent[-1][0]:
                return
            recent.clear()
        recent.append((time_s, position_ned))
        while len(recent) > 2 and recent[1][0] <= time_s - BASE_S:
            recent.popleft()

    def unseen(self, since_s: float) -> tuple[str, ...]:
        """Configured names without a sighting since ``since_s`` [s]."""
        return tuple(
            name
            for name in self.names
            if not self._recent[name] or self._recent[name][-1][0] < since_s
        )

    def sighting(self, name: str) -> BodySighting | None:
        """Newest sighting of ``name``; None without one."""
        recent = self._recent[name]
        if not recent:
            return None
        (first_s, (x0, y0, z0)), (last_s, (x, y, z)) = recent[0], recent[-1]
        dt = last_s - first_s
        if dt < 0.5 * BASE_S:
            return BodySighting(last_s, (x, y, z), (0.0, 0.0, 0.0))
        return BodySighting(last_s, (x, y, z), ((x - x0) / dt, (y - y0) / dt, (z - z0) / dt))
