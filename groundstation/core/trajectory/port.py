"""Trajectory: the reference at any instant with exact derivatives, the numbers that configs share, and transitions.

The bounds of the numbers also keep out inf and nan.

A transition is to stay at a point, to go straight to another, and to blend one motion into the next without a step.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple, Protocol, TypeAlias

import msgspec

from groundstation.config import config_notice
from groundstation.core.geometry import FARTHEST_M, ZERO, Coordinate, Vec3


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
        """Time after which the reference is at rest at its last point [s]; None where it never ends."""

    @property
    def joints_s(self) -> Sequence[float]:
        """Times at which one formula takes over from another [s], rising, from 0 to its end or to one whole turn.

        Everything that it ever does it has done by the last of them.
        """

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start of the trajectory [s].

        Every finite time has one. Before the start (``time_s`` < 0) a curve without end goes on backwards, and a
        way between two points rests at its first.
        """

    def position_at(self, time_s: float) -> Vec3:
        """``at(time_s).position_ned`` [m], world NED, to rounding; cheaper where only the position is wanted."""


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
"""Largest time stamp [s]: clocks that count from 1970 are near 1.8e9, and 1000 times that in milliseconds."""
Moment: TypeAlias = Annotated[float, msgspec.Meta(ge=-LATEST_S, le=LATEST_S)]
"""A time stamp [s], from wherever its clock counts."""


class Paced:
    """Any curve flown from rest and to rest. See :class:`Trajectory` for ``at`` and ``position_at``.

    It is evaluated at another time, s(t), whose rate rises and falls smoothly.

        s˙ = w(t / ramp) on the way in, 1 between, w((duration - t) / ramp) on the way out,    w = x³ (10 - 15x + 6x²)

    w, w' and w'' vanish or vanish but for 1 at both ends: s is C³, and so is the position where the curve is. A ramp
    passes half of its own time on the curve: s = ramp x⁴ (5/2 - 3x + x²). With the curve's derivatives c', c'', c''' by
    its time:
        v = s˙ c'        a = s¨ c' + s˙² c''        j = s⃛ c' + 3 s˙ s¨ c'' + s˙³ c'''
    """

    duration_s: float | None
    """Time at which ``length_s`` of the curve are flown [s]; None where it has no end."""
    period_s: float
    """One turn of the curve at full speed [s]; its whole length if it ends by itself."""

    def __init__(self, curve: Trajectory, ramp_s: float, length_s: float | None, period_s: float) -> None:
        """Fly ``length_s`` of the curve's own time (None: without end), with ramps of ``ramp_s`` > 0 [s].

        Raises:
            ValueError: both ramps together are longer than the way.
        """
        if length_s is not None and ramp_s > length_s:
            raise ValueError(config_notice("trajectory.ramp", length_s=length_s, ramp_s=ramp_s))
        self._curve = curve
        self._ramp = ramp_s
        self._length = length_s
        self.duration_s = None if length_s is None else length_s + ramp_s
        self.period_s = period_s
        self._start = rest_there(curve.at(0.0))
        self._end = self._start if length_s is None else rest_there(curve.at(length_s))

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


def rest_there(reference: Reference) -> Reference:
    """Place and heading of ``reference``, without motion."""
    return Reference(reference.position_ned, yaw_rad=reference.yaw_rad)


LOOKS = 24
"""Speed and acceleration are looked at so often along a blend: peaks between are a hundredth higher at most."""
LONGER = 1.08
"""Each next duration that is tried is longer by this factor; the first that keeps the limits is flown."""
TRIES = 30
"""Most steps of the search for a blend's duration."""
SPARE = 1.05
"""The limits are raised to this times what the ends themselves have, where that is more [-]."""
SWING = 1.15
"""As much faster, and so much more accelerated, than the motion that it meets may a stop or a run-in be [-]."""
QUICKER = 1.12
"""Each next duration of a stop that is tried is shorter by this factor: the gentlest is best, but one that lasts goes
on turning as the motion turned."""
LEAST_S = 0.4
"""No blend is shorter, so that rounding in its ends is no step [s]."""
_LOOKS_AT = tuple(i / LOOKS for i in range(LOOKS + 1))
"""Sampled shares of a blend's duration."""
Coefficients = tuple[float, float, float, float, float, float, float, float]


class Limits(NamedTuple):
    """Limits on the speed and acceleration of a blend."""

    speed_m_s: float
    acceleration_m_s2: float


def blend(start: Reference, end: Reference, limits: Limits) -> "Blend":
    """The shortest blend from ``start`` to ``end`` that keeps ``limits``, or the one that goes least beyond them.

    Where an end is faster itself, its own speed and acceleration, and a little more, are the limit. Between ends that
    move there may be none within them: go from rest to rest, and use :func:`stop` and :func:`run_in`.
    """
    speed = max(limits.speed_m_s, *(SPARE * math.hypot(*one.velocity_ned) for one in (start, end)))
    hardest = max(limits.acceleration_m_s2, *(SPARE * math.hypot(*one.acceleration_ned) for one in (start, end)))
    length = math.dist(start.position_ned, end.position_ned)
    turn = abs(math.remainder(end.yaw_rad - start.yaw_rad, math.tau))
    duration = max(LEAST_S, length / speed, 2.0 * turn)
    best, least = None, math.inf
    for _ in range(TRIES):
        way = Blend(start, end, duration)
        fastest, strongest = way.peaks()
        beyond = max(fastest / speed, strongest / hardest)
        if beyond < least:
            best, least = way, beyond
        if beyond <= 1.0:
            break
        duration *= LONGER
    assert best is not None, "the first one is better than none"
    return best


def stop(start: Reference, limits: Limits) -> "Blend":
    """Make the blend to rest along the dying motion; from rest to rest it stays."""
    return _dying(start, limits, 1.0)


def run_in(end: Reference, limits: Limits) -> "Blend":
    """Make the blend from rest into the motion ``end``: :func:`stop`, time-reversed."""
    return _dying(end, limits, -1.0)


def _dying(moving: Reference, limits: Limits, way: float) -> "Blend":
    """The blend between ``moving`` and rest, forwards (``way`` 1) or backwards in time (-1).

    Its speed is a polynomial of degree 5, which leads v T/2 + a T²/10 + j T³/120 far.
    """
    speed = max(math.hypot(*moving.velocity_ned), 1e-6)
    hardest = max(limits.acceleration_m_s2, SWING * math.hypot(*moving.acceleration_ned))
    duration = max(LEAST_S, 1.9 * speed / limits.acceleration_m_s2)
    best, least = None, math.inf
    while best is None or duration >= LEAST_S:
        parts = zip(moving.position_ned, moving.velocity_ned, moving.acceleration_ned, moving.jerk_ned, strict=True)
        h = way * duration
        north, east, down = (p + h * (v / 2.0 + h * (a / 10.0 + h * j / 120.0)) for p, v, a, j in parts)
        rest = Reference((north, east, down), yaw_rad=moving.yaw_rad + 0.5 * h * moving.yaw_rate_rad_s)
        one = Blend(moving, rest, duration) if way > 0.0 else Blend(rest, moving, duration)
        fastest, strongest = one.peaks()
        beyond = max(fastest / (SWING * speed), strongest / hardest)
        if beyond < least:
            best, least = one, beyond
        if beyond <= 1.0:
            break
        duration /= QUICKER
    assert best is not None, "the first one is better than none"
    return best


class Blend(Positioned):
    """Blend between two states of motion without a step. It stays in its end's motion.

    Each coordinate is the polynomial of degree 7 that meets position, velocity, acceleration and jerk at both ends, so
    what is joined by it is C³: thrust and body rates, which follow acceleration and jerk, have no step. With x = t/T:

        q(x) = c0 + c1 x + c2 x² + c3 x³ + c4 x⁴ + c5 x⁵ + c6 x⁶ + c7 x⁷

    c0 … c3 are the start's derivatives times Tᵏ/k!; c4 … c7 make up what is left to the end's.
    """

    duration_s: float

    def __init__(self, start: Reference, end: Reference, duration_s: float) -> None:
        """Blend in ``duration_s`` [s] > 0; the heading turns the shorter way."""
        self.duration_s = duration_s
        self._start, self._end = start, end
        ends = zip(
            start.position_ned, start.velocity_ned, start.acceleration_ned, start.jerk_ned,
            end.position_ned, end.velocity_ned, end.acceleration_ned, end.jerk_ned,
            strict=True,
        )  # fmt: skip
        self._parts = tuple(_coefficients(duration_s, *values) for values in ends)
        turn = math.remainder(end.yaw_rad - start.yaw_rad, math.tau)
        first, last = start.yaw_rate_rad_s, end.yaw_rate_rad_s
        self._yaw = _coefficients(duration_s, start.yaw_rad, first, 0.0, 0.0, start.yaw_rad + turn, last, 0.0, 0.0)

    @property
    def joints_s(self) -> tuple[float, float]:
        """Start and end [s]."""
        return (0.0, self.duration_s)

    def peaks(self) -> tuple[float, float]:
        """Largest speed [m/s] and acceleration [m/s²]. Looked for in flight, within a tick: about 0.1 ms."""
        speed = acceleration = 0.0
        for x in _LOOKS_AT:
            v = a = 0.0
            for _, c1, c2, c3, c4, c5, c6, c7 in self._parts:
                first = c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * (5 * c5 + x * (6 * c6 + x * 7 * c7)))))
                second = 2 * c2 + x * (6 * c3 + x * (12 * c4 + x * (20 * c5 + x * (30 * c6 + x * 42 * c7))))
                v, a = v + first * first, a + second * second
            speed, acceleration = max(speed, v), max(acceleration, a)
        h = self.duration_s
        return math.sqrt(speed) / h, math.sqrt(acceleration) / (h * h)

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]; straight on at the speed of its ends before and after."""
        if time_s <= 0.0:
            return _straight(self._start, time_s)
        if time_s >= self.duration_s:
            return _straight(self._end, time_s - self.duration_s)
        x, h = time_s / self.duration_s, self.duration_s
        (a, da, dda, ddda), (b, db, ddb, dddb), (c, dc, ddc, dddc) = (_derive(part, x, h) for part in self._parts)
        yaw, turning, _, _ = _derive(self._yaw, x, h)
        return Reference((a, b, c), (da, db, dc), (dda, ddb, ddc), (ddda, dddb, dddc), yaw, turning)


class Chain(Positioned):
    """Ways one after the other. Time counts from the start of the last, so that it is below 0 on all before."""

    def __init__(self, ways: Sequence[Blend], last: Trajectory) -> None:
        """Fly ``ways``, each to its end, then ``last``."""
        self._ways = tuple(ways)
        self._last = last
        self.before_s = sum(way.duration_s for way in ways)
        """Duration of the ways before the last one [s]."""

    @property
    def duration_s(self) -> float | None:
        """The last way's duration [s]."""
        return self._last.duration_s

    @property
    def joints_s(self) -> tuple[float, ...]:
        """Those of the last way [s]."""
        return tuple(self._last.joints_s)

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start of the last way [s]."""
        if time_s >= 0.0:
            return self._last.at(time_s)
        since = time_s + self.before_s
        for way in self._ways[:-1]:
            if since < way.duration_s:
                return way.at(since)
            since -= way.duration_s
        return self._ways[-1].at(since)


def _straight(end: Reference, time_s: float) -> Reference:
    (x, y, z), (a, b, c) = end.position_ned, end.velocity_ned
    return Reference((x + time_s * a, y + time_s * b, z + time_s * c), (a, b, c), yaw_rad=end.yaw_rad)


def _coefficients(
    h: float, p0: float, v0: float, a0: float, j0: float, p1: float, v1: float, a1: float, j1: float
) -> Coefficients:
    """c0 … c7 of the polynomial that has these derivatives at x = 0 and at x = 1, ``h`` [s] later."""
    c1, c2, c3 = v0 * h, a0 * h * h / 2.0, j0 * h * h * h / 6.0
    e0 = p1 - p0 - c1 - c2 - c3
    e1 = v1 * h - c1 - 2.0 * c2 - 3.0 * c3
    e2 = a1 * h * h - 2.0 * c2 - 6.0 * c3
    e3 = j1 * h * h * h - 6.0 * c3
    return (
        p0, c1, c2, c3,
        35.0 * e0 - 15.0 * e1 + 2.5 * e2 - e3 / 6.0,
        -84.0 * e0 + 39.0 * e1 - 7.0 * e2 + 0.5 * e3,
        70.0 * e0 - 34.0 * e1 + 6.5 * e2 - 0.5 * e3,
        -20.0 * e0 + 10.0 * e1 - 2.0 * e2 + e3 / 6.0,
    )  # fmt: skip


def evaluate(part: Coefficients, x: float) -> float:
    """Value of the polynomial at ``x``."""
    c0, c1, c2, c3, c4, c5, c6, c7 = part
    return c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * (c5 + x * (c6 + x * c7))))))


def differentiate(part: Coefficients, x: float) -> tuple[float, float, float]:
    """First three derivatives of the polynomial by ``x``."""
    _, c1, c2, c3, c4, c5, c6, c7 = part
    first = c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * (5 * c5 + x * (6 * c6 + x * 7 * c7)))))
    second = 2 * c2 + x * (6 * c3 + x * (12 * c4 + x * (20 * c5 + x * (30 * c6 + x * 42 * c7))))
    third = 6 * c3 + x * (24 * c4 + x * (60 * c5 + x * (120 * c6 + x * 210 * c7)))
    return first, second, third


def _derive(part: Coefficients, x: float, h: float) -> tuple[float, float, float, float]:
    """Value and three derivatives by time, of a polynomial that lasts ``h`` [s]."""
    first, second, third = differentiate(part, x)
    return evaluate(part, x), first / h, second / (h * h), third / (h * h * h)


class HoldConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="hold"):
    """A point to stay at."""

    position_ned: Annotated[
        Point, msgspec.Meta(description="The point [m], world NED; 1 m up is -1 in the third place.")
    ] = (0.0, 0.0, -1.0)
    yaw_deg: Annotated[Degrees, msgspec.Meta(description="Heading [deg], from north towards east.")] = 0.0

    def build(self) -> "Hold":
        """The trajectory of this config."""
        return Hold(self.position_ned, math.radians(self.yaw_deg))


class Hold:
    """One reference for all time. See the port for ``at`` and ``position_at``."""

    duration_s: float | None = None
    """None: a hold never ends."""
    joints_s = (0.0,)
    """Nothing ever happens."""

    def __init__(self, position_ned: Vec3, yaw_rad: float) -> None:
        self._reference = Reference(position_ned, yaw_rad=yaw_rad)

    def position_at(self, time_s: float) -> Vec3:
        """The point [m], world NED."""
        return self._reference.position_ned

    def at(self, time_s: float) -> Reference:
        """The reference at rest."""
        return self._reference
