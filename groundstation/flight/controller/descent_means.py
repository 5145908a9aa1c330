"""Means by which a flight comes down after its poses have failed: the best that still responds.

Sans-IO.
"""

import math
from enum import IntEnum

from groundstation.core.geometry import Quat
from groundstation.core.pilot import Pilot
from links.core import Attitude, CommandLink

AUTOPILOT_S = 0.3
"""Age up to which the autopilot's own attitude replaces that of the poses [s]: three of its
messages at 10 Hz."""
BRAKED_M_S = 1.0
"""Speed by the model below which the autopilot is asked to land by its own position [m/s]: LAND of
PX4 and ArduPilot brakes by 2 m/s² only, so a vehicle that false poses have made fast is braked by
the model before."""


class Means(IntEnum):
    """Means, each worse than the last."""

    POSITION = 0
    """The poses still respond: an ordinary landing."""
    ATTITUDE = 1
    """Only their attitude responds: a descent with speed and place from the model."""
    AUTOPILOT = 2
    """The autopilot's own attitude arrives: the same by that."""
    NOTHING = 3
    """Commands end with a bring-down: nothing responds, or the autopilot lands by its own
    position."""
    FLOOR = 4
    """Commands end with motors off: the time of the blind descent is over."""


class DescentMeans:
    """Choice of the means of one flight. Times are on the event loop's clock [s]."""

    def __init__(self, pilot: Pilot, link: CommandLink) -> None:
        self._pilot, self._link = pilot, link
        self._attitude_s, self._over_s = -math.inf, math.inf
        self.chosen = Means.POSITION
        """Means chosen last."""

    @property
    def ends_commands(self) -> bool:
        """Whether the last command has been made."""
        return self.chosen >= Means.NOTHING

    def end_blind_descent_at(self, over_s: float) -> None:
        """Stop the motors of a blind descent at ``over_s``: its height is not measured."""
        self._over_s = over_s

    def end_commands(self) -> None:
        """End the commands with a bring-down: they arrive too late."""
        self.chosen = Means.NOTHING

    def take_attitude(self, attitude: Attitude, in_poses: Quat, now_s: float) -> None:
        """Take the autopilot's attitude, and the same in the axes of the poses."""
        self._attitude_s = now_s
        if self.chosen is Means.AUTOPILOT:
            self._pilot.take_autopilot_attitude(attitude.time_s, in_poses)

    def choose(self, now_s: float) -> Means:
        """Choose the best means that is left; the end of the commands is final."""
        if self.ends_commands:
            return self.chosen
        pilot, autopilot = self._pilot, self._link.autopilot
        slow = pilot.state.is_blind and pilot.state.speed_aside_m_s < BRAKED_M_S
        if pilot.state.health.is_position_usable:
            self.chosen = Means.POSITION
        elif slow and autopilot is not None and autopilot.could_land_by_itself(now_s):
            self.chosen = Means.NOTHING
        elif pilot.state.is_blind and now_s > self._over_s:
            self.chosen = Means.FLOOR
        elif pilot.state.health.is_attitude_usable:
            self.chosen = Means.ATTITUDE
        else:
            self.chosen = (
                Means.AUTOPILOT if now_s - self._attitude_s < AUTOPILOT_S else Means.NOTHING
            )
        return self.chosen
