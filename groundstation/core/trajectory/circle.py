"""Circle, at constant speed."""

import math

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.laps import Laps
from groundstation.core.trajectory.port import Coordinate, Degrees, Length, Point, Reference, Speed, Turning


class CircleConfig(Laps, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="circle"):
    """A circle at constant speed, level unless it is tilted."""

    radius_m: Length = 1.0
    """Radius [m]."""
    speed_m_s: Speed = 0.5
    """Speed along the circle [m/s]."""
    altitude_m: Coordinate = 1.0
    """Height above ``centre_ned`` [m]."""
    centre_ned: Point = (0.0, 0.0, 0.0)
    """The point below the middle of the circle [m], world NED."""
    start_deg: Degrees = 0.0
    """Where on the circle it starts: bearing from the centre [deg], from north towards east."""
    clockwise: bool = True
    """Turn from north towards east (seen from above), or the other way."""
    yaw_deg: Degrees = 0.0
    """Heading [deg], from north towards east; it stays."""

    @property
    def lap_s(self) -> float:
        """Time of one turn at full speed [s]."""
        return 2.0 * math.pi * self.radius_m / self.speed_m_s

    def build(self) -> Turning:
        """The trajectory of this config."""
        north, east, down = self.centre_ned
        return self.flown(Circle(self), (north, east, down - self.altitude_m))


class Circle:
    """pd = centre + r (cos θ, sin θ), θ = θ0 ± (V/r) t. See the port for ``at`` and ``position_at``."""

    __slots__ = ("_down", "_east", "_north", "_radius", "_rate", "_start", "_yaw", "period_s")

    duration_s: float | None = None
    """It never ends."""

    def __init__(self, config: CircleConfig) -> None:
        self._north, self._east, down = config.centre_ned
        self._down = down - config.altitude_m
        self._radius = config.radius_m
        self._start = math.radians(config.start_deg)
        self._yaw = math.radians(config.yaw_deg)
        self.period_s = config.lap_s
        self._rate = config.speed_m_s / config.radius_m * (1.0 if config.clockwise else -1.0)

    @property
    def joints_s(self) -> tuple[float, float]:
        """One turn [s]."""
        return (0.0, self.period_s)

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        angle = self._start + self._rate * math.remainder(time_s, self.period_s)
        radius = self._radius
        return (self._north + radius * math.cos(angle), self._east + radius * math.sin(angle), self._down)

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        # Whole turns are taken off the time, exactly, so that hours of flight cost no digits.
        rate = self._rate
        angle = self._start + rate * math.remainder(time_s, self.period_s)
        x, y = self._radius * math.cos(angle), self._radius * math.sin(angle)
        rate2 = rate * rate
        rate3 = rate2 * rate
        return Reference(
            (self._north + x, self._east + y, self._down),
            (-rate * y, rate * x, 0.0),
            (-rate2 * x, -rate2 * y, 0.0),
            (rate3 * y, -rate3 * x, 0.0),
            self._yaw,
        )
