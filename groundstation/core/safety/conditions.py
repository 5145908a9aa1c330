"""Conditions over time: how long each has held. Sans-IO."""

import math

LONGEST_STEP_S = 0.1
"""Longest time between two commands that counts for a share [s]: a pause is no oscillation."""


class Since:
    """Time for which each of several conditions has held, by name.

    Times are on the event loop's clock [s].
    """

    def __init__(self) -> None:
        self._since: dict[str, float] = {}

    def held_s(self, name: str, holds: bool, now_s: float) -> float:
        """Return the time for which the condition has held at every call [s]; -inf if it does not
        hold now.
        """
        if not holds:
            self._since.pop(name, None)
            return -math.inf
        return now_s - self._since.setdefault(name, now_s)


class RecentTime:
    """Time for which a condition held of late, breaks included: older time is forgotten
    exponentially.
    """

    def __init__(self, memory_s: float) -> None:
        """``memory_s``: time constant of forgetting [s]."""
        self._memory_s = memory_s
        self._at_s, self._held_s = -math.inf, 0.0

    def add(self, holds: bool, now_s: float) -> float:
        """Take one sample; return the time for which the condition held of late [s]."""
        elapsed, self._at_s = now_s - self._at_s, now_s
        self._held_s *= math.exp(-elapsed / self._memory_s)
        if holds:
            self._held_s += min(elapsed, LONGEST_STEP_S)
        return self._held_s
