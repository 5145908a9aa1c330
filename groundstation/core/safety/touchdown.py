"""Touchdown: ground contact by thrust and vertical speed, as autopilots detect it, and by poses at
rest. Sans-IO.
"""

import math
from collections import deque
from typing import Annotated

import msgspec

from groundstation.core.messages import Pose
from groundstation.core.safety.conditions import Since
from groundstation.core.safety.takeoff import LEG_TRAVEL_M
from groundstation.core.vehicle import GRAVITY

LOW_SHARE = 0.75
"""Share of the hover thrust below which thrust is low [-]: on the floor it becomes low as the
reference sinks on. More than limits.LEAST_THRUST_SHARE, the least thrust that a landing commands.
Chosen."""
STILL_M_S = 0.12
"""Vertical speed below which the vehicle does not sink [m/s]. Chosen; by default a landing sinks at
0.25 m/s."""
LASTING_S = 0.2
"""Duration of low thrust without sinking that is a touchdown near the floor [s]. Chosen."""
CERTAIN_S = 1.0
"""Duration of low thrust without sinking that is a touchdown anywhere [s]: on a table, or in a
hand. Chosen."""
CONTACT_S = 0.03
"""Duration of not sinking as commanded after which ground contact is possible [s]. Lateral control
would tip the vehicle: one on the floor of PX4's simulator leant by 54 degrees. Chosen."""
FOLLOWING_SHARE = 0.25
"""Share of the commanded sink rate below which a vehicle near the floor does not sink as commanded,
with any thrust [-]. Chosen."""
PUSHED_M_S = 0.25
"""Upward speed, beyond that by thrust and gravity, that only the floor gives [m/s]. PX4's own
estimate sank on while the floor of its simulator carried the vehicle. Chosen."""
PUSHED_S = 0.3
"""Time constant over which that speed is summed [s]. Chosen."""
SUSPENDED_M_S = 0.4
"""Vertical speed below which low thrust for ``CERTAIN_S`` is a touchdown, too [m/s]: in the air the
vehicle would pass from this speed upwards to this speed downwards within 0.5 s. PX4's own speed
wanders by 0.3 m/s, more than ``STILL_M_S``."""
NEAR_M = 0.3
"""Height below which the vehicle is near the floor [m]: legs and a wandering estimate included.
Ground effect begins there, so goto accepts no lower point. Chosen."""
OFF_REFERENCE_M = 0.3
"""Distance from its reference from which the vehicle does not follow it [m]: the floor, or a hand,
holds it. Not every controller lets thrust fall to ``LOW_SHARE`` then. Chosen."""
REST_M = 0.15
"""Largest height of a pose that may be at rest on the floor [m]. Chosen."""
LOW_M = 0.05
"""Height up to which a pose at rest needs no descent before it [m]. A pose that is constant higher
up may be frozen while the vehicle flies. Chosen."""
SANK_M = 0.03
"""Descent since the sink command that proves a height not to be frozen [m]. Chosen."""
REST_S = 0.4
"""Time for which a height must be constant [s]. The estimate is not used: where one of eleven poses
arrived, the model fell through the floor between them, and the next pose threw it up. Chosen."""
REST_WAY_M = 0.1
"""Descent that must be commanded in that time [m]. Chosen."""
GAP_S = 0.3
"""Longest interval of two poses over which a height counts as constant [s]: the first pose after a
longer one begins anew. Chosen."""


class LandingConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Last part of a landing. Config section ``[landing]``."""

    approach_m: Annotated[
        float,
        msgspec.Meta(
            ge=0.05,
            le=2.0,
            description="Height above the floor below which the sink rate is `touchdown_m_s` [m].",
        ),
    ] = 0.25
    touchdown_m_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.05, le=0.5, description="Sink rate below `approach_m`, until touchdown [m/s]."
        ),
    ] = 0.25


class Touchdown:
    """Detector of the end of a descent."""

    def __init__(self, hover_n: float) -> None:
        """``hover_n`` is the hover thrust [N]."""
        self._hover_n, self._low_n = hover_n, LOW_SHARE * hover_n
        self._since = Since()
        self.may_have_contact = False
        """Whether ground contact is possible, though not certain yet."""
        self._newest: tuple[float, float] | None = None
        """Instant [s] and estimated sink rate [m/s] of the newest command."""
        self._pushed_m_s = 0.0
        """Upward speed that something beside the rotors has given of late [m/s]."""
        self._before_s: float | None = None
        """Arrival of the newest pose before the sink command [s]."""
        self._highest_m = -math.inf
        """Largest height of the poses since the sink command [m]."""
        self._constant: deque[tuple[float, float]] = deque()
        """Newest poses whose heights agree: arrival [s], whatever their stamps are, and height
        [m]."""

    def detect_rest(self, pose: Pose, height_m: float, commanded_sink_m_s: float) -> bool:
        """Take the newest pose; return whether poses alone prove a vehicle at rest on the floor.

        ``height_m`` is its height above the floor, ``commanded_sink_m_s`` the commanded sink rate.
        """
        constant = self._constant
        if not commanded_sink_m_s > 0.0:
            self._before_s, self._highest_m = None, -math.inf
            constant.clear()
            return False
        if self._before_s is None:
            self._before_s = pose.arrival_s
        self._highest_m = max(self._highest_m, height_m)
        if height_m > REST_M or pose.arrival_s <= self._before_s:
            constant.clear()
            return False
        if not constant or pose.arrival_s > constant[-1][0]:
            if constant and pose.arrival_s - constant[-1][0] > GAP_S:
                constant.clear()
            while constant and any(abs(height_m - height) > LEG_TRAVEL_M for _, height in constant):
                constant.popleft()
            constant.append((pose.arrival_s, height_m))
        may_rest = height_m <= LOW_M or self._highest_m - height_m >= SANK_M
        constant_s = constant[-1][0] - constant[0][0]
        return may_rest and constant_s >= max(REST_S, REST_WAY_M / commanded_sink_m_s)

    def update(
        self,
        time_s: float,
        thrust_n: float,
        lift_n: float,
        sink_m_s: float,
        height_m: float,
        behind_m: float,
        commanded_sink_m_s: float,
    ) -> bool:
        """Take one command of a descent; return whether the vehicle has touched down.

        Args:
            time_s: instant of the command [s].
            thrust_n: commanded thrust [N].
            lift_n: vertical part of the present thrust [N].
            sink_m_s: estimated sink rate [m/s].
            height_m: estimated height above the floor [m].
            behind_m: height above the reference [m]; inf without one, and then the evidence must
                last longer.
            commanded_sink_m_s: commanded sink rate [m/s].
        """
        is_near, is_low, since = height_m < NEAR_M, thrust_n < self._low_n, self._since
        speed_m_s = abs(sink_m_s)
        pushed_m_s = self._update_push(time_s, lift_n, sink_m_s)
        # Slower than this the vehicle does not sink as commanded.
        if is_low:
            least_m_s = STILL_M_S
        elif is_near:
            least_m_s = FOLLOWING_SHARE * commanded_sink_m_s
        else:
            least_m_s = -math.inf
        shall_sink = commanded_sink_m_s > STILL_M_S
        stays = shall_sink and -SUSPENDED_M_S <= sink_m_s <= least_m_s
        is_pushed = is_near and shall_sink and pushed_m_s > PUSHED_M_S
        self.may_have_contact = since.held_s("stays", stays, time_s) >= CONTACT_S or is_pushed
        # A vehicle that has become lighter hovers with as little thrust, but sinks with its
        # reference.
        is_suspended = is_low and speed_m_s <= SUSPENDED_M_S and behind_m > OFF_REFERENCE_M
        if since.held_s("suspended", is_suspended, time_s) >= CERTAIN_S:
            return True
        is_still = speed_m_s <= STILL_M_S and (is_low or (is_near and behind_m > OFF_REFERENCE_M))
        is_sure = is_near and (is_low or behind_m < math.inf)
        return since.held_s("still", is_still, time_s) >= (LASTING_S if is_sure else CERTAIN_S)

    def _update_push(self, time_s: float, lift_n: float, sink_m_s: float) -> float:
        """Return the upward speed that something beside the rotors has given of late [m/s]."""
        if self._newest is not None:
            elapsed_s, before_m_s = time_s - self._newest[0], self._newest[1]
            falls_m_s = GRAVITY * (1.0 - lift_n / self._hover_n) * elapsed_s
            keep = math.exp(-elapsed_s / PUSHED_S)
            self._pushed_m_s = keep * self._pushed_m_s + falls_m_s - (sink_m_s - before_m_s)
        self._newest = time_s, sink_m_s
        return self._pushed_m_s
