"""Monitors that a flight of the deck goes on with: the real ones, none, or with a forced doubt.

A flight comes to its strike with the real monitor and guards; its copies differ from there on.
"""

import math
from typing import Any

from groundstation.core.health import HealthState, PoseGate, PoseHealth
from groundstation.core.messages import Pose
from groundstation.core.pilot import Monitors
from groundstation.core.safety import GuardFinding, Guards
from groundstation.flight import Flight
from links.core import LinkStatus

UNGUARDED = "off"
"""Neither monitor nor guards."""
SUSPECT = "suspect"
"""Poses that are suspect."""
FAILED = "failed:"
"""Poses that have failed, for the reason whose id follows."""
NOT_BY_ATTITUDE = ("pose.attitude_no_answer", "pose.autopilot_disagrees", "pose.late")
"""Reasons after which the attitude of the poses is not flown by, either."""
FAILURES = (
    *NOT_BY_ATTITUDE,
    "pose.height_behind", "pose.position_mirrored", "pose.position_no_answer",
    "pose.stopped_dead", "pose.yaw_unasked",
)  # fmt: skip
"""All reasons for which poses fail."""


class DeckHealth(PoseHealth):
    """Pose health that may be switched off, or forced to doubt, in flight."""

    _is_off = False
    _doubt = ""
    _doubt_s = math.inf

    def switch_off(self) -> None:
        """Doubt nothing from now on."""
        self._is_off = True
        self._believe()

    def force(self, doubt: str, from_s: float) -> None:
        """Doubt the first pose after ``from_s`` [s] as ``doubt`` says."""
        self._doubt, self._doubt_s = doubt, from_s

    def add_pose(self, pose: Pose, *args: Any, **kwargs: Any) -> None:
        """Take one pose, as the real one does."""
        super().add_pose(pose, *args, **kwargs)
        if self._is_off:
            self._believe()
        elif pose.time_s >= self._doubt_s:
            self._doubt_s = math.inf
            if self._doubt == SUSPECT:
                self.suspect(pose.time_s)
            else:
                self.fail(self._doubt.removeprefix(FAILED), pose.time_s)

    def suspect(self, now_s: float) -> None:
        """Ask the poses, unless switched off."""
        if not self._is_off:
            super().suspect(now_s)

    def _believe(self) -> None:
        self.state, self.reason_id = HealthState.OK, ""
        self.attitude_alarm = self.position_alarm = self.alarm = 0.0
        self.is_attitude_usable = self.is_position_usable = True


class DeckGuards(Guards):
    """Guards that may be switched off in flight."""

    is_off = False

    def check_command(self, *args: Any, **kwargs: Any) -> GuardFinding | None:
        """Return what the real ones find."""
        return None if self.is_off else super().check_command(*args, **kwargs)

    def check_link(self, status: LinkStatus, now_s: float) -> GuardFinding | None:
        """Return what the real ones find."""
        return None if self.is_off else super().check_link(status, now_s)


class OpenGate(PoseGate):
    """Gate that rejects nothing."""

    def accepts(self, *args: Any, **kwargs: Any) -> bool:
        """Return True."""
        return True


MONITORS = Monitors(health=DeckHealth, guards=DeckGuards)
"""Monitors of a flight of the deck."""


def go_on(flight: Flight, watch: str, from_s: float) -> None:
    """Go on with other monitors: none at all, or with a doubt that begins at ``from_s`` [s]."""
    state, guards = flight._pilot.state, flight._controller._guards
    assert isinstance(state.health, DeckHealth), "made by these"
    if watch == UNGUARDED:
        state.health.switch_off()
        state._gate = OpenGate()
        if isinstance(guards, DeckGuards):
            guards.is_off = True
    elif watch:
        state.health.force(watch, from_s)
