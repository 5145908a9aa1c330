"""Laps: how often a circle or a figure of eight is flown, how it begins and ends, and its plane.

Any plane: the level curve is turned about a level line through its middle.
"""

import math
from collections.abc import Sequence
from typing import Annotated

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.paced import Paced
from groundstation.core.trajectory.port import Degrees, Ramp, Reference, Turning


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


class Laps(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys of every closed curve. Without them it is level, at full speed from the start, and never ends."""

    laps: Annotated[int, msgspec.Meta(ge=1, le=100_000)] | None = None
    """Whole turns to fly, then it rests where it began; needs ``ramp_s``. Without it, it never ends."""
    ramp_s: Ramp = 0.0
    """From rest to full speed in this time, and back to rest at the end [s]; 0: at full speed at once."""
    tilt_deg: Annotated[float, msgspec.Meta(ge=-90.0, le=90.0)] = 0.0
    """Turns the figure out of the level plane, about its middle [deg]; 90 is upright."""
    uphill_deg: Degrees = 0.0
    """Bearing of the side that ``tilt_deg`` raises [deg], from north towards east."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: it would have to stop at once, or the ramps are longer than all laps.
        """
        if self.laps is not None and self.ramp_s == 0.0:
            raise ValueError("laps: needs ramp_s above 0, or it would have to stop within no time at the end")
        if self.laps is not None and self.ramp_s > self.laps * self.lap_s:
            raise ValueError(
                f"ramp_s: expected at most {self.laps * self.lap_s:.3g} s, the time of all laps, got {self.ramp_s:g}"
            )

    @property
    def lap_s(self) -> float:
        """Time of one turn at full speed [s]."""
        raise NotImplementedError

    def flown(self, curve: Turning, middle_ned: Vec3) -> Turning:
        """The level ``curve``, as these keys have it; its plane is turned about ``middle_ned`` [m]."""
        if self.ramp_s > 0.0:
            length_s = None if self.laps is None else self.laps * curve.period_s
            curve = Paced(curve, self.ramp_s, length_s, curve.period_s)
        if self.tilt_deg != 0.0:
            curve = Tilted(curve, middle_ned, math.radians(self.tilt_deg), math.radians(self.uphill_deg))
        return curve
