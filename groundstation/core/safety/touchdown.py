"""Hovering and touching down, by thrust and vertical speed, as autopilots tell them, and by standing poses. Sans-IO."""

import math
from collections import deque
from typing import Annotated

import msgspec

from groundstation.core.messages import Pose
from groundstation.core.vehicle import GRAVITY

LOW_SHARE = 0.75
"""On the floor thrust falls below this share of the hover thrust, as the reference goes on down [-]."""
STILL_M_S = 0.12
"""Slower than this the vehicle does not sink any more [m/s]."""
LASTING_S = 0.2
"""Time of both after which it stands near the floor [s]."""
CERTAIN_S = 1.0
"""Time of both after which it stands elsewhere [s]: on a table, or in somebody's hand."""
TOUCHES_S = 0.03
"""Time without sinking, though told to, after which something may carry it [s]: sideways control must not lean it."""
FOLLOWS = 0.25
"""Share of the sink rate told below which it does not sink, near the floor with any thrust [-]."""
PUSHED_M_S = 0.25
"""Speed upwards beside its thrust that only the floor gives [m/s]: an estimate whose speed wanders may sink on."""
PUSHED_S = 0.3
"""Time over which that speed is counted [s]."""
HELD_M_S = 0.4
"""As certain is one that is slower than this for as long though its thrust is so low [m/s]: in the air it would pass
from this speed up to this speed down within half a second. An autopilot's own speed wanders by more than what is still.
"""
BEHIND_M = 0.3
"""Near the floor it also stands where it does not follow and is so far above its reference [m]: not every controller
lets thrust fall that low."""
NEAR_M = 0.3
"""Near the floor is below this height [m]."""
REST_M = 0.15
"""Height below which a height that stays may be the floor's [m]."""
RESTS_M = 0.015
"""Largest change of a height that stays [m]."""
LEFT_M = 0.05
"""Height at which it may stay from the beginning on [m]; higher up, a frozen picture does the same."""
SANK_M = 0.03
"""Way down since it was told to sink that shows a height to be no frozen one [m]."""
REST_S = 0.4
"""Time for which a height must stay [s].

That counts whatever the estimate says: between few poses the model falls on through the floor, and is then thrown up.
"""
REST_WAY_M = 0.1
"""Way that it must be told to sink meanwhile [m]."""
GAP_S = 0.3
"""Of poses further apart than this nobody knows where it was between them [s]: late ones begin where they ceased."""


class LandingConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the vehicle comes down. Config section ``[landing]``."""

    approach_m: Annotated[
        float,
        msgspec.Meta(
            ge=0.05, le=2.0, description="From this height above the floor on it sinks at `touchdown_m_s` [m]."
        ),
    ] = 0.25
    touchdown_m_s: Annotated[
        float, msgspec.Meta(ge=0.05, le=0.5, description="Speed of the last part, until it touches down [m/s].")
    ] = 0.25


class Hover:
    """The thrust that hovers, as commanded: a mean over a hold."""

    def __init__(self) -> None:
        self._sum = 0.0
        self._count = 0

    def see(self, thrust_n: float) -> None:
        """Take one command of a hold [N]."""
        self._sum += thrust_n
        self._count += 1

    @property
    def thrust_n(self) -> float | None:
        """Mean commanded thrust [N]; None before the first command."""
        return self._sum / self._count if self._count else None


class Touchdown:
    """Whether the vehicle has come to stand while it is told to sink."""

    def __init__(self, hover_n: float) -> None:
        self._hover_n, self._low_n = hover_n, LOW_SHARE * hover_n
        self._since_s: float | None = None
        self._held_since_s: float | None = None
        self.touches = False
        """Whether something may carry it by now, though that is not sure yet."""
        self._refuses_since_s: float | None = None
        self._newest: tuple[float, float] | None = None
        self._pushed_m_s = 0.0
        self._before_s: float | None = None
        """When the newest pose came before it was told to sink [s]."""
        self._highest_m = -math.inf
        """Of the poses since."""
        self._stand: deque[tuple[float, float]] = deque()
        """The newest poses whose heights agree: when they came [s], whatever their stamps say, and how high [m]."""

    def stands(self, pose: Pose, height_m: float, sinks_m_s: float) -> bool:
        """Whether the poses by themselves say that it stands on the floor; ``pose`` is the newest one.

        ``height_m`` is its height above the floor, ``sinks_m_s`` how fast the vehicle is told to sink.
        """
        stand = self._stand
        if not sinks_m_s > 0.0:
            self._before_s, self._highest_m = None, -math.inf
            stand.clear()
            return False
        if self._before_s is None:
            self._before_s = pose.arrival_s
        self._highest_m = max(self._highest_m, height_m)
        if height_m > REST_M or pose.arrival_s <= self._before_s:
            stand.clear()
            return False
        if not stand or pose.arrival_s > stand[-1][0]:
            if stand and pose.arrival_s - stand[-1][0] > GAP_S:
                stand.clear()
            while stand and any(abs(height_m - height) > RESTS_M for _, height in stand):
                stand.popleft()
            stand.append((pose.arrival_s, height_m))
        there = height_m <= LEFT_M or self._highest_m - height_m >= SANK_M
        return there and stand[-1][0] - stand[0][0] >= max(REST_S, REST_WAY_M / sinks_m_s)

    def update(
        self,
        time_s: float,
        thrust_n: float,
        lift_n: float,
        sinking_m_s: float,
        height_m: float,
        behind_m: float,
        sinks_m_s: float,
    ) -> bool:
        """Whether it stands, by one more command of a descent.

        ``thrust_n`` is that command's, ``lift_n`` what its rotors lift at present [N]; ``sinking_m_s`` and ``height_m``
        are the vehicle's speed and height above the floor, ``behind_m`` is how far it is above its reference: inf where
        it has none but to sink, and then standing must last longer to be believed. ``sinks_m_s`` is how fast it is told
        to sink.
        """
        near, pushed_m_s = height_m < NEAR_M, self._push(time_s, lift_n, sinking_m_s)
        slow_m_s = STILL_M_S if thrust_n < self._low_n else FOLLOWS * sinks_m_s if near else -math.inf
        if not -HELD_M_S <= sinking_m_s <= slow_m_s or sinks_m_s <= STILL_M_S:
            self._refuses_since_s = None
        elif self._refuses_since_s is None:
            self._refuses_since_s = time_s
        refuses_s = -math.inf if self._refuses_since_s is None else time_s - self._refuses_since_s
        self.touches = refuses_s >= TOUCHES_S or (near and sinks_m_s > STILL_M_S and pushed_m_s > PUSHED_M_S)
        # One that has become lighter hovers with as little, but sinks with its reference.
        if thrust_n < self._low_n and abs(sinking_m_s) <= HELD_M_S and behind_m > BEHIND_M:
            self._held_since_s = time_s if self._held_since_s is None else self._held_since_s
            if time_s - self._held_since_s >= CERTAIN_S:
                return True
        else:
            self._held_since_s = None
        refuses = thrust_n < self._low_n or (near and behind_m > BEHIND_M)
        if not refuses or abs(sinking_m_s) > STILL_M_S:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = time_s
        sure = near and (thrust_n < self._low_n or behind_m < math.inf)
        return time_s - self._since_s >= (LASTING_S if sure else CERTAIN_S)

    def _push(self, time_s: float, lift_n: float, sinking_m_s: float) -> float:
        """How much something has pushed it up of late, beside its rotors [m/s]."""
        if self._newest is not None:
            elapsed_s, sank_m_s = time_s - self._newest[0], self._newest[1]
            falls_m_s = GRAVITY * (1.0 - lift_n / self._hover_n) * elapsed_s
            keep = math.exp(-elapsed_s / PUSHED_S)
            self._pushed_m_s = keep * self._pushed_m_s + falls_m_s - (sinking_m_s - sank_m_s)
        self._newest = time_s, sinking_m_s
        return self._pushed_m_s
