"""Transitions: blends from one motion into another without a step, and chains of them before a
trajectory.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

from groundstation.core.geometry import add_scaled
from groundstation.core.trajectory.reference import Positioned, Reference, Trajectory

INTERVALS = 24
"""Intervals between the samples of a blend at which its peaks are searched [-]: true peaks are 1 %
higher at most."""
LENGTHENING = 1.08
"""Factor from one duration that is tried to the next [-]: a blend is at most 8 % longer than its
limits require."""
MOST_TRIES = 30
"""Largest number of durations that are tried [-]: the last is 9 times the first."""
END_MARGIN = 1.05
"""Limits of a blend whose ends are faster than the limits, as a multiple of its ends' motion [-]:
above 1, as no blend between two moving ends is nowhere faster than they are."""
OVERSHOOT = 1.15
"""Largest speed and acceleration of a stop or a run-in, as a multiple of the motion that it meets
[-]: a motion with jerk goes on accelerating for a moment."""
SHORTENING = 1.12
"""Factor from one duration of a stop that is tried to the next shorter one [-]: a long stop is
gentle, but continues the turn of its motion, and so goes beyond the limits."""
LEAST_S = 0.4
"""Shortest blend [s]: between ends that are equal but for rounding it makes no step of the jerk."""
Coefficients = tuple[float, float, float, float, float, float, float, float]


class Limits(NamedTuple):
    """Limits on the speed and acceleration of a blend."""

    speed_m_s: float
    acceleration_m_s2: float


def blend(start: Reference, end: Reference, limits: Limits) -> "Blend":
    """Find the shortest blend from ``start`` to ``end`` that keeps ``limits``, or the one that goes
    least beyond them.

    Where an end is faster itself, the limits are those of its motion, with ``END_MARGIN``. Between
    two moving ends there may be no blend within the limits: go from rest to rest, and use
    :func:`stop` and :func:`run_in`.
    """
    speed = max(
        limits.speed_m_s, *(END_MARGIN * math.hypot(*one.velocity_ned) for one in (start, end))
    )
    hardest = max(
        limits.acceleration_m_s2,
        *(END_MARGIN * math.hypot(*one.acceleration_ned) for one in (start, end)),
    )
    length = math.dist(start.position_ned, end.position_ned)
    turn = abs(math.remainder(end.yaw_rad - start.yaw_rad, math.tau))
    duration = max(LEAST_S, length / speed, 2.0 * turn)
    best, least = None, math.inf
    for _ in range(MOST_TRIES):
        way = Blend(start, end, duration)
        fastest, strongest = way.peaks()
        beyond = max(fastest / speed, strongest / hardest)
        if beyond < least:
            best, least = way, beyond
        if beyond <= 1.0:
            break
        duration *= LENGTHENING
    assert best is not None, "the first one is better than none"
    return best


def stop(start: Reference, limits: Limits) -> "Blend":
    """Return the blend from the motion ``start`` to rest; from rest it stays."""
    return _brake(start, limits, 1.0)


def run_in(end: Reference, limits: Limits) -> "Blend":
    """Return the blend from rest into the motion ``end``: :func:`stop`, time-reversed."""
    return _brake(end, limits, -1.0)


def _brake(moving: Reference, limits: Limits, way: float) -> "Blend":
    """Find the gentlest blend between ``moving`` and rest, forwards (``way`` 1) or backwards in
    time (-1).

    Its velocity is a polynomial of degree 5 from v, a and j to zeros in the time T: its
    displacement is v T/2 + a T²/10 + j T³/120, and its largest acceleration 15/8 v/T where a and j
    are 0.
    """
    speed = max(math.hypot(*moving.velocity_ned), 1e-6)
    hardest = max(limits.acceleration_m_s2, OVERSHOOT * math.hypot(*moving.acceleration_ned))
    duration = max(LEAST_S, 1.9 * speed / limits.acceleration_m_s2)  # a little over 15/8
    best, least = None, math.inf
    while best is None or duration >= LEAST_S:
        parts = zip(
            moving.position_ned,
            moving.velocity_ned,
            moving.acceleration_ned,
            moving.jerk_ned,
            strict=True,
        )
        h = way * duration
        north, east, down = (
            p + h * (v / 2.0 + h * (a / 10.0 + h * j / 120.0)) for p, v, a, j in parts
        )
        rest = Reference(
            (north, east, down), yaw_rad=moving.yaw_rad + 0.5 * h * moving.yaw_rate_rad_s
        )
        one = Blend(moving, rest, duration) if way > 0.0 else Blend(rest, moving, duration)
        fastest, strongest = one.peaks()
        beyond = max(fastest / (OVERSHOOT * speed), strongest / hardest)
        if beyond < least:
            best, least = one, beyond
        if beyond <= 1.0:
            break
        duration /= SHORTENING
    assert best is not None, "the first one is better than none"
    return best


class Blend(Positioned):
    """Blend between two motions without a step.

    Each coordinate is the polynomial of degree 7 that meets position, velocity, acceleration and
    jerk at both ends. The joined motion is C³, so thrust and body rates, which follow acceleration
    and jerk, have no step. With x = t/T:

        q(x) = c0 + c1 x + c2 x² + c3 x³ + c4 x⁴ + c5 x⁵ + c6 x⁶ + c7 x⁷

    c0 to c3 are the start's derivatives times Tᵏ/k!; c4 to c7 meet those of the end.
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
        self._yaw = _coefficients(
            duration_s, start.yaw_rad, first, 0.0, 0.0, start.yaw_rad + turn, last, 0.0, 0.0
        )

    @property
    def joints_s(self) -> tuple[float, float]:
        """Start and end [s]."""
        return (0.0, self.duration_s)

    def peaks(self) -> tuple[float, float]:
        """Largest speed [m/s] and acceleration [m/s²]."""
        speed = acceleration = 0.0
        for i in range(INTERVALS + 1):
            x = i / INTERVALS
            v = a = 0.0
            for part in self._parts:
                first, second, _ = differentiate(part, x)
                v, a = v + first * first, a + second * second
            speed, acceleration = max(speed, v), max(acceleration, a)
        h = self.duration_s
        return math.sqrt(speed) / h, math.sqrt(acceleration) / (h * h)

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s].

        Beyond its ends, straight on at their velocity.
        """
        if time_s <= 0.0:
            return _straight(self._start, time_s)
        if time_s >= self.duration_s:
            return _straight(self._end, time_s - self.duration_s)
        x, h = time_s / self.duration_s, self.duration_s
        (a, da, dda, ddda), (b, db, ddb, dddb), (c, dc, ddc, dddc) = (
            _derive(part, x, h) for part in self._parts
        )
        yaw, turning, _, _ = _derive(self._yaw, x, h)
        return Reference((a, b, c), (da, db, dc), (dda, ddb, ddc), (ddda, dddb, dddc), yaw, turning)


class Chain(Positioned):
    """Blends one after the other, then a trajectory, from whose start time counts: on the blends it
    is below 0.
    """

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
    """Continue the motion ``end`` at its velocity for ``time_s`` [s]."""
    place = add_scaled(end.position_ned, time_s, end.velocity_ned)
    return Reference(place, end.velocity_ned, yaw_rad=end.yaw_rad)


def _coefficients(
    h: float, p0: float, v0: float, a0: float, j0: float, p1: float, v1: float, a1: float, j1: float
) -> Coefficients:
    """Return c0 to c7 of the polynomial with these derivatives at x = 0 and at x = 1, ``h`` [s]
    later.
    """
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
    """Return the value of the polynomial at ``x``."""
    c0, c1, c2, c3, c4, c5, c6, c7 = part
    return c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * (c5 + x * (c6 + x * c7))))))


def differentiate(part: Coefficients, x: float) -> tuple[float, float, float]:
    """Return the first three derivatives of the polynomial by ``x``."""
    _, c1, c2, c3, c4, c5, c6, c7 = part
    first = c1 + x * (
        2 * c2 + x * (3 * c3 + x * (4 * c4 + x * (5 * c5 + x * (6 * c6 + x * 7 * c7))))
    )
    second = 2 * c2 + x * (6 * c3 + x * (12 * c4 + x * (20 * c5 + x * (30 * c6 + x * 42 * c7))))
    third = 6 * c3 + x * (24 * c4 + x * (60 * c5 + x * (120 * c6 + x * 210 * c7)))
    return first, second, third


def _derive(part: Coefficients, x: float, h: float) -> tuple[float, float, float, float]:
    """Return the value and the first three derivatives by time of a polynomial that lasts ``h``
    [s].
    """
    first, second, third = differentiate(part, x)
    return evaluate(part, x), first / h, second / (h * h), third / (h * h * h)
