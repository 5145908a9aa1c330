"""The path that was flown, smoothed, with derivatives: what the shadow is asked to follow.

What the recorded flight was meant to follow is not in the recording. What it did follow is: so the reference at each
instant is a polynomial fitted to the poses around it (local regression; Savitzky and Golay's filter, but for uneven
stamps), later poses included, as the whole path is known afterwards. A controller that understands the vehicle
needs the same thrust and rates along it as those that were sent; it is not judged on where it would have flown.

The reference speaks of what the estimator is shown. Where poses carry a velocity, the estimator takes it for the
motion and lets the positions wander against it; so there the velocity and its derivatives are those of the recorded
velocities, and only the position is that of the positions. Where poses carry none, all is that of the positions.
"""

import math

import numpy as np
import numpy.typing as npt

from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import Pose
from groundstation.core.trajectory import Reference

HALF_WIDTH_S = 0.4
"""Poses this near take part in the fit [s]; weights fall to zero there, so that nothing jumps."""
ORDER = 4
"""Degree of the polynomial over positions: one above the jerk. Over velocities one less gives the same motion."""
FEWEST = 2 * (ORDER + 1)
"""Without this many poses around it an instant has no reference; without as many velocities it takes positions."""
UNKNOWN: Vec3 = (math.nan, math.nan, math.nan)

Array = npt.NDArray[np.float64]


class FlownPath:
    """Position, velocity and heading of one vehicle over time."""

    def __init__(self, poses: list[Pose], longest_gap_s: float) -> None:
        """Take poses in order of time; the path breaks at a gap longer than ``longest_gap_s`` [s] and at a reset."""
        self._time: Array = np.array([pose.time_s for pose in poses], np.float64)
        yaw = np.unwrap([so3.euler_zyx(pose.attitude)[2] for pose in poses])
        self._places: Array = np.column_stack([np.array([pose.position_ned for pose in poses], np.float64), yaw])
        self._velocities: Array = np.array([pose.velocity_ned or UNKNOWN for pose in poses], np.float64)
        resets = np.array([pose.reset_count for pose in poses])
        starts = np.flatnonzero((np.diff(self._time) > longest_gap_s) | (np.diff(resets) != 0)) + 1
        self._starts = [0, *starts.tolist(), len(poses)]

    def at(self, time_s: float) -> Reference | None:
        """The path at ``time_s`` [s], with derivatives to the jerk; None where too few poses are around it."""
        around = self._around(time_s)
        if around is None:
            return None
        time, velocities = self._time[around] - time_s, self._velocities[around]
        place, rate, *rest = _fitted(time, self._places[around], ORDER)
        motion = [rate[:3], *(derivative[:3] for derivative in rest)]
        known = np.isfinite(velocities[:, 0])
        # At the first pose with a velocity half of the window has one: from there on they do.
        if FEWEST <= np.count_nonzero(known) >= 0.5 * len(known):
            motion = _fitted(time[known], velocities[known], ORDER - 1)
        (x0, y0, z0, yaw), yaw_rate = place, rate[3]
        (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = motion[:3]
        return Reference((x0, y0, z0), (x1, y1, z1), (x2, y2, z2), (x3, y3, z3), yaw, yaw_rate)

    def velocity_of_positions(self, time_s: float) -> Vec3 | None:
        """How fast the recorded positions move at ``time_s`` [s], whatever velocities say [m/s]; None as in ``at``."""
        around = self._around(time_s)
        if around is None:
            return None
        x, y, z, _ = _fitted(self._time[around] - time_s, self._places[around], ORDER)[1]
        return (x, y, z)

    def _around(self, time_s: float) -> slice | None:
        """The poses within the half width of ``time_s``, of the same piece; None where they are too few."""
        after = int(np.searchsorted(self._time, time_s, "right"))
        piece = int(np.searchsorted(self._starts, after - 1, "right"))
        if not 0 < piece < len(self._starts):
            return None
        first, end = self._starts[piece - 1], self._starts[piece]
        low = max(first, int(np.searchsorted(self._time, time_s - HALF_WIDTH_S, "right")))
        high = min(end, int(np.searchsorted(self._time, time_s + HALF_WIDTH_S, "left")))
        return None if high - low < FEWEST or time_s > self._time[end - 1] else slice(low, high)


def _fitted(time_s: Array, values: Array, order: int) -> list[list[float]]:
    """Value and derivatives at time 0 of the polynomial of degree ``order`` through ``values`` (N, K)."""
    x = time_s / HALF_WIDTH_S
    root_weight = (1.0 - np.abs(x) ** 3) ** 1.5
    design = np.vander(x, order + 1, increasing=True) * root_weight[:, None]
    origin = values[0]  # small numbers, whatever the lab's origin
    fit = np.linalg.lstsq(design, (values - origin) * root_weight[:, None], rcond=None)[0]
    fit[0] += origin
    return [(math.factorial(k) / HALF_WIDTH_S**k * fit[k]).tolist() for k in range(order + 1)]
