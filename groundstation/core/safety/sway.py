"""A vehicle that swings, as told by how long it has lately leant far from where it should. Sans-IO."""

import math

FADES_S = 1.0
"""Time that it leant far off is forgotten so fast [s]."""
LONGEST_S = 0.1
"""No two commands count as farther apart [s]."""


class Sway:
    """One flight's lean. Times are on the event loop's clock [s]."""

    def __init__(self, fades_s: float = FADES_S) -> None:
        """Nothing seen; it is forgotten within ``fades_s`` [s]."""
        self._fades_s = fades_s
        self._at_s = -math.inf
        self._far_s = 0.0

    def see(self, now_s: float, far: bool) -> float:
        """Take one more command; ``far`` where it leans far off, on whichever side.

        Returns for how long of about the last second it did [s].
        """
        elapsed, self._at_s = now_s - self._at_s, now_s
        self._far_s *= math.exp(-elapsed / self._fades_s)
        if far:
            self._far_s += min(elapsed, LONGEST_S)
        return self._far_s
