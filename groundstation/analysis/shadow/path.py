"""Flown path: smoothed, with derivatives, as the shadow is asked to follow it; and which part of it is flight.

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

from groundstation.analysis.shadow.recording import RecordedVehicle, SentSetPoint
from groundstation.core.geometry import Vec3, so3, third_column
from groundstation.core.messages import Pose
from groundstation.core.trajectory import Reference
from links.core import thrust

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
        place, rate, *rest = _fit_polynomial(time, self._places[around], ORDER)
        motion = [rate[:3], *(derivative[:3] for derivative in rest)]
        known = np.isfinite(velocities[:, 0])
        # At the first pose with a velocity half of the window has one: from there on they do.
        if FEWEST <= np.count_nonzero(known) >= 0.5 * len(known):
            motion = _fit_polynomial(time[known], velocities[known], ORDER - 1)
        (x0, y0, z0, yaw), yaw_rate = place, rate[3]
        (x1, y1, z1), (x2, y2, z2), (x3, y3, z3) = motion[:3]
        return Reference((x0, y0, z0), (x1, y1, z1), (x2, y2, z2), (x3, y3, z3), yaw, yaw_rate)

    def velocity_of_positions(self, time_s: float) -> Vec3 | None:
        """How fast the recorded positions move at ``time_s`` [s], whatever velocities say [m/s]; None as in ``at``."""
        around = self._around(time_s)
        if around is None:
            return None
        x, y, z, _ = _fit_polynomial(self._time[around] - time_s, self._places[around], ORDER)[1]
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


def _fit_polynomial(time_s: Array, values: Array, order: int) -> list[list[float]]:
    """Value and derivatives at time 0 of the polynomial of degree ``order`` through ``values`` (N, K)."""
    x = time_s / HALF_WIDTH_S
    root_weight = (1.0 - np.abs(x) ** 3) ** 1.5
    design = np.vander(x, order + 1, increasing=True) * root_weight[:, None]
    origin = values[0]  # small numbers, whatever the lab's origin
    fit = np.linalg.lstsq(design, (values - origin) * root_weight[:, None], rcond=None)[0]
    fit[0] += origin
    return [(math.factorial(k) / HALF_WIDTH_S**k * fit[k]).tolist() for k in range(order + 1)]


CARRIES = 0.85
"""A vehicle in the air carries its weight: over one second the mean thrust is at least this share of hover.

At less it would gain 1.5 m/s downwards in that second; one that stands on the ground is at far less. The autopilot's
own landed_state does not do alone: PX4 calls a vehicle flying until seconds after it stands.
"""
MEAN_S = 1.0
"""That second [s]."""
STEADY_M_S, STEADY_M_S2 = 0.5, 1.0
"""Hover thrust is read where the vertical speed and the vertical acceleration stay below these,"""
STEADY_COS_TILT = 0.99
"""and the vehicle is level within 8 deg: some autopilots add thrust of their own to what is sent where it tilts."""
LEAST_SHARE = 0.05
"""Below this share of full thrust no vehicle flies."""
FEWEST_SET_POINTS = 25
"""So many set-points at least must hover thrust be read from."""

Flags = npt.NDArray[np.bool_]


def thrust_shares(sent: list[SentSetPoint], curve: float) -> list[float]:
    """Thrust as a share 0..1 of full thrust, for each set-point; ``curve``: see links/core/thrust_curve.py."""
    return [thrust(min(max(each.signal, 0.0), 1.0), curve) for each in sent]


def flying(recording: RecordedVehicle, shares: list[float], hover: float | None) -> Flags:
    """For each pose (N,), whether the vehicle was in the air on set-points.

    ``hover`` is the share of full thrust that carries it; without it, what the autopilot says must do.
    """
    may_fly: Flags = np.array([seen.may_fly for seen in recording.poses])
    if hover is None:
        return may_fly
    sent_at, arrival = _times(recording)
    first = np.searchsorted(sent_at, arrival - 0.5 * MEAN_S)
    end = np.searchsorted(sent_at, arrival + 0.5 * MEAN_S)
    total = np.concatenate(([0.0], np.cumsum(shares)))
    mean = (total[end] - total[first]) / np.maximum(end - first, 1)
    carried: Flags = may_fly & (mean >= CARRIES * hover)
    return carried


def hover_share(recording: RecordedVehicle, shares: list[float], path: FlownPath, gravity: float) -> float | None:
    """Share 0..1 of full thrust that carries the weight: the median over steady flight; None without any.

    At each set-point, T/T_max cos(tilt) g = hover (g - z¨). The lag is left out: in steady flight thrust hardly
    changes. The first value tells what was on the ground, the second leaves that out.
    """
    sent_at, arrival = _times(recording)
    newest = np.searchsorted(arrival, sent_at, "right") - 1
    value = np.full(len(shares), np.nan)
    for i, share in enumerate(shares):
        if newest[i] >= 0 and share > LEAST_SHARE and recording.poses[newest[i]].may_fly:
            value[i] = _hover_at(recording, newest[i], share, path, gravity)
    estimate: float | None = None
    for _ in range(2):
        used = value[flying(recording, shares, estimate)[newest] & np.isfinite(value)]
        if len(used) < FEWEST_SET_POINTS:
            return None
        estimate = float(np.median(used))
    return estimate


def _times(recording: RecordedVehicle) -> tuple[Array, Array]:
    """When set-points were sent (M,) and when poses arrived (N,) [s]."""
    sent_at = np.array([each.time_s for each in recording.sent], np.float64)
    return sent_at, np.array([seen.pose.arrival_s for seen in recording.poses], np.float64)


def _hover_at(recording: RecordedVehicle, index: int, share: float, path: FlownPath, gravity: float) -> float:
    pose = recording.poses[index].pose
    reference = path.at(pose.time_s)
    if reference is None:
        return np.nan
    speed, acceleration = reference.velocity_ned[2], reference.acceleration_ned[2]
    cos_tilt = third_column(pose.attitude)[2]
    if abs(speed) > STEADY_M_S or abs(acceleration) > STEADY_M_S2 or cos_tilt < STEADY_COS_TILT:
        return np.nan
    return share * cos_tilt * gravity / (gravity - acceleration)
