"""Trajectory: the reference at any instant with exact derivatives, the numbers that configs share, and a curve's pace.

The bounds of the numbers also keep out inf and nan.
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


class PeriodicTrajectory(Trajectory, Protocol):
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


class Paced:
    """Any curve flown from rest and to rest. See :class:`Trajectory` for ``at`` and ``position_at``.

    It is asked for another time, s(t), whose rate rises and falls smoothly.

        s˙ = w(t / ramp) on the way in, 1 between, w((duration - t) / ramp) on the way out,    w = x³ (10 - 15x + 6x²)

    w, w' and w'' vanish or vanish but for 1 at both ends: s is C³, and so is the position where the curve is. A ramp
    passes half of its own time on the curve: s = ramp x⁴ (5/2 - 3x + x²). With the curve's derivatives c', c'', c''' by
    its time:
        v = s˙ c'        a = s¨ c' + s˙² c''        j = s⃛ c' + 3 s˙ s¨ c'' + s˙³ c'''
    """

    __slots__ = ("_curve", "_end", "_length", "_ramp", "_start", "duration_s", "period_s")

    duration_s: float | None
    """It ends where ``length_s`` of the curve are flown; None where it does not."""
    period_s: float
    """One turn of the curve at full speed [s]; its whole length if it ends by itself."""

    def __init__(self, curve: Trajectory, ramp_s: float, length_s: float | None, period_s: float) -> None:
        """Fly ``length_s`` of the curve's own time (None: without end), with ramps of ``ramp_s`` > 0 [s].

        Raises:
            ValueError: both ramps together are longer than the way.
        """
        if length_s is not None and ramp_s > length_s:
            raise ValueError(f"ramp_s: expected at most {length_s:.3g} s, all there is to fly, got {ramp_s:g}")
        self._curve = curve
        self._ramp = ramp_s
        self._length = length_s
        self.duration_s = None if length_s is None else length_s + ramp_s
        self.period_s = period_s
        self._start = _resting(curve.at(0.0))
        self._end = self._start if length_s is None else _resting(curve.at(length_s))

    @property
    def joints_s(self) -> list[float]:
        """The ramps' ends and the curve's joints, all of it or the way in and one turn [s]."""
        if self.duration_s is None or self._length is None:
            return [0.0, self._ramp, self._ramp + self.period_s]
        inner = [self._when(s) for s in self._curve.joints_s if s < self._length]
        return sorted({0.0, self._ramp, *inner, self.duration_s - self._ramp, self.duration_s})

    def _when(self, length_s: float) -> float:
        """t with s(t) = ``length_s`` of a curve that ends [s]."""
        assert self.duration_s is not None and self._length is not None
        middle = length_s + 0.5 * self._ramp
        if self._ramp <= middle <= self.duration_s - self._ramp:
            return middle
        low, high = 0.0, self.duration_s
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._time(middle)[0] < length_s else (low, middle)
        return low

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        if time_s <= 0.0:
            return self._start.position_ned
        if self.duration_s is not None and time_s >= self.duration_s:
            return self._end.position_ned
        return self._curve.position_at(self._time(time_s)[0])

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        if time_s <= 0.0:
            return self._start
        if self.duration_s is not None and time_s >= self.duration_s:
            return self._end
        s, s1, s2, s3 = self._time(time_s)
        curve = self._curve.at(s)
        square, cross, cube = s1 * s1, 3.0 * s1 * s2, s1 * s1 * s1
        (a, b, c), (d, e, f), (g, h, i) = curve.velocity_ned, curve.acceleration_ned, curve.jerk_ned
        return Reference(
            curve.position_ned,
            (s1 * a, s1 * b, s1 * c),
            (s2 * a + square * d, s2 * b + square * e, s2 * c + square * f),
            (
                s3 * a + cross * d + cube * g,
                s3 * b + cross * e + cube * h,
                s3 * c + cross * f + cube * i,
            ),
            curve.yaw_rad,
            s1 * curve.yaw_rate_rad_s,
        )

    def _time(self, time_s: float) -> tuple[float, float, float, float]:
        """s(t) [s] and its first three derivatives, between start and end."""
        ramp = self._ramp
        left = None if self.duration_s is None else self.duration_s - time_s
        if time_s < ramp:
            return _ramp(time_s, ramp)
        if left is not None and self._length is not None and left < ramp:
            s, s1, s2, s3 = _ramp(left, ramp)
            return self._length - s, s1, -s2, s3
        return time_s - 0.5 * ramp, 1.0, 0.0, 0.0


def _ramp(time_s: float, ramp_s: float) -> tuple[float, float, float, float]:
    x = time_s / ramp_s
    y = 1.0 - x
    return (
        ramp_s * x * x * x * x * (2.5 - x * (3.0 - x)),
        x * x * x * (10.0 - x * (15.0 - 6.0 * x)),
        30.0 * x * x * y * y / ramp_s,
        60.0 * x * y * (1.0 - 2.0 * x) / (ramp_s * ramp_s),
    )


def _resting(reference: Reference) -> Reference:
    return Reference(reference.position_ned, yaw_rad=reference.yaw_rad)
