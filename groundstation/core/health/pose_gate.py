"""Pose gate: rejects poses that the vehicle cannot have reached from the last ones. Sans-IO.

Two believed poses give position and velocity. From one pose to the next the model adds the effect
of the commands, and no hand, gust or cable adds more than ``PUSH_M_S2``. After a rejected pose only
the model is known: poses are believed again where they fit its position and its velocity. A
rejected pose is no pose: after ``flight.coast_s`` the descent begins.
"""

import math
from collections import deque
from typing import NamedTuple, Protocol, TypeVar

from groundstation.core.estimation import HIGHLY_SIGNIFICANT
from groundstation.core.geometry import Vec3, add_scaled, scale, subtract
from groundstation.core.messages import Pose
from groundstation.core.vehicle import Motion

PUSH_M_S2 = 10.0
"""Largest acceleration beside the commanded one [m/s²]: 1 g, more than any hand gives a vehicle in
flight."""
HELD_SHARE = 1.2
"""Acceleration that what holds the vehicle may take, as a share of what the commands give [-]: 1 at
rest, more where a cable springs; swapped axes seem to take 1.41."""
DRIFT_M_S2 = 1.0
"""Error of the model's acceleration while no pose is believed [m/s²]: gusts of `storm`, one
sigma."""
BASE_S = 0.018
"""Least time over which a velocity is taken from two poses [s]: at 50 Hz that is one interval;
faster poses are too noisy one by one."""
REJOIN_BASE_S = 3.0 * BASE_S
"""Least time after a rejected pose over which a velocity is taken from two poses [s]."""
PUSH_BASE_S = REJOIN_BASE_S
"""Time over which each of two successive velocities is taken for the acceleration between them
[s]."""
REJOIN_M = 0.003
"""Error of the model's position at a rejected pose [m]: the estimate's own error in `storm`."""
REJOIN_M_S = 0.05
"""Error of the model's velocity at a rejected pose [m/s]: as above."""
KEPT = 60
"""Poses that are kept [-]: .25 s at 240 Hz."""


class PoseGate:
    """Gate of one flight."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Believe the next pose in any case."""
        self._believed: deque[Pose] = deque(maxlen=KEPT)
        self._rejected: deque[Pose] = deque(maxlen=KEPT)

    @property
    def is_shut(self) -> bool:
        """Whether the newest pose was rejected."""
        return bool(self._rejected)

    @property
    def _is_lost(self) -> bool:
        """Whether more than one pose was rejected: it was not that pose alone."""
        return len(self._rejected) > 1

    def accepts(self, pose: Pose, now: Motion, ahead: Motion, noise_m: float) -> bool:
        """Whether ``pose`` is believed.

        Args:
            pose: the newest one.
            now: the model's motion at the last believed pose.
            ahead: the same at the instant of ``pose``.
            noise_m: noise of the positions, 1 sigma per axis [m].
        """
        believed = self._believed
        if not believed or pose.reset_count != believed[-1].reset_count:
            self.restart()
            self._believed.append(pose)
            return True
        if self._is_lost:
            return self._rejoins(pose, ahead, noise_m)
        if self._is_reachable(pose, now, ahead, noise_m):
            self._rejected.clear()
            believed.append(pose)
            return True
        self._rejected.append(pose)
        return False

    def _is_reachable(self, pose: Pose, now: Motion, ahead: Motion, noise_m: float) -> bool:
        """Whether the vehicle can have reached ``pose`` from the last believed ones."""
        last = self._believed[-1]
        base = _newest_before(self._believed, last.time_s - BASE_S)
        if base is None:
            return True
        dt, h = pose.time_s - last.time_s, last.time_s - base.time_s
        k, half = dt / h, 0.5 * (dt + h)
        expected = [
            p + k * (p - q) + half * (u - v)
            for p, q, u, v in zip(
                last.position_ned, base.position_ned, ahead.velocity, now.velocity, strict=True
            )
        ]
        noise = HIGHLY_SIGNIFICANT * noise_m * math.sqrt(1.0 + (1.0 + k) ** 2 + k * k)
        return math.dist(pose.position_ned, expected) <= noise + PUSH_M_S2 * dt * half

    def _rejoins(self, pose: Pose, ahead: Motion, noise_m: float) -> bool:
        """Whether ``pose`` and the rejected ones before it fit the model.

        Then they are believed.
        """
        base = _newest_before(self._rejected, pose.time_s - REJOIN_BASE_S)
        self._rejected.append(pose)
        if base is None:
            return False
        since_s, h = pose.time_s - self._believed[-1].time_s, pose.time_s - base.time_s
        speed: Vec3 = tuple(  # type: ignore[assignment]  # of three
            (p - q) / h for p, q in zip(pose.position_ned, base.position_ned, strict=True)
        )
        noise = HIGHLY_SIGNIFICANT * noise_m
        place_m = (
            2.0 * noise + REJOIN_M + REJOIN_M_S * since_s + 0.5 * DRIFT_M_S2 * since_s * since_s
        )
        speed_m_s = 1.5 * noise / h + REJOIN_M_S + DRIFT_M_S2 * since_s
        if (
            math.dist(pose.position_ned, ahead.position) > place_m
            or math.dist(speed, ahead.velocity) > speed_m_s
        ):
            return False
        self._believed.clear()
        self._believed.extend(self._rejected)
        self._rejected.clear()
        return True


class PushMonitor:
    """Monitor of the acceleration that no command explains, over intervals in which noise is small
    against it.

    From one pose to the next 1 g may be hidden in the noise. A push is up to 1 g, and what holds a
    vehicle takes little more than its commands give. A mirrored position seems pushed against the
    commands by twice what they give: by more than both from a tilt of 30 degrees on.
    """

    def __init__(self) -> None:
        self._path: deque[_PathPoint] = deque(maxlen=KEPT)

    def add(self, time_s: float, measured_m: Vec3, model_m: Vec3, noise_m: float) -> float:
        """Take one pose; return the unexplained acceleration as a share of the largest that is
        believed [-].

        Args:
            time_s: its instant [s].
            measured_m: its position [m, NED].
            model_m: displacement of the model since any begin [m, NED].
            noise_m: noise of the positions, 1 sigma per axis [m].
        """
        self._path.append(_PathPoint(time_s, measured_m, model_m))
        middle = _newest_before(self._path, time_s - PUSH_BASE_S)
        first = None if middle is None else _newest_before(self._path, middle.time_s - PUSH_BASE_S)
        if middle is None or first is None:
            return 0.0
        h, k = middle.time_s - first.time_s, time_s - middle.time_s
        measured = _accelerate(first.measured_m, middle.measured_m, measured_m, h, k)
        model = _accelerate(first.model_m, middle.model_m, model_m, h, k)
        noise_m_s2 = (
            2.0
            / (h + k)
            * HIGHLY_SIGNIFICANT
            * noise_m
            * math.hypot(1.0 / h, 1.0 / h + 1.0 / k, 1.0 / k)
        )
        most_m_s2 = max(PUSH_M_S2, HELD_SHARE * math.hypot(*model)) + DRIFT_M_S2 + noise_m_s2
        return math.dist(measured, model) / most_m_s2


class _PathPoint(NamedTuple):
    """One instant of the path of the poses, and of the model's."""

    time_s: float
    measured_m: Vec3
    model_m: Vec3


def _accelerate(first: Vec3, middle: Vec3, last: Vec3, h: float, k: float) -> Vec3:
    """Mean acceleration of a path [m/s²] by three places [m] that are ``h`` and ``k`` apart [s]."""
    return scale(
        2.0 / (h + k),
        add_scaled(scale(1.0 / k, subtract(last, middle)), -1.0 / h, subtract(middle, first)),
    )


class _Timed(Protocol):
    """Anything with an instant [s]."""

    @property
    def time_s(self) -> float: ...


T = TypeVar("T", bound=_Timed)


def _newest_before(records: deque[T], time_s: float) -> T | None:
    return next((one for one in reversed(records) if one.time_s <= time_s), None)
