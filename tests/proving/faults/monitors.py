"""Monitors that a flight of the deck goes on with: the real ones, none, or one that is forced to
doubt.

A flight comes to its strike with the real monitor and guards; its copies differ from there on.
"""

import math
from typing import Any

from groundstation.config import ConfigError
from groundstation.core.messages import NOTICES, Pose
from groundstation.core.pilot import Pilot
from groundstation.core.safety import (
    GuardFinding,
    Guards,
    HealthState,
    Monitors,
    PoseGate,
    PoseHealth,
)
from links.core import LinkStatus
from sim.text import notice

UNGUARDED = "off"
"""Neither monitor nor guards."""
SUSPECT = "suspect"
"""Poses that are suspect."""
FAILED = "failed:"
"""Poses that have failed, for the reason whose id follows."""
NOT_BY_ATTITUDE = ("pose.attitude_no_answer", "pose.autopilot_disagrees", "pose.late")
"""Reasons after which the attitude of the poses is not flown by, either."""


def check_forced(doubt: str) -> None:
    """Check that ``doubt`` can be forced upon a flight.

    Raises:
        ConfigError: it can't.
    """
    reasons = [reason for reason in NOTICES if reason.startswith("pose.")]
    known = ["", SUSPECT, *(f"{FAILED}{reason}" for reason in reasons)]
    if doubt not in known:
        raise ConfigError("--forced", notice("value.choice", choices=known[1:], found=doubt))


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


class DeckMonitors:
    """Monitors of one flight, and how it goes on with them."""

    def __init__(self) -> None:
        self._guards: DeckGuards | None = None

    def factories(self) -> Monitors:
        """Return what :func:`groundstation.flight.make_flight` takes."""
        return Monitors(health=DeckHealth, guards=self._make_guards)

    def go_on(self, pilot: Pilot, watch: str, from_s: float) -> None:
        """Go on as ``watch`` says; a forced doubt begins at ``from_s`` [s]."""
        health = pilot.state.health
        assert isinstance(health, DeckHealth), "made by these"
        if watch == UNGUARDED:
            health.switch_off()
            pilot.state._gate = OpenGate()
            if self._guards is not None:
                self._guards.is_off = True
        elif watch:
            health.force(watch, from_s)

    def _make_guards(self, *args: Any, **kwargs: Any) -> Guards:
        self._guards = DeckGuards(*args, **kwargs)
        return self._guards
