"""From the floor into the air: thrust rises until the floor is left, whatever the thrust really lifts. Sans-IO.

No law flies on the floor, where position does not answer to thrust and adaptation would learn the floor's push as
wind. Thrust rises quickly to a share of the weight that lifts nothing, then slowly, so that the vehicle leaves the
floor with hardly more lift than weight: what it then has is the thrust that hovers.
"""

from collections import deque
from typing import Annotated

import msgspec

from groundstation.ops import Vec3
from groundstation.poses.port import Pose

SURE_SHARE = 0.6
"""Share of the weight that thrust reaches within ``spool_s`` [-]."""
SLOW_PER_S = 0.25
"""How fast it rises from there, as a share of the weight [1/s]: at lift-off 2.5 m/s² more each second."""
LIFTED_M = 0.015
"""Lifted is so far above where it stood [m], ..."""
LIFTED_POSES = 2
"""... in so many poses one after the other: one alone may be noise."""
REST_POSES = 50
"""Where it stands is the mean of so many poses."""


class TakeoffConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the vehicle leaves the floor. Config section ``[takeoff]``."""

    height_m: Annotated[float, msgspec.Meta(ge=0.2, le=20.0)] = 1.0
    """Height above the floor at which it holds before and after the trajectory [m]."""
    spool_s: Annotated[float, msgspec.Meta(ge=0.2, le=10.0)] = 1.0
    """Time in which the rotors are brought up to 60 % of the weight [s]."""
    climb_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=5.0)] = 0.5
    """Fastest speed of the climb [m/s]."""
    hold_s: Annotated[float, msgspec.Meta(ge=1.0, le=600.0)] = 3.0
    """How long it holds, measuring its hover thrust, before it goes on to the trajectory [s]."""
    transit_m_s: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 0.5
    """Fastest speed of the ways onto the trajectory and back [m/s]; where it begins faster, it is met at its own."""
    transit_m_s2: Annotated[float, msgspec.Meta(gt=0.0, le=20.0)] = 1.0
    """Largest acceleration of these ways, of the climb and of stopping [m/s²]."""


class Spool:
    """Thrust on the floor as a function of time, and whether the floor has been left."""

    def __init__(self, weight_n: float, most_n: float, spool_s: float, idle_n: float, start_s: float) -> None:
        """Begin at ``start_s`` [s] with ``idle_n`` [N]; thrust is never told to be above ``most_n`` [N]."""
        self._weight = weight_n
        self.most_n = most_n
        self._spool = spool_s
        self._idle = idle_n
        self._start = start_s

    def thrust_n(self, time_s: float) -> float:
        """Thrust to command at ``time_s`` [N]."""
        since = max(time_s - self._start, 0.0)
        sure = max(SURE_SHARE * self._weight, self._idle)
        if since < self._spool:
            x = since / self._spool
            return self._idle + (sure - self._idle) * x * x * (3.0 - 2.0 * x)
        return min(sure + SLOW_PER_S * self._weight * (since - self._spool), self.most_n)

    def exhausted(self, time_s: float) -> bool:
        """Whether thrust has been at its limit for a second, in which it would have lifted."""
        return self.thrust_n(time_s - 1.0) >= self.most_n


class Standing:
    """Poses of a vehicle that stands, and whether it still does."""

    def __init__(self) -> None:
        """Nothing seen."""
        self.poses: deque[Pose] = deque(maxlen=REST_POSES)
        """The newest of them."""
        self._above = 0

    def stands(self, pose: Pose) -> None:
        """Take a pose of a vehicle whose motors don't lift."""
        if self.poses and self.poses[-1].reset_count != pose.reset_count:
            self.poses.clear()  # the source has moved its origin
        self.poses.append(pose)

    @property
    def place_ned(self) -> Vec3:
        """Where it stands [m]. Needs a pose."""
        n = len(self.poses)
        north, east, down = (sum(pose.position_ned[axis] for pose in self.poses) / n for axis in range(3))
        return north, east, down

    def lifts(self, pose: Pose) -> bool:
        """Whether it has left the floor, by one more pose while thrust rises."""
        up = self.place_ned[2] - pose.position_ned[2]
        self._above = self._above + 1 if up > LIFTED_M else 0
        return self._above >= LIFTED_POSES
