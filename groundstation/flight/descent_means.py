"""Means by which a flight comes down after its poses have failed: by what still answers. Sans-IO."""

import math
from collections.abc import Callable
from enum import IntEnum

from groundstation.core.geometry import Quat
from groundstation.core.pilot import Pilot
from links.core import Attitude

AUTOPILOT_S = 0.3
"""Age up to which the autopilot's own attitude is flown by after the poses' has failed [s]: three of its messages at
10 Hz."""
BRAKED_M_S = 1.0
"""Speed by the model below which the autopilot is asked to land by its own position [m/s]: LAND of PX4 and ArduPilot
brakes by 2 m/s² only, so what false poses have made fast is braked by us before."""
BLIND_SINK_M_S = 0.7
"""Mean sink rate of a blind descent [m/s], from which follows when it is over: its height shows nothing."""
BLIND_MORE_S = 1.0
"""Time beyond that [s]: braking comes before, and what held the vehicle may let it go."""


class Means(IntEnum):
    """Means, each worse than the last."""

    POSITION = 0
    """Everything of the poses still answers: an ordinary landing."""
    ATTITUDE = 1
    """Only their attitude answers: a descent with speed and place from the model."""
    AUTOPILOT = 2
    """The autopilot's own attitude is heard: the same by that."""
    NOTHING = 3
    """Commands end with a bring-down: nothing answers, or the autopilot lands by its own position."""
    FLOOR = 4
    """Commands end with motors off: by its time the blind descent is over."""


class DescentMeans:
    """Choice of the means of one flight. Times are on the event loop's clock [s]."""

    def __init__(self, pilot: Pilot, lands_by_own_position: Callable[[float], bool]) -> None:
        """``lands_by_own_position`` tells whether the autopilot can land by a position of its own at an instant [s]."""
        self._pilot, self._lands = pilot, lands_by_own_position
        self._heard_s, self._over_s = -math.inf, math.inf
        self.chosen = Means.POSITION
        """Means chosen last."""

    @property
    def ends_commands(self) -> bool:
        """Whether the last command has been made."""
        return self.chosen >= Means.NOTHING

    def end(self) -> None:
        """End commands."""
        self.chosen = Means.NOTHING

    def descend_blind(self, now_s: float, height_m: float) -> None:
        """Note that a blind descent begins at no more than ``height_m`` above the floor."""
        self._over_s = now_s + height_m / BLIND_SINK_M_S + BLIND_MORE_S

    def hear_attitude(self, told: Attitude, in_poses: Quat, now_s: float) -> None:
        """Take the autopilot's attitude, in the axes of the poses, too."""
        self._heard_s = now_s
        if self.chosen is Means.AUTOPILOT:
            self._pilot.take_autopilot_attitude(told.time_s, in_poses)

    def choose(self, now_s: float) -> Means:
        """Choose the best means that is left."""
        if not self.ends_commands:
            self.chosen = self._find(now_s)
        return self.chosen

    def _find(self, now_s: float) -> Means:
        health, is_blind = self._pilot.health, self._pilot.is_blind
        if health.position_answers:
            return Means.POSITION
        if is_blind and self._pilot.speed_aside_m_s < BRAKED_M_S and self._lands(now_s):
            return Means.NOTHING
        if is_blind and now_s > self._over_s:
            return Means.FLOOR
        if health.attitude_answers:
            return Means.ATTITUDE
        return Means.AUTOPILOT if now_s - self._heard_s < AUTOPILOT_S else Means.NOTHING
