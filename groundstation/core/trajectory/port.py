"""Trajectory port: what every trajectory delivers, the reference at any instant with exact derivatives.

Here, too, are the kinds of number that the configs of several trajectories share. Their bounds also keep out inf and
nan.
"""

from collections.abc import Sequence
from typing import Annotated, Protocol, TypeAlias

import msgspec

from groundstation.core.geometry import Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)


class Reference(msgspec.Struct, frozen=True, gc=False):
    """Where the vehicle should be at one instant. World NED; derivatives are exact, never differences."""

    position_ned: Vec3
    """[m]"""
    velocity_ned: Vec3 = ZERO
    """[m/s]"""
    acceleration_ned: Vec3 = ZERO
    """[m/s²]"""
    jerk_ned: Vec3 = ZERO
    """[m/s³]"""
    yaw_rad: float = 0.0
    """Heading [rad], about down from north."""
    yaw_rate_rad_s: float = 0.0
    """[rad/s]"""


class Trajectory(Protocol):
    """A reference as a function of time."""

    @property
    def duration_s(self) -> float | None:
        """Time after which the reference rests at its last point [s]; None where it never ends."""
        ...

    @property
    def joints_s(self) -> Sequence[float]:
        """Times at which one formula takes over from another [s], rising, from 0 to its end or to one whole turn.

        Everything that it ever does it has done by the last of them.
        """
        ...

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start of the trajectory [s].

        Every finite time has one. Before the start (``time_s`` < 0) a curve without end goes on backwards, and a
        way between two points rests at its first.
        """
        ...

    def position_at(self, time_s: float) -> Vec3:
        """``at(time_s).position_ned`` [m], world NED, to rounding; cheaper where only the position is wanted."""
        ...


class Turning(Trajectory, Protocol):
    """A trajectory that goes round and round."""

    @property
    def period_s(self) -> float:
        """Time of one turn at full speed [s]."""
        ...


Coordinate: TypeAlias = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
"""A coordinate or a height [m], at most 1 km from the origin."""

Point: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
"""A point [m], world NED: north, east, down."""

Length: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=1000.0)]
"""A length [m], at least a millimetre."""

Speed: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=50.0)]
"""A speed [m/s], at least a millimetre a second."""

Degrees: TypeAlias = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]
"""An angle [deg]."""

Acceleration: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=50.0)]
"""An acceleration [m/s²]."""

Ramp: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=600.0)]
"""How long it takes to get up to speed, and to stop [s]."""

Moment: TypeAlias = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
"""A time stamp [s], from wherever its clock counts."""
