"""The path that was flown, smoothed, with derivatives: what the shadow is asked to follow.

What the recorded flight was meant to follow is not in the recording. What it did follow is: so the reference at each
instant is a polynomial fitted to the poses around it (local regression; Savitzky and Golay's filter, but for uneven
stamps), later poses included, as the whole path is known afterwards. A controller that understands the vehicle
needs the same thrust and rates along it as those that were sent; it is not judged on where it would have flown.
"""

import math

import numpy as np
import numpy.typing as npt

from groundstation import so3
from groundstation.poses.port import Pose
from groundstation.trajectories.port import Reference

HALF_WIDTH_S = 0.4
"""Poses this near take part in the fit [s]; weights fall to zero there, so that nothing jumps."""
ORDER = 4
"""Degree of the polynomial: one above the jerk."""
FEWEST = 2 * (ORDER + 1)
"""Without this many poses around it an instant has no reference."""

Array = npt.NDArray[np.float64]


class FlownPath:
    """Position and heading of one vehicle over time."""

    def __init__(self, poses: list[Pose], longest_gap_s: float) -> None:
        """Take poses in order of time; the path breaks at a gap longer than ``longest_gap_s`` [s] and at a reset."""
        self._time: Array = np.array([pose.time_s for pose in poses], np.float64)
        yaw = np.unwrap([so3.euler_zyx(pose.attitude)[2] for pose in poses])
        self._values: Array = np.column_stack([np.array([pose.position_ned for pose in poses], np.float64), yaw])
        resets = np.array([pose.reset_count for pose in poses])
        starts = np.flatnonzero((np.diff(self._time) > longest_gap_s) | (np.diff(resets) != 0)) + 1
        self._starts = [0, *starts.tolist(), len(poses)]

    def at(self, time_s: float) -> Reference | None:
        """The path at ``time_s`` [s], with derivatives to the jerk; None where too few poses are around it."""
        after = int(np.searchsorted(self._time, time_s, "right"))
        piece = int(np.searchsorted(self._starts, after - 1, "right"))
        if not 0 < piece < len(self._starts):
            return None
        first, end = self._starts[piece - 1], self._starts[piece]
        low = max(first, int(np.searchsorted(self._time, time_s - HALF_WIDTH_S, "right")))
        high = min(end, int(np.searchsorted(self._time, time_s + HALF_WIDTH_S, "left")))
        if high - low < FEWEST or time_s > self._time[end - 1]:
            return None
        x = (self._time[low:high] - time_s) / HALF_WIDTH_S
        root_weight = (1.0 - np.abs(x) ** 3) ** 1.5
        design = np.vander(x, ORDER + 1, increasing=True) * root_weight[:, None]
        origin = self._values[low]  # small numbers, whatever the lab's origin
        fit = np.linalg.lstsq(design, (self._values[low:high] - origin) * root_weight[:, None], rcond=None)[0]
        fit[0] += origin
        derivatives = [(math.factorial(k) / HALF_WIDTH_S**k * fit[k]).tolist() for k in range(4)]
        (x0, y0, z0, yaw), (x1, y1, z1, yaw_rate), (x2, y2, z2, _), (x3, y3, z3, _) = derivatives
        return Reference((x0, y0, z0), (x1, y1, z1), (x2, y2, z2), (x3, y3, z3), yaw, yaw_rate)
