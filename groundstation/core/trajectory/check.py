"""What a trajectory asks of a vehicle in still air, held against what the vehicle and its operator allow. Pure.

What a motion asks of a vehicle in still air, figure by figure. Pure.

To follow the acceleration a and jerk j with the heading ψ, the rotors must push F = g e3 - a per mass (section 1 of
docs/explanation/law.md): thrust m |F|, tilted by the angle between F and e3, turning with F's direction z,
    z˙ = -(j - (z·j) z) / |F|,    ω1 = -y·z˙,    ω2 = x·z˙,    ω3 = (cosθ ψ˙ - sinφ ω2) / cosφ
about the body axes x, y, z of that direction and heading.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

import msgspec

from groundstation.core.geometry.ops import Vec3
from groundstation.core.trajectory.port import Trajectory
from groundstation.core.vehicle.vehicle import LimitsConfig, Vehicle

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


STEP_S = 0.01
"""The trajectory is looked at so often [s] between two joints, ..."""
FEWEST, MOST = 8, 1000
"""... but within these numbers: its formulas are smooth, and the shortest may be the hardest to fly."""


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """A trajectory looked at from its start to its end, or for one turn."""

    duration_s: float | None
    """None where it never ends."""
    span_s: float
    """How much of it was looked at [s]."""
    length_m: float
    """Way flown in that time [m]."""
    start_speed_m_s: float
    lowest_ned: Vec3
    highest_ned: Vec3
    """Corners of the box that it stays in [m, NED]; smooth ways swing wide of their points."""
    demands: tuple[Demand, ...]
    share: float | None
    """Share of its own speed at which it keeps the limits [-], the floor aside; None where slower is no help."""

    @property
    def ok(self) -> bool:
        """Whether it keeps all limits."""
        return all(demand.ok for demand in self.demands)


def check(
    trajectory: Trajectory, vehicle: Vehicle, limits: LimitsConfig, *, gravity: float, floor_z_m: float
) -> Report:
    """Look at all of ``trajectory``; the floor is at ``floor_z_m`` [m, NED], ``gravity`` in [m/s²]."""
    import numpy as np

    joints = trajectory.joints_s
    span = joints[-1]
    looks = [
        np.linspace(start, end, min(max(math.ceil((end - start) / STEP_S), FEWEST), MOST), endpoint=False)
        for start, end in zip(joints, joints[1:], strict=False)
    ]
    times = np.concatenate([*looks, [span]])
    seen = [trajectory.at(t) for t in times.tolist()]
    motion = Motion(
        times,
        np.array([r.velocity_ned for r in seen]),
        np.array([r.acceleration_ned for r in seen]),
        np.array([r.jerk_ned for r in seen]),
        np.array([r.yaw_rad for r in seen]),
        np.array([r.yaw_rate_rad_s for r in seen]),
    )
    places = np.array([r.position_ned for r in seen])
    height = floor_z_m - places[:, 2]
    lowest = int(height.argmin())
    above = Demand(
        name="height above the floor",
        unit="m",
        value=float(height[lowest]),
        time_s=float(times[lowest]),
        limit=0.0,
        least=True,
        key="flight.floor_z_m",
        ok=bool(height[lowest] >= 0.0),
    )
    return Report(
        duration_s=trajectory.duration_s,
        span_s=span,
        length_m=float(np.trapezoid(np.linalg.norm(motion.velocity, axis=1), times)),
        start_speed_m_s=math.hypot(*seen[0].velocity_ned),
        lowest_ned=tuple(places.min(axis=0).tolist()),
        highest_ned=tuple(places.max(axis=0).tolist()),
        demands=(above, *demands(motion, vehicle, limits, gravity)),
        share=_share(motion, vehicle, limits, gravity),
    )


def refusal(report: Report, speed_m_s: float | None = None) -> str | None:
    """Why the trajectory must not fly, and what to do; None if it may.

    ``speed_m_s`` is its speed, where one key of the configuration sets it.
    """
    worst = next((demand for demand in report.demands if not demand.ok), None)
    if worst is None or worst.limit is None:
        return None
    if worst.key == "flight.floor_z_m":
        return (
            f"at {worst.time_s:.2f} s it is {-worst.value:.2f} m below the floor ({worst.key}): "
            "in NED z counts down, so 1 m up is -1"
        )
    needed, limit = f"{worst.value:.3g}", f"{worst.limit:.3g}"
    if needed == limit:
        needed, limit = f"{worst.value:.6g}", f"{worst.limit:.6g}"
    bound = "at least" if worst.least else "limit"
    says = f"at {worst.time_s:.2f} s it needs {needed} {worst.unit} of {worst.name}, {bound} {limit} {worst.unit}"
    if report.share is None:
        return f"{says} ({worst.key}): flying it slower does not help"
    percent = math.floor(100.0 * report.share)
    slower = f"{percent} % of its speed"
    if speed_m_s is not None:
        slower = f"{math.floor(1000.0 * report.share * speed_m_s) / 1000.0:g} m/s (trajectory.speed_m_s)"
    return f"{says} ({worst.key}): slow it down to about {slower}"


def _share(motion: Motion, vehicle: Vehicle, limits: LimitsConfig, gravity: float) -> float | None:
    """The largest share of its speed at which it keeps the limits, height aside."""

    def kept(share: float) -> bool:
        return all(demand.ok for demand in demands(motion.slowed(share), vehicle, limits, gravity))

    if kept(1.0):
        return 1.0
    low, high = 1e-3, 1.0
    if not kept(low):
        return None
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(middle) else (low, middle)
    return low
