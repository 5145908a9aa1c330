"""The room that a flight must stay in: planes, and how far from each it must begin to brake. Sans-IO."""

import math
from typing import Annotated, NamedTuple, TypeAlias

import msgspec

from groundstation.core.geometry import Vec3

Metres = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
Corner = tuple[Metres, Metres]


class _Fence(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind"):
    """What every fence has."""

    height_m: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)]
    """Greatest height above the floor, ``flight.floor_z_m`` [m]."""
    braking_m_s2: Annotated[float, msgspec.Meta(ge=0.1, le=20.0)] = 1.0
    """Deceleration that is counted on towards the fence [m/s²]; ``takeoff.transit_m_s2`` is what a hold brakes with."""
    reaction_s: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.3
    """Time that passes before it brakes [s]."""


class BoxFence(_Fence, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="box"):
    """A box along north and east."""

    north_m: Corner
    """From south to north [m, NED]."""
    east_m: Corner
    """From west to east [m, NED]."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: a side ends before it begins.
        """
        if not (self.north_m[0] < self.north_m[1] and self.east_m[0] < self.east_m[1]):
            raise ValueError("north_m and east_m: expected the smaller number first")

    def corners(self) -> tuple[Corner, ...]:
        """Clockwise from above."""
        (south, north), (west, east) = self.north_m, self.east_m
        return ((south, west), (north, west), (north, east), (south, east))


class ConvexFence(_Fence, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="convex"):
    """An upright prism over a convex polygon."""

    corners_m: Annotated[tuple[Corner, ...], msgspec.Meta(min_length=3, max_length=64)]
    """Its corners, north and east [m, NED], clockwise or not, one after the other."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: the polygon is not convex, or has no inside.
        """
        turns = [_turn(*three) for three in zip(self._from(0), self._from(1), self._from(2), strict=True)]
        if not (all(t > 1e-9 for t in turns) or all(t < -1e-9 for t in turns)):
            raise ValueError("corners_m: expected a convex polygon, its corners one after the other")

    def corners(self) -> tuple[Corner, ...]:
        """Clockwise from above."""
        clockwise = _turn(*self.corners_m[:3]) > 0.0
        return self.corners_m if clockwise else self.corners_m[::-1]

    def _from(self, first: int) -> tuple[Corner, ...]:
        return self.corners_m[first:] + self.corners_m[:first]


FenceConfig: TypeAlias = BoxFence | ConvexFence
"""Any fence as the config section ``[fence]`` tells it, picked by its ``kind``. It has no default."""


def _turn(a: Corner, b: Corner, c: Corner) -> float:
    """Above 0 where the way from ``a`` over ``b`` to ``c`` turns right, seen from above."""
    return (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])


class Plane(NamedTuple):
    """Inside is n · p <= limit."""

    n: Vec3
    """Unit vector outwards, NED."""
    limit: float
    """[m]"""


class Fence:
    """One fence above one floor."""

    def __init__(self, config: FenceConfig, floor_z_m: float) -> None:
        """The floor itself is no side of it: a landing ends there."""
        corners = config.corners()
        planes = [Plane((0.0, 0.0, -1.0), config.height_m - floor_z_m)]
        for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1], strict=True):
            length = math.hypot(u - x, v - y)
            n = ((v - y) / length, -(u - x) / length, 0.0)
            planes.append(Plane(n, n[0] * x + n[1] * y))
        self._planes = planes
        self._braking = config.braking_m_s2
        self._reaction = config.reaction_s

    def room_m(self, position: Vec3) -> float:
        """Distance to the nearest side [m]; below 0 outside."""
        x, y, z = position
        return min(limit - n[0] * x - n[1] * y - n[2] * z for n, limit in self._planes)

    def braking_room_m(self, position: Vec3, velocity: Vec3) -> float:
        """What is left of that once it has braked [m], side by side; below 0 it must brake now."""
        (x, y, z), (u, v, w) = position, velocity
        least = math.inf
        for n, limit in self._planes:
            speed = max(n[0] * u + n[1] * v + n[2] * w, 0.0)
            way = speed * self._reaction + 0.5 * speed * speed / self._braking
            least = min(least, limit - n[0] * x - n[1] * y - n[2] * z - way)
        return least
