"""The dead man's switch that every link has: a fresh command, or the bring-down, or nothing. Sans-IO.

A command may be repeated until its deadline. After it the bring-down that the newest command carries is played once,
and then nothing leaves that lifts. Nothing but :meth:`Deadman.arm` ends that: a command that comes late, or from a
controller that has woken up again, is refused.
"""

import math
from enum import StrEnum

from links.core.port import Command, LinkMisuse, Segment

BRING_DOWN_LIMIT_S = 2.0
"""Longest bring-down [s]: without a pose nobody knows any more where the vehicle is."""
DEADLINE_LIMIT_S = 1.1
"""Furthest deadline [s from now]: no pose vouches for more than 1 s, nor one whose stamp lies in the future (but for
the jitter of clocks)."""
NUMBER_LIMIT = 1e30
"""Largest number in a command: a 32-bit float on the wire holds it."""


class Phase(StrEnum):
    """What may leave."""

    WAITING = "waiting"
    """Armed, and no command yet: nothing leaves."""
    FRESH = "fresh"
    """The newest command, until its deadline."""
    BRING_DOWN = "bring_down"
    """The part of its bring-down whose time it is."""
    OVER = "over"
    """Nothing that lifts, until a new arming."""


class Deadman:
    """Begins in ``OVER``. Times are on one clock, the commands' [s]."""

    def __init__(self) -> None:
        self.refused = 0
        """Commands that came too late, out of order, or after the switch had opened."""
        self.held = False
        """True from :meth:`hold` on, until the next arming."""
        self._over = True
        self._command: Command | None = None

    def arm(self) -> None:
        """A new arming by the operator: commands count again."""
        self._over = False
        self.held = False
        self._command = None

    def hold(self) -> None:
        """No newer command counts: the newest one runs out, and its bring-down follows."""
        if self._command is None:
            self._over = True
        self.held = True

    def stop(self) -> None:
        """Nothing that lifts from now on: killed, disarmed, or closed."""
        self._over = True
        self._command = None

    @property
    def command(self) -> Command | None:
        """The newest command, while it or its bring-down may leave; else None."""
        return self._command

    def take(self, command: Command, now_s: float, seen_s: float | None = None) -> bool:
        """Take the newest command; False where it does not count, and then it changes nothing.

        Whoever looks for commands only once a frame says for which instant it made the last one, ``seen_s``: the switch
        has opened if it had by then. One that opened since has moved nothing yet, and the command may come in time.

        Raises:
            LinkMisuse: a number in it is not finite, its deadline is too far away, or its bring-down lasts too long.
        """
        _check(command, now_s)
        newest, opens = self._command, self.phase(now_s if seen_s is None else seen_s)
        if self.held or opens not in (Phase.WAITING, Phase.FRESH) or now_s > command.deadline_s:
            self.refused += 1
            return False
        if newest is not None and command.pose_time_s < newest.pose_time_s:
            self.refused += 1
            return False
        self._command = command
        return True

    def phase(self, now_s: float) -> Phase:
        """What may leave at ``now_s``."""
        if self._over:
            return Phase.OVER
        if self._command is None:
            return Phase.WAITING
        if now_s <= self._command.deadline_s:
            return Phase.FRESH
        if self._segment(now_s) is not None:
            return Phase.BRING_DOWN
        self.stop()
        return Phase.OVER

    def changes_s(self, now_s: float) -> float:
        """The next instant after ``now_s`` after which something else leaves, if no command comes; inf for never."""
        if self.phase(now_s) not in (Phase.FRESH, Phase.BRING_DOWN):
            return math.inf
        command = self._command
        assert command is not None, "only a command is fresh, or brings down"
        end = command.deadline_s
        for segment in command.bring_down:
            if end >= now_s:
                break
            end += segment.duration_s
        return end

    def at(self, now_s: float) -> Command | Segment | None:
        """What leaves at ``now_s``; None where nothing that lifts may."""
        match self.phase(now_s):
            case Phase.FRESH:
                return self._command
            case Phase.BRING_DOWN:
                return self._segment(now_s)
            case _:
                return None

    def _segment(self, now_s: float) -> Segment | None:
        command = self._command
        assert command is not None, "a bring-down belongs to a command"
        end = command.deadline_s
        for segment in command.bring_down:
            end += segment.duration_s
            if now_s <= end:
                return segment
        return None


def _check(command: Command, now_s: float) -> None:
    p, q, r = command.rates_rad_s
    largest = max(abs(command.thrust_n), abs(p), abs(q), abs(r), abs(command.pose_time_s), abs(command.deadline_s))
    total = command.thrust_n + p + q + r + command.pose_time_s + command.deadline_s
    lasts = 0.0
    for part in command.bring_down:
        p, q, r = part.rates_rad_s
        lasts += part.duration_s
        largest = max(largest, abs(part.thrust_n), abs(p), abs(q), abs(r), abs(part.duration_s))
        total += part.thrust_n + p + q + r
        if not part.duration_s >= 0.0:
            raise LinkMisuse(f"a part of a bring-down has no duration: {command}")
    if not (largest <= NUMBER_LIMIT and math.isfinite(total + lasts)):  # max() may lose a NaN, the sum does not
        raise LinkMisuse(f"not finite: {command}")
    if lasts > BRING_DOWN_LIMIT_S + 1e-9:
        raise LinkMisuse(f"a bring-down lasts at most {BRING_DOWN_LIMIT_S:g} s, this one {lasts:g} s")
    if command.deadline_s - now_s > DEADLINE_LIMIT_S:
        raise LinkMisuse(f"a deadline is at most {DEADLINE_LIMIT_S:g} s away, not {command.deadline_s - now_s:g} s")
