"""What a motion asks of a vehicle in still air, figure by figure. Pure.

To follow the acceleration a and jerk j with the heading ψ, the rotors must push F = g e3 - a per mass (section 1 of
docs/explanation/law.md): thrust m |F|, tilted by the angle between F and e3, turning with F's direction z,
    z˙ = -(j - (z·j) z) / |F|,    ω1 = -y·z˙,    ω2 = x·z˙,    ω3 = (cosθ ψ˙ - sinφ ω2) / cosφ
about the body axes x, y, z of that direction and heading.
"""

from typing import TYPE_CHECKING, NamedTuple

import msgspec

from groundstation.core.vehicle.limits import LimitsConfig
from groundstation.core.vehicle.vehicle import Vehicle

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]


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


class Motion(NamedTuple):
    """What was seen at each of N times: vectors (N, 3), NED."""

    times: "Array"
    velocity: "Array"
    acceleration: "Array"
    jerk: "Array"
    yaw: "Array"
    yaw_rate: "Array"

    def slowed(self, share: float) -> "Motion":
        """The same way at ``share`` of the speed."""
        return Motion(
            self.times / share,
            self.velocity * share,
            self.acceleration * share**2,
            self.jerk * share**3,
            self.yaw,
            self.yaw_rate * share,
        )


def demands(motion: Motion, vehicle: Vehicle, limits: LimitsConfig, gravity: float) -> list[Demand]:
    """Speed, acceleration, tilt, thrust and body rates where each is at its extreme; ``gravity`` in [m/s²]."""
    import numpy as np

    push = -motion.acceleration
    push[:, 2] += gravity
    strength = np.linalg.norm(push, axis=1)
    z = push / np.maximum(strength, 1e-6)[:, None]
    rates = np.degrees(_rates(motion, z, strength))
    tilt = np.degrees(np.arccos(np.clip(z[:, 2], -1.0, 1.0)))
    thrust = vehicle.mass_kg * strength
    kept = limits.reserve * (vehicle.thrust_max_n - vehicle.thrust_min_n)
    reserved = " and limits.reserve"

    def most(name: str, unit: str, values: "Array", limit: float | None, key: str) -> Demand:
        i = int(values.argmax())
        value = float(values[i])
        ok = limit is None or value <= limit
        time_s = float(motion.times[i])
        return Demand(name=name, unit=unit, value=value, time_s=time_s, limit=limit, key=key, ok=ok)

    least = int(thrust.argmin())
    lower = vehicle.thrust_min_n + kept
    return [
        most("speed", "m/s", np.linalg.norm(motion.velocity, axis=1), limits.max_speed_m_s, "limits.max_speed_m_s"),
        most(
            "acceleration",
            "m/s²",
            np.linalg.norm(motion.acceleration, axis=1),
            limits.max_acceleration_m_s2,
            "limits.max_acceleration_m_s2",
        ),
        most("tilt", "deg", tilt, limits.max_tilt_deg, "limits.max_tilt_deg"),
        most("thrust", "N", thrust, vehicle.thrust_max_n - kept, f"vehicle.thrust_max_n{reserved}"),
        Demand(
            name="thrust",
            unit="N",
            value=float(thrust[least]),
            time_s=float(motion.times[least]),
            limit=lower,
            least=True,
            key=f"vehicle.thrust_min_n{reserved}",
            ok=bool(thrust[least] >= lower),
        ),
        *(
            most(
                f"{axis} rate",
                "deg/s",
                np.abs(rates[:, i]),
                (1.0 - limits.reserve) * vehicle.rate_limits_deg_s[i],
                f"vehicle.rate_limits_deg_s{reserved}",
            )
            for i, axis in enumerate(("roll", "pitch", "yaw"))
        ),
    ]


def _rates(motion: Motion, z: "Array", strength: "Array") -> "Array":
    """Body rates (N, 3) [rad/s]."""
    import numpy as np

    turning = -(motion.jerk - (z * motion.jerk).sum(axis=1)[:, None] * z) / np.maximum(strength, 1e-6)[:, None]
    side = np.stack([-np.sin(motion.yaw), np.cos(motion.yaw), np.zeros_like(motion.yaw)], axis=1)
    x = np.cross(side, z)
    x /= np.maximum(np.linalg.norm(x, axis=1), 1e-6)[:, None]
    y = np.cross(z, x)
    roll, pitch = -(y * turning).sum(axis=1), (x * turning).sum(axis=1)
    cos_pitch = np.maximum(np.hypot(y[:, 2], z[:, 2]), 1e-6)
    sin_roll, cos_roll = y[:, 2] / cos_pitch, z[:, 2] / cos_pitch
    cos_roll = np.where(np.abs(cos_roll) < 1e-6, 1e-6, cos_roll)
    yaw = (cos_pitch * motion.yaw_rate - sin_roll * pitch) / cos_roll
    return np.stack([roll, pitch, yaw], axis=1)
