"""Pacing: a curve flown from rest and to rest, by another time whose rate rises and falls
smoothly.
"""

from groundstation.config import config_notice
from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.reference import Reference, Trajectory, rest_there

BISECTIONS = 50
"""Bisections that find a joint within a ramp [-]: a ramp of 600 s divided by 2⁵⁰ is below a
picosecond."""
LEAST_RAMP_S = 0.001
"""Shortest ramp, except 0 [s]: the shortest period of commands. The jerk grows with 1/ramp²."""


def check_ramp(ramp_s: float, length_s: float) -> None:
    """Check the time of a ramp for a curve of ``length_s`` of its own time [s].

    Raises:
        ValueError: it is longer than the curve, or too short to be flown.
    """
    if ramp_s > length_s:
        raise ValueError(config_notice("trajectory.ramp", length_s=length_s, ramp_s=ramp_s))
    if 0.0 < ramp_s < LEAST_RAMP_S:
        raise ValueError(
            config_notice("trajectory.short_ramp", least_s=LEAST_RAMP_S, ramp_s=ramp_s)
        )


class Paced:
    """Any curve flown from rest and to rest.

    See :class:`Trajectory` for ``at`` and ``position_at``.

    It is evaluated at another time, s(t), whose rate rises and falls smoothly.

        s˙ = w(t / ramp) on the way in, 1 between, w((duration - t) / ramp) on the way out,
        w = x³ (10 - 15x + 6x²)

    w is 0 at the one end and 1 at the other, w' and w'' are 0 at both: s is C³, and so is the
    position where the curve is. A ramp takes half of its own time from the curve: s = ramp x⁴ (5/2
    - 3x + x²). With the curve's derivatives c', c'', c''' by its time:
        v = s˙ c'        a = s¨ c' + s˙² c''        j = s⃛ c' + 3 s˙ s¨ c'' + s˙³ c'''
    """

    duration_s: float | None
    """Time at which ``length_s`` of the curve are flown [s]; None where it has no end."""
    period_s: float
    """One turn of the curve at full speed [s]; its whole length if it ends by itself."""

    def __init__(
        self, curve: Trajectory, ramp_s: float, length_s: float | None, period_s: float
    ) -> None:
        """Fly ``length_s`` of the curve's own time, at least ``ramp_s`` > 0 [s].

        None: without end.
        """
        self._curve = curve
        self._ramp = ramp_s
        self._length = length_s
        self.duration_s = None if length_s is None else length_s + ramp_s
        self.period_s = period_s
        self._start = rest_there(curve.at(0.0))
        self._end = self._start if length_s is None else rest_there(curve.at(length_s))

    @property
    def joints_s(self) -> list[float]:
        """Ends of the ramps and joints of the curve [s].

        Without an end, those of the first ramp and one turn.
        """
        if self.duration_s is None or self._length is None:
            return [0.0, self._ramp, self._ramp + self.period_s]
        inner = [self._when(s) for s in self._curve.joints_s if s < self._length]
        return sorted({0.0, self._ramp, *inner, self.duration_s - self._ramp, self.duration_s})

    def _when(self, length_s: float) -> float:
        """Find the time t with s(t) = ``length_s`` of a curve that ends [s]."""
        assert self.duration_s is not None and self._length is not None
        middle = length_s + 0.5 * self._ramp
        if self._ramp <= middle <= self.duration_s - self._ramp:
            return middle
        low, high = 0.0, self.duration_s
        for _ in range(BISECTIONS):
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
    """s and its first three derivatives, ``time_s`` after the begin of a ramp of ``ramp_s`` [s]."""
    x = time_s / ramp_s
    y = 1.0 - x
    return (
        ramp_s * x * x * x * x * (2.5 - x * (3.0 - x)),
        x * x * x * (10.0 - x * (15.0 - 6.0 * x)),
        30.0 * x * x * y * y / ramp_s,
        60.0 * x * y * (1.0 - 2.0 * x) / (ramp_s * ramp_s),
    )
