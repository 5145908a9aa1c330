"""Reference and trajectory: where the vehicle should be at any instant, and the ranges of the
numbers in their configs.

The ranges of the numbers also keep out inf and nan.
"""

from collections.abc import Sequence
from typing import Annotated, Protocol, TypeAlias

import msgspec

from groundstation.core.geometry import FARTHEST_M, ZERO, Coordinate, Vec3


class Reference(msgspec.Struct, frozen=True, gc=False):
    """Where the vehicle should be at one instant.

    World NED; derivatives are exact, never differences.
    """

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
        """Time after which the reference is at rest at its last point [s].

        None where it never ends.
        """

    @property
    def joints_s(self) -> Sequence[float]:
        """Times at which one formula takes over from another [s], rising, from 0 to its end or to
        one whole turn.

        Everything that it ever does it has done by the last of them.
        """

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start of the trajectory [s].

        Every finite time has one. Before the start (``time_s`` < 0) a curve without end goes on
        backwards, and a way between two points rests at its first.
        """

    def position_at(self, time_s: float) -> Vec3:
        """``at(time_s).position_ned`` [m], world NED, to rounding.

        Cheaper where only the position is wanted.
        """


class PeriodicTrajectory(Trajectory, Protocol):
    """A trajectory that goes round and round."""

    @property
    def period_s(self) -> float:
        """Time of one turn at full speed [s]."""


class Positioned:
    """Base of a trajectory whose position costs as much as the whole reference."""

    def position_at(self: "Trajectory", time_s: float) -> Vec3:
        """Position [m], world NED."""
        return self.at(time_s).position_ned


class Endless:
    """Base of a closed curve at full speed, which never ends."""

    duration_s: float | None = None
    """None: it never ends."""
    period_s: float
    """Time of one turn [s]."""

    @property
    def joints_s(self) -> tuple[float, float]:
        """One turn [s]."""
        return (0.0, self.period_s)


Point: TypeAlias = tuple[Coordinate, Coordinate, Coordinate]
"""A point [m], world NED: north, east, down."""
Length: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=FARTHEST_M)]
"""A length [m], at least a millimetre."""
SLOWEST_M_S = 0.001
"""Slowest speed along a course [m/s]: what is slower has its times in milliseconds."""
FASTEST_M_S = 50.0
"""Fastest speed along a course [m/s]: what is faster is in millimetres."""
Speed: TypeAlias = Annotated[float, msgspec.Meta(ge=SLOWEST_M_S, le=FASTEST_M_S)]
"""A speed [m/s], at least a millimetre a second."""
SpeedPart = Annotated[float, msgspec.Meta(ge=-FASTEST_M_S, le=FASTEST_M_S)]
Velocity: TypeAlias = tuple[SpeedPart, SpeedPart, SpeedPart]
"""A velocity [m/s], world NED: north, east, down."""
Degrees: TypeAlias = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]
"""An angle [deg]."""
Acceleration: TypeAlias = Annotated[float, msgspec.Meta(ge=0.001, le=50.0)]
"""An acceleration [m/s²]."""
Ramp: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=600.0)]
"""Time to reach full speed, and to stop [s]."""
LATEST_S = 1e10
"""Largest time stamp [s]: clocks that count from 1970 are near 1.8e9, and 1000 times that in
milliseconds."""
Moment: TypeAlias = Annotated[float, msgspec.Meta(ge=-LATEST_S, le=LATEST_S)]
"""A time stamp [s], from wherever its clock counts."""


LOOKED_AT_S = 60.0
"""A curve without an end is examined for this long before the flight [s]: from its beginning where
it gives no period, else beyond its first turn."""


def rest_there(reference: Reference) -> Reference:
    """Return a reference at rest at the place and heading of ``reference``."""
    return Reference(reference.position_ned, yaw_rad=reference.yaw_rad)
