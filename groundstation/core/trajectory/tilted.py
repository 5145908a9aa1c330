"""A level curve turned about a level line through its middle: any plane."""

import math
from collections.abc import Sequence

from groundstation.core.geometry.ops import Vec3
from groundstation.core.trajectory.port import Reference, Turning


class Tilted:
    """``curve``, whose side towards one bearing is raised. See the port for ``at`` and ``position_at``."""

    __slots__ = ("_curve", "_east", "_middle", "_north", "_rise", "_shrink")

    def __init__(self, curve: Turning, middle_ned: Vec3, tilt_rad: float, uphill_rad: float) -> None:
        """Raise the side at bearing ``uphill_rad`` by ``tilt_rad``; the curve is level at the height of its middle."""
        self._curve = curve
        self._middle = middle_ned
        self._north, self._east = math.cos(uphill_rad), math.sin(uphill_rad)
        self._shrink, self._rise = math.cos(tilt_rad) - 1.0, -math.sin(tilt_rad)

    @property
    def duration_s(self) -> float | None:
        """As the curve's."""
        return self._curve.duration_s

    @property
    def period_s(self) -> float:
        """As the curve's."""
        return self._curve.period_s

    @property
    def joints_s(self) -> Sequence[float]:
        """As the curve's."""
        return self._curve.joints_s

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        return self._point(self._curve.position_at(time_s))

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        level = self._curve.at(time_s)
        return Reference(
            self._point(level.position_ned),
            self._turned(level.velocity_ned),
            self._turned(level.acceleration_ned),
            self._turned(level.jerk_ned),
            level.yaw_rad,
            level.yaw_rate_rad_s,
        )

    def _point(self, point: Vec3) -> Vec3:
        north, east, down = self._middle
        x, y, z = self._turned((point[0] - north, point[1] - east, 0.0))
        return (north + x, east + y, down + z)

    def _turned(self, level: Vec3) -> Vec3:
        uphill = level[0] * self._north + level[1] * self._east
        more = self._shrink * uphill
        return (level[0] + more * self._north, level[1] + more * self._east, self._rise * uphill)
