"""Which part of a recording is flight on set-points, and how much thrust carried the vehicle."""

import numpy as np
import numpy.typing as npt

from groundstation.analysis.shadow.path import FlownPath
from groundstation.analysis.shadow.recording import Recording, Sent
from groundstation.core.geometry import third_column
from links.core import thrust

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
FEWEST = 25
"""So many set-points at least must hover thrust be read from."""

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


def thrust_shares(sent: list[Sent], curve: float) -> list[float]:
    """Thrust as a share 0..1 of full thrust, for each set-point; ``curve``: see links/core/thrust_curve.py."""
    return [thrust(min(max(each.signal, 0.0), 1.0), curve) for each in sent]


def flying(recording: Recording, shares: list[float], hover: float | None) -> Flags:
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


def hover_share(recording: Recording, shares: list[float], path: FlownPath, gravity: float) -> float | None:
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
        if len(used) < FEWEST:
            return None
        estimate = float(np.median(used))
    return estimate


def _times(recording: Recording) -> tuple[Array, Array]:
    """When set-points were sent (M,) and when poses arrived (N,) [s]."""
    sent_at = np.array([each.time_s for each in recording.sent], np.float64)
    return sent_at, np.array([seen.pose.arrival_s for seen in recording.poses], np.float64)


def _hover_at(recording: Recording, index: int, share: float, path: FlownPath, gravity: float) -> float:
    pose = recording.poses[index].pose
    reference = path.at(pose.time_s)
    if reference is None:
        return np.nan
    speed, acceleration = reference.velocity_ned[2], reference.acceleration_ned[2]
    cos_tilt = third_column(pose.attitude)[2]
    if abs(speed) > STEADY_M_S or abs(acceleration) > STEADY_M_S2 or cos_tilt < STEADY_COS_TILT:
        return np.nan
    return share * cos_tilt * gravity / (gravity - acceleration)
