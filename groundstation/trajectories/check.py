"""What a trajectory asks of a vehicle in still air, held against what the vehicle and its operator allow. Pure."""

import math
from typing import Any

import msgspec

from groundstation.limits import LimitsConfig
from groundstation.ops import Vec3, arrays
from groundstation.trajectories.demands import Asked, Demand, Motion, asked, demands, largest
from groundstation.trajectories.port import Trajectory
from groundstation.vehicle import Vehicle

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
    joints = trajectory.joints_s
    span = joints[-1]
    times: list[float] = []
    for start, end in zip(joints, joints[1:], strict=False):
        count = min(max(math.ceil((end - start) / STEP_S), FEWEST), MOST)
        times += [start + n * ((end - start) / count) for n in range(count)]
    times.append(span)
    seen = [trajectory.at(t) for t in times]
    motions = [Motion(r.velocity_ned, r.acceleration_ned, r.jerk_ned, r.yaw_rad, r.yaw_rate_rad_s) for r in seen]
    looks = [asked(motion, gravity) for motion in motions]
    places = list(zip(*(r.position_ned for r in seen), strict=True))
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
    return Report(
        duration_s=trajectory.duration_s,
        span_s=span,
        length_m=sum(
            0.5 * (a.speed + b.speed) * (t - s) for a, b, s, t in zip(looks, looks[1:], times, times[1:], strict=False)
        ),
        start_speed_m_s=math.hypot(*seen[0].velocity_ned),
        lowest_ned=(min(places[0]), min(places[1]), min(places[2])),
        highest_ned=(max(places[0]), max(places[1]), lowest),
        demands=(above, *wanted),
        share=1.0 if all(demand.ok for demand in wanted) else _share(times, motions, vehicle, limits, gravity),
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


def _share(
    times: list[float], motions: list[Motion], vehicle: Vehicle, limits: LimitsConfig, gravity: float
) -> float | None:
    """The largest share of its speed, below all of it, at which it keeps the limits, height aside."""
    import numpy as np

    # All instants at once: they are looked at a dozen times.
    ops = arrays()
    whole: Any = [
        np.moveaxis(np.array(column), -1, 0) if isinstance(column[0], tuple) else np.array(column)
        for column in zip(*motions, strict=True)
    ]

    def kept(share: float) -> bool:
        at_once: Any = asked(Motion(*whole).slowed(share), gravity, ops)
        looks = zip(
            *(column.tolist() for column in at_once[:4]),
            zip(*(rate.tolist() for rate in at_once.rates), strict=True),
            strict=True,
        )
        return all(demand.ok for demand in demands(times, map(Asked._make, looks), vehicle, limits))

    low, high = 1e-3, 1.0
    if not kept(low):
        return None
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if kept(middle) else (low, middle)
    return low
