"""Geofence and separation: planes and other vehicles to keep away from, and how far from each to
brake. Sans-IO.
"""

import math
from typing import Annotated, Literal, NamedTuple, TypeAlias

import msgspec

from groundstation.config import config_notice
from groundstation.core.geometry import FARTHEST_M, Coordinate, Vec3
from groundstation.core.messages import BODIES_MAX, MOST_POINTS, SIGHTING_S, Others

TRIANGLE = 3
"""Least number of corners [-]."""
LEAST_TURN_M2 = 1e-9
"""Least area, twice that of three corners in a row, of a convex polygon [m²]: rounding."""
Corner = tuple[Coordinate, Coordinate]
Length = Annotated[float, msgspec.Meta(ge=0.01, le=100.0)]
"""A distance of vehicles or an error [m]; more is in millimetres, and less is within the noise of a
flight."""


class _Braking(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Assumed braking."""

    braking_m_s2: Annotated[
        float,
        msgspec.Meta(
            ge=0.1,
            le=20.0,
            description="Assumed deceleration, of others too [m/s²]; a hold brakes with "
            "`takeoff.transit_m_s2`.",
        ),
    ] = 1.0
    reaction_s: Annotated[
        float, msgspec.Meta(ge=0.0, le=2.0, description="Assumed time before braking begins [s].")
    ] = 0.3

    def braking_m(self, speed_m_s: float) -> float:
        """Return the distance from ``speed_m_s`` to rest [m]."""
        return speed_m_s * self.reaction_s + 0.5 * speed_m_s * speed_m_s / self.braking_m_s2


class _Fence(_Braking, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """Settings of every fence."""

    height_m: Annotated[
        float,
        msgspec.Meta(
            ge=0.01,
            le=FARTHEST_M,
            description="Largest height above the floor, `flight.floor_z_m` [m].",
        ),
    ]


class BoxFence(_Fence, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="box"):
    """A box along north and east."""

    north_m: Annotated[Corner, msgspec.Meta(description="From south to north [m, NED].")]
    east_m: Annotated[Corner, msgspec.Meta(description="From west to east [m, NED].")]

    def __post_init__(self) -> None:
        if not (self.north_m[0] < self.north_m[1] and self.east_m[0] < self.east_m[1]):
            raise ValueError(config_notice("fence.order"))

    def corners(self) -> tuple[Corner, ...]:
        """Clockwise from above."""
        (south, north), (west, east) = self.north_m, self.east_m
        return ((south, west), (north, west), (north, east), (south, east))


class ConvexFence(_Fence, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="convex"):
    """An upright prism over a convex polygon."""

    corners_m: Annotated[
        tuple[Corner, ...],
        msgspec.Meta(
            min_length=TRIANGLE,
            max_length=MOST_POINTS,
            description="Corners, north and east [m, NED], one after the other, in either "
            "direction.",
        ),
    ]

    def __post_init__(self) -> None:
        turns = [
            _turn(*three) for three in zip(self._from(0), self._from(1), self._from(2), strict=True)
        ]
        if not (all(t > LEAST_TURN_M2 for t in turns) or all(t < -LEAST_TURN_M2 for t in turns)):
            raise ValueError(config_notice("fence.convex"))

    def corners(self) -> tuple[Corner, ...]:
        """Clockwise from above."""
        clockwise = _turn(*self.corners_m[:TRIANGLE]) > 0.0
        return self.corners_m if clockwise else self.corners_m[::-1]

    def _from(self, first: int) -> tuple[Corner, ...]:
        return self.corners_m[first:] + self.corners_m[:first]


FenceConfig: TypeAlias = BoxFence | ConvexFence
"""Any fence of the config section ``[fence]``, by its ``kind``. It has no default."""


def _turn(a: Corner, b: Corner, c: Corner) -> float:
    """Twice the area of a triangle [m²], above 0 where ``a``, ``b``, ``c`` are clockwise from
    above.
    """
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


class Plane(NamedTuple):
    """Half-space n · p <= limit."""

    n: Vec3
    """Unit vector outwards, NED."""
    limit: float
    """[m]"""


class Fence:
    """One fence above one floor."""

    def __init__(self, config: FenceConfig, floor_z_m: float) -> None:
        """Make the planes; the floor is none of them, as a landing ends there."""
        corners = config.corners()
        planes = [Plane((0.0, 0.0, -1.0), config.height_m - floor_z_m)]
        for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1], strict=True):
            length = math.hypot(u - x, v - y)
            n = ((v - y) / length, -(u - x) / length, 0.0)
            planes.append(Plane(n, n[0] * x + n[1] * y))
        self._planes = planes
        self._config = config

    def room_m(self, position: Vec3) -> float:
        """Distance to the nearest side [m]; below 0 outside."""
        x, y, z = position
        return min(limit - n[0] * x - n[1] * y - n[2] * z for n, limit in self._planes)

    def braking_room_m(self, position: Vec3, velocity: Vec3) -> float:
        """Distance that is left to the nearest side after braking towards it [m].

        Below 0 it must brake now.
        """
        (x, y, z), (u, v, w) = position, velocity
        least = math.inf
        for n, limit in self._planes:
            speed = max(n[0] * u + n[1] * v + n[2] * w, 0.0)
            least = min(
                least, limit - n[0] * x - n[1] * y - n[2] * z - self._config.braking_m(speed)
            )
        return least


class SeparationConfig(_Braking, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Other vehicles in the same room. Config section ``[separation]``; a fleet file fills in
    ``others`` itself.
    """

    others: Annotated[
        tuple[str, ...],
        msgspec.Meta(
            max_length=BODIES_MAX,
            description="Names of their objects in the capture system. None: no separation from "
            "anybody.",
        ),
    ] = ()
    distance_m: Annotated[
        Length, msgspec.Meta(description="Least distance between the vehicles' centres [m].")
    ] = 0.6
    stale_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.05,
            le=5.0,
            description="Time without a sighting after which another's position is unknown [s]: a "
            "warning.",
        ),
    ] = 0.3
    unknown: Annotated[
        Literal["warn", "hold", "land"],
        msgspec.Meta(description="Step that follows where it stays unknown."),
    ] = "hold"
    unknown_s: Annotated[
        float, msgspec.Meta(ge=0.0, le=60.0, description="Time until that step [s].")
    ] = 1.0


class Near(NamedTuple):
    """The other vehicle with the least distance left after braking."""

    name: str
    distance_m: float
    room_m: float
    """Distance beyond ``separation.distance_m`` left after both have braked [m]; below 0 they must
    brake now."""
    beneath: bool
    """Whether a landing would end on it."""


class Separation:
    """One vehicle's distance to the others. Times are on the event loop's clock [s]."""

    def __init__(self, config: SeparationConfig, others: Others) -> None:
        """``others`` is kept up to date by the pose source."""
        self.config = config
        self._others = others

    def unknown(self, now_s: float) -> tuple[str, ...]:
        """Names of the vehicles whose position is unknown."""
        return self._others.unseen(now_s - self.config.stale_s)

    def nearest(self, position: Vec3, velocity: Vec3, now_s: float) -> Near | None:
        """Find the one with the least room to a vehicle at ``position`` [m] with ``velocity``
        [m/s], both NED.

        One that is too near already comes before those that only might become so. Between sightings
        its velocity is assumed constant; None before the first sighting.
        """
        c, nearest, least = self.config, None, (True, math.inf)
        for name in self._others.names:
            sight = self._others.sighting(name)
            if sight is None:
                continue
            x, y, z = sight.at(min(now_s, sight.time_s + SIGHTING_S))
            away = (position[0] - x, position[1] - y, position[2] - z)
            distance = math.hypot(*away)
            room = distance - c.distance_m
            for speed in (
                -_along(away, distance, velocity),
                _along(away, distance, sight.velocity_ned),
            ):
                if not speed <= 0.0:
                    room -= c.braking_m(speed)
            rank = distance >= c.distance_m, room
            if not rank >= least:
                beneath = math.hypot(away[0], away[1]) < c.distance_m and away[2] < 0.0
                nearest, least = Near(name, distance, room, beneath), rank
        return nearest


def _along(away: Vec3, distance: float, velocity: Vec3) -> float:
    """Speed along ``away`` [m/s]; all of it where both are at the same position."""
    if distance == 0.0:
        return math.hypot(*velocity)
    return (away[0] * velocity[0] + away[1] * velocity[1] + away[2] * velocity[2]) / distance
