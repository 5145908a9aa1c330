"""Lemniscate (figure of eight) at constant speed, the trajectory of the paper's experiment.

    pd = Rz(rotation) [ sinφ cosφ, cosφ ] / (1 + sin²φ) · scale,    φ˙ = (V/scale) √(1 + sin²φ),    φ(0) = 0

(the paper prints sin² t, whose speed is not constant). In u = V t / scale the solution is the Jacobi amplitude
φ = am(u | m = -1). It comes from the arithmetic-geometric mean and the descending Landen transformation
(Abramowitz & Stegun 16.4), exact to rounding, with nothing to integrate.

With s = sinφ, c = cosφ, d = √(1 + s²):  ds/du = c d,  dc/du = -s d,  dd/du = s c.  Hence, all per unit of scale:
    unit tangent  T = (1 - 3s², -s (3 - s²)) / d³        (the speed is V)
    curvature     κ = -3 c / d,   dκ/du = 6 s / d²
    dT/du = κ N,  d²T/du² = κ' N - κ² T,                 N = T turned by +90° about down
"""

import math

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.laps import Laps
from groundstation.core.trajectory.port import Coordinate, Degrees, Length, Point, Reference, Speed, Turning


def _landen() -> tuple[float, tuple[float, ...]]:
    """2^N a_N, and the ratios c_n/a_n for n = N..1, of the arithmetic-geometric mean for m = -1."""
    a, b = 1.0, math.sqrt(2.0)
    c = (a - b) / 2.0
    factor = 1.0
    ratios: list[float] = []
    while abs(c) > 1e-17:
        a, b = (a + b) / 2.0, math.sqrt(a * b)
        factor *= 2.0
        ratios.append(c / a)
        # (a - b)/2 of the next step, without its cancellation.
        c = c * c / (2.0 * (a + b))
    return factor * a, tuple(reversed(ratios))


_FACTOR, _RATIOS = _landen()
_QUARTER: float = math.pi / 2.0 * 2 ** len(_RATIOS) / _FACTOR
"""K(-1), a quarter of the period in u: am(K) = π/2."""


class LemniscateConfig(Laps, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="lemniscate"):
    """A figure of eight at constant speed, level unless it is tilted."""

    scale_m: Length = 1.0
    """From the crossing to the far end of a lobe [m]."""
    speed_m_s: Speed = 0.5
    """Speed along the curve [m/s]."""
    altitude_m: Coordinate = 1.0
    """Height above ``centre_ned`` [m]."""
    rotation_deg: Degrees = -45.0
    """Turns the figure about down [deg], from north towards east; at 0 its lobes lie east and west."""
    centre_ned: Point = (0.0, 0.0, 0.0)
    """The point below the crossing [m], world NED."""
    yaw_deg: Degrees = 0.0
    """Heading [deg], from north towards east; it stays."""

    @property
    def lap_s(self) -> float:
        """Time of one turn at full speed [s]."""
        return 4.0 * _QUARTER * self.scale_m / self.speed_m_s

    def build(self) -> Turning:
        """The trajectory of this config."""
        north, east, down = self.centre_ned
        return self.flown(Lemniscate(self), (north, east, down - self.altitude_m))


class Lemniscate:
    """The curve of this file's heading. See the port for ``at`` and ``position_at``."""

    __slots__ = ("_cos", "_down", "_east", "_north", "_rate", "_scale", "_sin", "_speed", "_yaw", "period_s")

    duration_s: float | None = None
    """It never ends."""

    def __init__(self, config: LemniscateConfig) -> None:
        self._north, self._east, down = config.centre_ned
        self._down = down - config.altitude_m
        self._scale = config.scale_m
        self._speed = config.speed_m_s
        self._cos = math.cos(math.radians(config.rotation_deg))
        self._sin = math.sin(math.radians(config.rotation_deg))
        self._yaw = math.radians(config.yaw_deg)
        self._rate = _FACTOR * config.speed_m_s / config.scale_m
        self.period_s = config.lap_s

    def _amplitude(self, time_s: float) -> float:
        """φ [rad], less whole turns."""
        # Whole periods are taken off the time, exactly, so that hours of flight cost no digits.
        phi = self._rate * math.remainder(time_s, self.period_s)
        asin, sin = math.asin, math.sin
        for ratio in _RATIOS:
            phi = 0.5 * (phi + asin(ratio * sin(phi)))
        return phi

    @property
    def joints_s(self) -> tuple[float, float]:
        """One turn [s]."""
        return (0.0, self.period_s)

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        phi = self._amplitude(time_s)
        s = math.sin(phi)
        y = self._scale * math.cos(phi) / (1.0 + s * s)
        x = s * y
        return (
            self._north + self._cos * x - self._sin * y,
            self._east + self._sin * x + self._cos * y,
            self._down,
        )

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        phi = self._amplitude(time_s)
        s, c = math.sin(phi), math.cos(phi)
        cos, sin, scale, speed = self._cos, self._sin, self._scale, self._speed
        s2 = s * s
        d2 = 1.0 / (1.0 + s2)
        d1 = math.sqrt(d2)
        d3 = d1 * d2
        y = scale * c * d2
        x = s * y
        tx, ty = (1.0 - 3.0 * s2) * d3, s * (s2 - 3.0) * d3
        north, east = cos * tx - sin * ty, sin * tx + cos * ty
        kappa = -3.0 * c * d1
        centripetal = speed * speed / scale * kappa
        along = -kappa * kappa
        across = 6.0 * s * d2
        jerk = speed * speed * speed / (scale * scale)
        return Reference(
            (self._north + cos * x - sin * y, self._east + sin * x + cos * y, self._down),
            (speed * north, speed * east, 0.0),
            (-centripetal * east, centripetal * north, 0.0),
            (jerk * (along * north - across * east), jerk * (along * east + across * north), 0.0),
            self._yaw,
        )
