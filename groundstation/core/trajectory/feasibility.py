"""Demand of a trajectory in still air against the limits of vehicle and operator. Pure.

To follow the acceleration a and jerk j with the heading ψ, the specific thrust must be F = g e3 - a
(section 1 of docs/explanation/law.md): thrust m |F|, tilted by the angle between F and e3, turning
with F's direction z,
    z˙ = -(j - (z·j) z) / |F|,    ω1 = -y·z˙,    ω2 = x·z˙,    ω3 = (cosθ ψ˙ - sinφ ω2) / cosφ
about the body axes x, y, z of that direction and heading.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import msgspec

from groundstation.core.geometry import FLOATS, Ops, Real, Vec3, arrays, scale
from groundstation.core.trajectory.reference import LOOKED_AT_S, Reference, Trajectory
from groundstation.core.vehicle import LimitsConfig, Vehicle


class Demand(msgspec.Struct, frozen=True, kw_only=True):
    """Extreme of one quantity along a trajectory, and its limit."""

    name: str
    unit: str
    value: float
    time_s: float
    """When [s after the start of the trajectory]."""
    limit: float | None = None
    """None where none is set."""
    least: bool = False
    """The limit is from below, and so is the extreme."""
    key: str = ""
    """Where the limit comes from, as the operator finds it in the configuration."""
    ok: bool = True


class MotionDemand(NamedTuple):
    """Thrust, tilt and rates that one instant demands. Elementwise."""

    speed: Real
    """[m/s]."""
    acceleration: Real
    """[m/s²]."""
    tilt: Real
    """[deg]."""
    specific_thrust: Real
    """Thrust per mass [m/s²]."""
    rates: Vec3
    """Body rates [deg/s]."""


class PathMotion(NamedTuple):
    """Motion along a trajectory at one instant, world NED. Elementwise."""

    velocity: Vec3
    acceleration: Vec3
    jerk: Vec3
    yaw: Real
    yaw_rate: Real

    def slow_down(self, share: float) -> "PathMotion":
        """Return the motion at ``share`` of the speed [-]."""
        return PathMotion(
            scale(share, self.velocity),
            scale(share**2, self.acceleration),
            scale(share**3, self.jerk),
            self.yaw,
            self.yaw_rate * share,
        )


def compute_demand(motion: PathMotion, gravity: float, ops: Ops = FLOATS) -> MotionDemand:
    """Compute the demand of ``motion``, with ``gravity`` in [m/s²]."""
    sqrt, where = ops.sqrt, ops.where
    (u, v, w), (x, y, z), jerk, yaw, yaw_rate = motion
    a, b, c = -x, -y, gravity - z
    strength = sqrt(a * a + b * b + c * c)
    least = where(strength > 1e-6, strength, 1e-6)
    k = 1.0 / least
    a, b, c = k * a, k * b, k * c
    p, q, r = _rates((a, b, c), jerk, yaw, yaw_rate, least, ops)
    return MotionDemand(
        sqrt(u * u + v * v + w * w),
        sqrt(x * x + y * y + z * z),
        ops.degrees(ops.atan2(sqrt(a * a + b * b), c)),
        strength,
        (ops.degrees(p), ops.degrees(q), ops.degrees(r)),
    )


def demands(
    times: Sequence[float], looks: Iterable[MotionDemand], vehicle: Vehicle, limits: LimitsConfig
) -> list[Demand]:
    """Return speed, acceleration, tilt, thrust and body rates where each is at its extreme.

    ``looks`` are the demands at ``times`` [s].
    """
    speed, acceleration, tilt, specific_thrust, rates = zip(*looks, strict=True)
    thrust = [vehicle.mass_kg * value for value in specific_thrust]
    kept = limits.reserve * (vehicle.thrust_max_n - vehicle.thrust_min_n)
    reserved = " and limits.reserve"

    def most(
        name: str, unit: str, values: Sequence[float], limit: float | None, key: str
    ) -> Demand:
        value = largest(values)
        time_s = times[values.index(value)]
        ok = limit is None or value <= limit
        return Demand(name=name, unit=unit, value=value, time_s=time_s, limit=limit, key=key, ok=ok)

    least = min(thrust, key=lambda value: (not math.isnan(value), value))
    lower, fastest = vehicle.thrust_min_n + kept, limits.max_acceleration_m_s2
    return [
        most("speed", "m/s", speed, limits.max_speed_m_s, "limits.max_speed_m_s"),
        most("acceleration", "m/s²", acceleration, fastest, "limits.max_acceleration_m_s2"),
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
    """Return the largest of ``values``; NaN counts as larger than all, as it keeps no limit."""
    nan = next(filter(math.isnan, values), None)
    return max(values) if nan is None else nan


def _rates(axis: Vec3, jerk: Vec3, yaw: Real, yaw_rate: Real, strength: Real, ops: Ops) -> Vec3:
    """Return body rates [rad/s] by the equations above.

    Args:
        axis: z, the unit vector of the specific thrust [NED].
        jerk: j [m/s³, NED].
        yaw: ψ [rad].
        yaw_rate: ψ˙ [rad/s].
        strength: |F| [m/s²].
        ops: arithmetic.
    """
    sqrt, where = ops.sqrt, ops.where
    (a, b, c), (d, e, f) = axis, jerk
    along = a * d + b * e + c * f
    # d, e, f: z˙.
    d, e, f = -(d - along * a) / strength, -(e - along * b) / strength, -(f - along * c) / strength
    # u, v, w: horizontal unit vector to the right of the heading.
    u, v, w = -ops.sin(yaw), ops.cos(yaw), 0.0 * yaw
    # x, y, z: the body's x axis, across it and z.
    x, y, z = v * c - w * b, w * a - u * c, u * b - v * a
    length = sqrt(x * x + y * y + z * z)
    k = 1.0 / where(length > 1e-6, length, 1e-6)
    x, y, z = k * x, k * y, k * z
    # u, v, w: the body's y axis.
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    roll, pitch = -(u * d + v * e + w * f), x * d + y * e + z * f
    cos_pitch = sqrt(w * w + c * c)
    cos_pitch = where(cos_pitch > 1e-6, cos_pitch, 1e-6)
    sin_roll, cos_roll = w / cos_pitch, c / cos_pitch
    cos_roll = where(abs(cos_roll) < 1e-6, 1e-6, cos_roll)
    return roll, pitch, (cos_pitch * yaw_rate - sin_roll * pitch) / cos_roll


STEP_S = 0.01
"""Interval of the samples of a segment between two joints [s]: less than a frame of commands.

Differences over half of it are taken for derivatives: their error is of second order in it."""
FEWEST = 8
"""Least number of samples of a segment [-]: the shortest may be the hardest to fly."""
MOST = 1000
"""Largest number of samples of a segment [-]: it bounds the time of a check; a segment of more than
10 s is smooth."""
BOX_SPARE_M = 0.05
"""Margin around the box of the first turn that later turns may use [m]: peaks lie between its
samples."""
JUMP_M = 0.01
"""Largest step of the position that its velocity need not explain [m]: points may be rounded to
centimetres."""
JUMP_M_S = 0.05
"""Largest step of the velocity that its acceleration need not explain [m/s]: a vehicle follows it
by a tilt of 5 degrees within 60 ms."""
JUMP_RAD = 0.02
"""Largest step of the yaw that its rate need not explain [rad]: headings may be rounded to
degrees."""


class Inconsistency(msgspec.Struct, frozen=True, kw_only=True):
    """A derivative of a trajectory that is not the one of its positions, or a period that is
    none.
    """

    time_s: float
    """When [s after the start of the trajectory]."""
    name: str
    """Name of the declared quantity: velocity, acceleration, jerk, yaw rate or period."""
    declared: float
    """Its length as declared, in ``unit``; of a period its time [s]."""
    found: float
    """Its length by differences, in ``unit``; of a period the distance from the box of the first
    turn."""
    unit: str

    @property
    def of(self) -> str:
        """Name of the quantity whose derivative is declared."""
        parents = {"acceleration": "velocity", "jerk": "acceleration", "yaw rate": "yaw"}
        return parents.get(self.name, "position")


class FeasibilityReport(msgspec.Struct, frozen=True, kw_only=True):
    """Demands of a trajectory from its start to its end, or of one turn."""

    duration_s: float | None
    """None where it never ends."""
    span_s: float
    """Examined duration [s]."""
    length_m: float
    """Way flown in that time [m]."""
    start_speed_m_s: float
    lowest_ned: Vec3
    highest_ned: Vec3
    """Corners of the box that it stays in [m, NED]; smooth curves leave the box of their points."""
    demands: tuple[Demand, ...]
    share: float | None
    """Share of its own speed at which it keeps the limits except the floor [-]; None where none is
    slow enough."""
    inconsistency: Inconsistency | None = None
    """First derivative that its positions do not have; None if all agree."""

    @property
    def ok(self) -> bool:
        """Whether it keeps all limits, and its derivatives agree with its positions."""
        return self.inconsistency is None and all(demand.ok for demand in self.demands)

    @property
    def acceleration_m_s2(self) -> float:
        """Its largest acceleration [m/s²]."""
        return next(demand.value for demand in self.demands if demand.name == "acceleration")


def _sample_times(joints: Sequence[float]) -> list[float]:
    """Return the times at which a trajectory with these ``joints`` is looked at [s]."""
    times: list[float] = []
    for start, end in zip(joints, joints[1:], strict=False):
        count = min(max(math.ceil((end - start) / STEP_S), FEWEST), MOST)
        times += [start + n * ((end - start) / count) for n in range(count)]
    return [*times, joints[-1]]


def check_feasibility(
    trajectory: Trajectory,
    vehicle: Vehicle,
    limits: LimitsConfig,
    *,
    gravity: float,
    floor_z_m: float,
) -> FeasibilityReport:
    """Compute the demands of all of ``trajectory``.

    The floor is at ``floor_z_m`` [m, NED], ``gravity`` in [m/s²].
    """
    times = _sample_times(trajectory.joints_s)
    references = [trajectory.at(t) for t in times]
    motion = _stack(references)
    looks = _compute_demands(motion, gravity)
    places = list(zip(*(r.position_ned for r in references), strict=True))
    lowest = largest(places[2])
    above = Demand(
        name="height above the floor",
        unit="m",
        value=floor_z_m - lowest,
        time_s=times[places[2].index(lowest)],
        limit=0.0,
        least=True,
        key="flight.floor_z_m",
        ok=floor_z_m - lowest >= 0.0,
    )
    wanted = demands(times, looks, vehicle, limits)
    return FeasibilityReport(
        duration_s=trajectory.duration_s,
        span_s=times[-1],
        length_m=sum(
            0.5 * (a.speed + b.speed) * (t - s)
            for a, b, s, t in zip(looks, looks[1:], times, times[1:], strict=False)
        ),
        start_speed_m_s=math.hypot(*references[0].velocity_ned),
        lowest_ned=(min(places[0]), min(places[1]), min(places[2])),
        highest_ned=(max(places[0]), max(places[1]), lowest),
        demands=(above, *wanted),
        share=1.0
        if all(demand.ok for demand in wanted)
        else _share(times, motion, vehicle, limits, gravity),
        inconsistency=find_inconsistency(trajectory, times, references),
    )


def find_inconsistency(
    trajectory: Trajectory, times: Sequence[float], references: Sequence[Reference]
) -> Inconsistency | None:
    """Compare what ``trajectory`` declares with the differences of its positions, ``references`` at
    ``times`` [s].

    Each derivative is compared with the difference quotient of what it is the derivative of, over a
    few milliseconds after each instant. A single instant that differs may be one at which a formula
    takes over from another; two in a row are not. A trajectory without end must stay where it was
    in its first turn.
    """
    before: Inconsistency | None = None
    corner: Inconsistency | None = None
    for k, (start_s, end_s) in enumerate(zip(times, times[1:], strict=False)):
        span_s = 0.5 * min(end_s - start_s, STEP_S)
        if span_s <= 0.0:
            continue
        jump = _find_jump(start_s, end_s, references[k], references[k + 1])
        if jump is not None:
            return jump
        is_stop = trajectory.duration_s is not None and end_s >= trajectory.duration_s
        if corner is None and not is_stop:
            corner = _find_corner(start_s, end_s, references[k], references[k + 1])
        found = _compare(start_s, span_s, references[k], trajectory.at(start_s + span_s))
        if found is not None and before is not None:
            return before
        before = found
    return corner or _look_further(trajectory, times[-1], references)


def _find_jump(start_s: float, end_s: float, a: Reference, b: Reference) -> Inconsistency | None:
    """Find a step of the position between two samples that its velocity does not explain."""
    lasts_s = end_s - start_s
    speed = max(math.hypot(*a.velocity_ned), math.hypot(*b.velocity_ned))
    hardest = max(math.hypot(*a.acceleration_ned), math.hypot(*b.acceleration_ned), 1.0)
    far = math.dist(a.position_ned, b.position_ned)
    if far <= JUMP_M + 1.1 * lasts_s * (speed + lasts_s * hardest):
        return None
    return Inconsistency(
        time_s=start_s, name="velocity", declared=speed, found=far / lasts_s, unit="m/s"
    )


def _find_corner(start_s: float, end_s: float, a: Reference, b: Reference) -> Inconsistency | None:
    """Find a step of velocity or yaw between two samples that acceleration or yaw rate do not
    explain.
    """
    lasts_s = end_s - start_s
    hardest = max(math.hypot(*a.acceleration_ned), math.hypot(*b.acceleration_ned))
    quickest = max(math.hypot(*a.jerk_ned), math.hypot(*b.jerk_ned))
    rate = max(abs(a.yaw_rate_rad_s), abs(b.yaw_rate_rad_s))
    faster = math.dist(a.velocity_ned, b.velocity_ned)
    turned = abs(math.remainder(b.yaw_rad - a.yaw_rad, math.tau))
    if faster > JUMP_M_S + 1.1 * lasts_s * (hardest + lasts_s * quickest):
        return Inconsistency(
            time_s=start_s,
            name="acceleration",
            declared=hardest,
            found=faster / lasts_s,
            unit="m/s²",
        )
    if turned > JUMP_RAD + 1.1 * lasts_s * (rate + lasts_s):
        return Inconsistency(
            time_s=start_s, name="yaw rate", declared=rate, found=turned / lasts_s, unit="rad/s"
        )
    return None


def _compare(time_s: float, span_s: float, a: Reference, b: Reference) -> Inconsistency | None:
    """Compare the derivatives of two samples ``span_s`` apart [s] with their differences.

    None where they agree, to a tenth and a tolerance that is chosen for rounded points.
    """
    # Name, unit and tolerance; the quantity and its declared derivative at both samples.
    tables = (
        ("velocity", "m/s", 0.05, a.position_ned, b.position_ned, a.velocity_ned, b.velocity_ned),
        (
            "acceleration",
            "m/s²",
            0.3,
            a.velocity_ned,
            b.velocity_ned,
            a.acceleration_ned,
            b.acceleration_ned,
        ),
        ("jerk", "m/s³", 5.0, a.acceleration_ned, b.acceleration_ned, a.jerk_ned, b.jerk_ned),
    )
    for name, unit, tolerance, first, last, one, other in tables:
        found = [(y - x) / span_s for x, y in zip(first, last, strict=True)]
        declared = [0.5 * (x + y) for x, y in zip(one, other, strict=True)]
        length = math.hypot(*declared)
        if not math.dist(found, declared) <= tolerance + 0.1 * max(length, math.hypot(*found)):
            return Inconsistency(
                time_s=time_s, name=name, declared=length, found=math.hypot(*found), unit=unit
            )
    turned = math.remainder(b.yaw_rad - a.yaw_rad, math.tau) / span_s
    rate = 0.5 * (a.yaw_rate_rad_s + b.yaw_rate_rad_s)
    if abs(turned - rate) <= 0.1 + 0.1 * max(abs(turned), abs(rate)):
        return None
    return Inconsistency(time_s=time_s, name="yaw rate", declared=rate, found=turned, unit="rad/s")


def _look_further(
    trajectory: Trajectory, span_s: float, references: Sequence[Reference]
) -> Inconsistency | None:
    """Find the fault of an endless trajectory that leaves the box of its first ``span_s`` [s], or
    differs from itself.

    As before, two differences in a row count.
    """
    if trajectory.duration_s is not None or span_s <= 0.0:
        return None
    box = [
        (min(axis), max(axis))
        for axis in zip(*(one.position_ned for one in references), strict=True)
    ]
    half_s = 0.5 * STEP_S
    for time_s in _sample_times((span_s, span_s + LOOKED_AT_S)):
        first, middle_s = trajectory.at(time_s), time_s + half_s
        second = trajectory.at(middle_s)
        beyond = [
            max(low - at, at - high, 0.0)
            for at, (low, high) in zip(first.position_ned, box, strict=True)
        ]
        if not math.hypot(*beyond) <= BOX_SPARE_M:
            far = math.hypot(*beyond)
            return Inconsistency(time_s=time_s, name="period", declared=span_s, found=far, unit="m")
        found = _compare(time_s, half_s, first, second)
        if found is not None:
            third = trajectory.at(time_s + 2.0 * half_s)
            if _compare(middle_s, half_s, second, third) is not None:
                return found
    return None


def _stack(references: Sequence[Reference]) -> PathMotion:
    """Return the motion of all ``references``, as arrays: their demands are computed at once."""
    import numpy as np

    columns: Any = zip(
        *(
            (r.velocity_ned, r.acceleration_ned, r.jerk_ned, r.yaw_rad, r.yaw_rate_rad_s)
            for r in references
        ),
        strict=True,
    )
    numbers: list[Any] = [np.array(column).T for column in columns]
    return PathMotion(*numbers)


def _compute_demands(motion: PathMotion, gravity: float) -> list[MotionDemand]:
    """Return the demand of each instant of ``motion``, whose numbers are arrays."""
    import numpy as np

    with np.errstate(invalid="ignore"):  # what is not a number keeps no limit
        found: Any = compute_demand(motion, gravity, arrays())
    numbers = (column.tolist() for column in found[:4])
    rates = zip(*(rate.tolist() for rate in found.rates), strict=True)
    return [MotionDemand(*one) for one in zip(*numbers, rates, strict=True)]


def _share(
    times: list[float],
    motion: PathMotion,
    vehicle: Vehicle,
    limits: LimitsConfig,
    gravity: float,
) -> float | None:
    """Find the largest share of its speed at which it keeps the limits, height aside.

    None without one.
    """

    def keeps_limits(share: float) -> bool:
        looks = _compute_demands(motion.slow_down(share), gravity)
        return all(demand.ok for demand in demands(times, looks, vehicle, limits))

    low, high = 1e-3, 1.0
    if not keeps_limits(low):
        return None
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if keeps_limits(middle) else (low, middle)
    return low
