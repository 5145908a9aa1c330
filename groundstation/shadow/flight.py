"""Which part of a recording is flight on set-points, and what the vehicle was, as far as the recording tells."""

import numpy as np
import numpy.typing as npt

from groundstation.shadow.path import Path
from groundstation.shadow.recording import Recording, Sent
from groundstation.so3 import third_column
from links.thrust_curve import thrust

CARRIES = 0.85
"""A vehicle in the air carries its weight: over one second the mean thrust is at least this share of hover.

At less it would be 1.5 m/s faster down after that second; one that stands on the ground is at far less. The
autopilot's own landed_state alone does not do: PX4 may call a vehicle flying that has stood for ten seconds.
"""
MEAN_S = 1.0
"""Over this long [s]."""
STEADY_M_S, STEADY_M_S2 = 0.5, 1.0
"""Hover thrust is read where the vertical speed and the acceleration stay below these."""
LEAST_SIGNAL = 0.05
"""Below this no vehicle flies."""
FEWEST = 25
"""Set-points that hover thrust may be read from."""

Flags = npt.NDArray[np.bool_]


def thrust_shares(sent: list[Sent], curve: float) -> list[float]:
    """Thrust as a share 0..1 of full thrust, for each set-point; ``curve``: see links/thrust_curve.py."""
    return [thrust(min(max(each.signal, 0.0), 1.0), curve) for each in sent]


def flying(recording: Recording, shares: list[float], hover: float | None) -> Flags:
    """For each pose (N,), whether the vehicle was in the air on set-points; without any, as the autopilot says."""
    may_fly: Flags = np.array([seen.may_fly for seen in recording.poses])
    if hover is None:
        return may_fly
    sent_at = np.array([each.time_s for each in recording.sent])
    arrival = np.array([seen.pose.arrival_s for seen in recording.poses])
    first = np.searchsorted(sent_at, arrival - 0.5 * MEAN_S)
    end = np.searchsorted(sent_at, arrival + 0.5 * MEAN_S)
    total = np.concatenate(([0.0], np.cumsum(shares)))
    mean = (total[end] - total[first]) / np.maximum(end - first, 1)
    carried: Flags = may_fly & (mean >= CARRIES * hover)
    return carried


def hover_share(recording: Recording, shares: list[float], path: Path, gravity: float) -> float | None:
    """Share 0..1 of full thrust that carries the weight: the median over steady flight; None without any.

    Vertically T/T_max cos(tilt) g = hover (g - z¨), lag left out, as thrust hardly changes in steady flight.
    """
    estimate: float | None = None
    for _ in range(2):  # with a first value, what was on the ground can be told
        flags = flying(recording, shares, estimate)
        values = [
            value
            for index, share in _sent_while(recording, flags, shares)
            if (value := _hover_at(recording, index, share, path, gravity)) is not None
        ]
        if len(values) < FEWEST:
            return None
        estimate = float(np.median(values))
    return estimate


def _sent_while(recording: Recording, flags: Flags, shares: list[float]) -> list[tuple[int, float]]:
    """(index of the newest pose, share) of every set-point sent in flight."""
    arrival = np.array([seen.pose.arrival_s for seen in recording.poses])
    sent_at = np.array([each.time_s for each in recording.sent])
    newest = np.searchsorted(arrival, sent_at, "right") - 1
    return [
        (int(index), share)
        for index, share in zip(newest, shares, strict=True)
        if index >= 0 and flags[index] and share > LEAST_SIGNAL
    ]


def _hover_at(recording: Recording, index: int, share: float, path: Path, gravity: float) -> float | None:
    pose = recording.poses[index].pose
    reference = path.at(pose.time_s)
    if reference is None or abs(reference.velocity_ned[2]) > STEADY_M_S:
        return None
    if max(map(abs, reference.acceleration_ned)) > STEADY_M_S2:
        return None
    return share * third_column(pose.attitude)[2] * gravity / (gravity - reference.acceleration_ned[2])
