"""Transit: from rest at one point, straight to rest at another.

    pd = start + (end - start) f(x),    x = t / duration,    f = x⁴ (35 - 84x + 70x² - 20x³)

f is the polynomial of degree 7 whose first three derivatives vanish at both ends: position is C³, so that thrust
and body rates, which follow acceleration and jerk, start and stop without a step. With w = x (1 - x):
    f' = 140 w³        f'' = 420 w² (1 - 2x)        f''' = 840 w (1 - 5w)
"""

import math

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.port import Acceleration, Degrees, Point, Reference, Speed

_PEAK_1 = 35.0 / 16.0
"""Largest f', at x = 1/2."""
_PEAK_2 = 84.0 / (5.0 * math.sqrt(5.0))
"""Largest |f''|, where w = 1/5."""


class TransitConfig(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="transit"
):
    """A straight way between two points, as fast as two limits allow, and a hold at its end."""

    start_ned: Point
    """Where it starts [m], world NED."""
    end_ned: Point
    """Where it ends and stays [m], world NED."""
    max_speed_m_s: Speed = 0.5
    """Never faster than this [m/s]."""
    max_acceleration_m_s2: Acceleration = 1.0
    """Never more acceleration than this [m/s²]."""
    yaw_deg: Degrees = 0.0
    """Heading [deg], from north towards east; it stays."""

    def build(self) -> "Transit":
        """The trajectory of this config."""
        return Transit(
            self.start_ned,
            self.end_ned,
            max_speed_m_s=self.max_speed_m_s,
            max_acceleration_m_s2=self.max_acceleration_m_s2,
            yaw_rad=math.radians(self.yaw_deg),
        )


class Transit:
    """The way of this file's heading, in the shortest time that keeps both limits. See the port for its methods."""

    __slots__ = ("_duration_s", "_end", "_start", "_way", "_yaw")

    def __init__(
        self, start_ned: Vec3, end_ned: Vec3, *, max_speed_m_s: float, max_acceleration_m_s2: float, yaw_rad: float
    ) -> None:
        """Plan the way from ``start_ned`` to ``end_ned`` [m]; both limits must be above 0."""
        way = (end_ned[0] - start_ned[0], end_ned[1] - start_ned[1], end_ned[2] - start_ned[2])
        length = math.hypot(*way)
        self._way = way
        self._yaw = yaw_rad
        self._start = Reference(start_ned, yaw_rad=yaw_rad)
        self._end = Reference(end_ned, yaw_rad=yaw_rad)
        self._duration_s = max(
            _PEAK_1 * length / max_speed_m_s,
            math.sqrt(_PEAK_2 * length / max_acceleration_m_s2),
        )

    @property
    def duration_s(self) -> float:
        """Time from one point to the other [s]; 0 where they are the same."""
        return self._duration_s

    @property
    def joints_s(self) -> tuple[float, float]:
        """Start and end [s]."""
        return (0.0, self._duration_s)

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        return self.at(time_s).position_ned

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        duration = self._duration_s
        if time_s >= duration:
            return self._end
        if time_s <= 0.0:
            return self._start
        x = time_s / duration
        w = x * (1.0 - x)
        f = x * x * x * x * (35.0 - x * (84.0 - x * (70.0 - x * 20.0)))
        f1 = 140.0 * w * w * w / duration
        f2 = 420.0 * w * w * (1.0 - 2.0 * x) / (duration * duration)
        f3 = 840.0 * w * (1.0 - 5.0 * w) / (duration * duration * duration)
        start = self._start.position_ned
        a, b, c = self._way
        return Reference(
            (start[0] + f * a, start[1] + f * b, start[2] + f * c),
            (f1 * a, f1 * b, f1 * c),
            (f2 * a, f2 * b, f2 * c),
            (f3 * a, f3 * b, f3 * c),
            self._yaw,
        )
