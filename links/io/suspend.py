"""Whether this computer has slept: CLOCK_MONOTONIC, which every deadline is on, stands still meanwhile.

What was fresh when a laptop's lid was closed would pass for fresh when it is opened.
"""

import time
from collections.abc import Callable

SHORTEST_S = 0.01
"""A sleep [s]; below, the two clocks were only read one after the other."""
OURS_S = 0.05
"""A clock so close to this machine's is this machine's [s]."""

_AWAKE_OR_NOT = getattr(time, "CLOCK_BOOTTIME", None)
"""The clock that goes on in sleep; None where there is none, as on macOS."""


def _ahead_s() -> float:
    """By how much it is ahead. A program that stands still between the two looks sees less than that, never more."""
    if _AWAKE_OR_NOT is None:
        return 0.0
    return time.clock_gettime(_AWAKE_OR_NOT) - time.monotonic()


class Sleep:
    """Watches from its making on."""

    def __init__(self, now_s: Callable[[], float]) -> None:
        """``now_s`` is the owner's clock; one that is not this machine's, as a simulation's, never sleeps."""
        self._counts = time.monotonic() - OURS_S < now_s() < time.monotonic() + OURS_S
        self._before_s = max(_ahead_s() for _ in range(3))

    @property
    def slept_s(self) -> float:
        """How long the computer has slept since then [s]; 0.0 where it has not, or does not tell."""
        if not self._counts:
            return 0.0
        slept = _ahead_s() - self._before_s
        return slept if slept > SHORTEST_S else 0.0
