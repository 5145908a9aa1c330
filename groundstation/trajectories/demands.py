"""What a motion asks of a vehicle in still air, figure by figure. Pure.

To follow the acceleration a and jerk j with the heading ψ, the rotors must push F = g e3 - a per mass (section 1 of
docs/explanation/law.md): thrust m |F|, tilted by the angle between F and e3, turning with F's direction z,
    z˙ = -(j - (z·j) z) / |F|,    ω1 = -y·z˙,    ω2 = x·z˙,    ω3 = (cosθ ψ˙ - sinφ ω2) / cosφ
about the body axes x, y, z of that direction and heading.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import msgspec

from groundstation.limits import LimitsConfig
from groundstation.ops import FLOATS, Ops, Real, Vec3
from groundstation.vehicle import Vehicle


class Demand(msgspec.Struct, frozen=True, kw_only=True):
    """One figure where it is at its extreme, and its limit."""

    name: str
    unit: str
    value: float
    time_s: float
    """When [s after the start of the trajectory]."""
    limit: float | None = None
    """None where nobody set one."""
    least: bool = False
    """The limit is from below, and so is the extreme."""
    key: str = ""
    """Where the limit comes from, as the operator finds it in the configuration."""
    ok: bool = True


class Asked(NamedTuple):
    """What is asked at one instant. Elementwise."""

    speed: Real
    """[m/s]."""
    acceleration: Real
    """[m/s²]."""
    tilt: Real
    """[deg]."""
    push: Real
    """Thrust per mass [m/s²]."""
    rates: Vec3
    """Body rates [deg/s]."""


class Motion(NamedTuple):
    """What a way is like at one instant, world NED. Elementwise."""

    velocity: Vec3
    acceleration: Vec3
    jerk: Vec3
    yaw: Real
    yaw_rate: Real

    def slowed(self, share: float) -> "Motion":
        """The same way at ``share`` of the speed."""
        return Motion(
            _scaled(share, self.velocity),
            _scaled(share**2, self.acceleration),
            _scaled(share**3, self.jerk),
            self.yaw,
            self.yaw_rate * share,
        )


def asked(motion: Motion, gravity: float, ops: Ops = FLOATS) -> Asked:
    """What ``motion`` asks, with ``gravity`` in [m/s²]."""
    sqrt, where = ops.sqrt, ops.where
    x, y, z = motion.acceleration
    push = (-x, -y, gravity - z)
    strength = sqrt(_dot(push, push))
    least = where(strength > 1e-6, strength, 1e-6)
    axis = _scaled(1.0 / least, push)
    level = sqrt(axis[0] * axis[0] + axis[1] * axis[1])
    rates = _rates(motion, axis, least, ops)
    return Asked(
        sqrt(_dot(motion.velocity, motion.velocity)),
        sqrt(_dot(motion.acceleration, motion.acceleration)),
        _DEGREES * ops.atan2(level, axis[2]),
        strength,
        _scaled(_DEGREES, rates),
    )


def demands(times: Sequence[float], looks: Iterable[Asked], vehicle: Vehicle, limits: LimitsConfig) -> list[Demand]:
    """Speed, acceleration, tilt, thrust and body rates where each is at its extreme; ``looks`` are at ``times`` [s]."""
    speed, acceleration, tilt, push, rates = zip(*looks, strict=True)
    thrust = [vehicle.mass_kg * value for value in push]
    kept = limits.reserve * (vehicle.thrust_max_n - vehicle.thrust_min_n)
    reserved = " and limits.reserve"

    def most(name: str, unit: str, values: Sequence[float], limit: float | None, key: str) -> Demand:
        value = largest(values)
        time_s = times[values.index(value)]
        ok = limit is None or value <= limit
        return Demand(name=name, unit=unit, value=value, time_s=time_s, limit=limit, key=key, ok=ok)

    least = min(thrust, key=lambda value: (not math.isnan(value), value))
    lower = vehicle.thrust_min_n + kept
    return [
        most("speed", "m/s", speed, limits.max_speed_m_s, "limits.max_speed_m_s"),
        most("acceleration", "m/s²", acceleration, limits.max_acceleration_m_s2, "limits.max_acceleration_m_s2"),
        most("tilt", "deg", tilt, limits.max_tilt_deg, "limits.max_tilt_deg"),
        most("thrust", "N", thrust, vehicle.thrust_max_n - kept, f"vehicle.thrust_max_n{reserved}"),
        Demand(
            name="thrust",
            unit="N",
            value=least,
            time_s=times[thrust.index(least)],
            limit=lower,
            least=True,
            key=f"vehicle.thrust_min_n{reserved}",
            ok=least >= lower,
        ),
        *(
            most(
                f"{axis} rate",
                "deg/s",
                [abs(rate[i]) for rate in rates],
                (1.0 - limits.reserve) * vehicle.rate_limits_deg_s[i],
                f"vehicle.rate_limits_deg_s{reserved}",
            )
            for i, axis in enumerate(("roll", "pitch", "yaw"))
        ),
    ]


def largest(values: Sequence[float]) -> float:
    """The largest of ``values``; one that is not a number is larger than all, as it keeps no limit."""
    return max(values, key=lambda value: (math.isnan(value), value))


def _rates(motion: Motion, z: Vec3, strength: Real, ops: Ops) -> Vec3:
    """Body rates [rad/s] where the thrust's axis is ``z``."""
    sqrt, where = ops.sqrt, ops.where
    jerk = motion.jerk
    along = _dot(z, jerk)
    turning = tuple(-(j - along * c) / strength for j, c in zip(jerk, z, strict=True))
    x = _cross((-ops.sin(motion.yaw), ops.cos(motion.yaw), 0.0 * motion.yaw), z)
    length = sqrt(_dot(x, x))
    x = _scaled(1.0 / where(length > 1e-6, length, 1e-6), x)
    y = _cross(z, x)
    roll, pitch = -_dot(y, turning), _dot(x, turning)
    cos_pitch = sqrt(y[2] * y[2] + z[2] * z[2])
    cos_pitch = where(cos_pitch > 1e-6, cos_pitch, 1e-6)
    sin_roll, cos_roll = y[2] / cos_pitch, z[2] / cos_pitch
    cos_roll = where(abs(cos_roll) < 1e-6, 1e-6, cos_roll)
    return roll, pitch, (cos_pitch * motion.yaw_rate - sin_roll * pitch) / cos_roll


_DEGREES = 180.0 / math.pi


def _dot(a: Sequence[Real], b: Sequence[Real]) -> Real:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _scaled(by: Real, v: Vec3) -> Vec3:
    return by * v[0], by * v[1], by * v[2]
