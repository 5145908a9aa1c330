"""The guards of what is around a vehicle: the fence, and other vehicles that the cameras see, or should. Sans-IO."""

import math

from groundstation.core.safety.escalation import Finding, Since, Step
from groundstation.core.safety.fence import Fence
from groundstation.core.safety.separation import Separation
from groundstation.core.vehicle.model import Motion

SURE_S = 0.06
"""What the cameras tell of others must last so long [s]: one pose alone may be another body's."""


class Surroundings:
    """One flight's. Times are on the event loop's clock [s]."""

    def __init__(self, fence: Fence | None, separation: Separation | None) -> None:
        """``separation`` is from other vehicles."""
        self._fence = fence
        self._separation = separation
        self._since = Since()

    def outside(self, motion: Motion) -> Finding | None:
        """Beyond the fence, or too fast before it."""
        if self._fence is None:
            return None
        room = self._fence.room_m(motion.position)
        if room < 0.0:
            return Finding(Step.LAND, f"{-room:.2f} m outside the fence")
        if self._fence.braking_room_m(motion.position, motion.velocity) < 0.0:
            speed = math.hypot(*motion.velocity)
            return Finding(Step.HOLD, f"{room:.2f} m before the fence at {speed:.1f} m/s: braking")
        return None

    def near(self, motion: Motion, now_s: float) -> Finding | None:
        """Too near to another vehicle: it brakes in time, and lands where that was not enough.

        Down upon another would be worse than to stay: the one that is lower lands.
        """
        separation = self._separation
        if separation is None:
            return None
        near = separation.nearest(motion.position, motion.velocity, now_s)
        limit = separation.config.distance_m
        if self._since.lasts("too near", near is not None and not near.distance_m >= limit, now_s, SURE_S):
            assert near is not None, "somebody is near"
            step = Step.HOLD if near.beneath else Step.LAND
            return Finding(step, f"{near.distance_m:.2f} m from {near.name}, limit {limit:g} m", most=step)
        if self._since.lasts("nearing", near is not None and not near.room_m >= 0.0, now_s, SURE_S):
            assert near is not None, "somebody comes nearer"
            return Finding(Step.HOLD, f"{near.distance_m:.2f} m from {near.name} and nearing: braking", most=Step.LAND)
        return None

    def unseen(self, now_s: float) -> Finding | None:
        """Where the cameras do not see another vehicle, nobody knows how near it is."""
        if self._separation is None:
            return None
        config, names = self._separation.config, self._separation.unknown(now_s)
        lasts = self._since.lasts("unseen", bool(names), now_s, config.unknown_s)
        if not names:
            return None
        says = f"the cameras have not seen {', '.join(names)} for more than {config.stale_s:g} s"
        step = {"warn": Step.WARN, "hold": Step.HOLD, "land": Step.LAND}[config.unknown] if lasts else Step.WARN
        return Finding(step, says, most=step)
