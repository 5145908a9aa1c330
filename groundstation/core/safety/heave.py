"""A thrust that swings about its mean, as told by how long it was far below it and far above. Sans-IO.

Poses that come late and commands that get lost make the height swing as well as the lean. Up in the air the lean shows
it in time; near the floor the next trough of the thrust is a fall.
"""

import math

MEAN_S = 1.5
"""Over which the thrust is averaged [s]."""
FADES_S = 1.0
"""Time that it was far off is forgotten so fast [s]."""
LONGEST_S = 0.1
"""No two commands count as farther apart [s]."""


class Heave:
    """One flight's thrust. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing seen."""
        self._at_s = -math.inf
        self._mean_n = self._low_s = self._high_s = 0.0

    def see(self, now_s: float, thrust_n: float, share: float) -> float:
        """Take one more command; far off is more than ``share`` of the mean, and never where that is infinite.

        Returns for how long of about the last second it was far below or far above, whichever was shorter [s].
        """
        since_s = now_s - self._at_s
        elapsed, fades = min(since_s, LONGEST_S), math.exp(-since_s / FADES_S)
        if self._at_s == -math.inf:
            self._mean_n = thrust_n
        self._at_s = now_s
        self._mean_n += (thrust_n - self._mean_n) * elapsed / (elapsed + MEAN_S)
        off_n, far_n = thrust_n - self._mean_n, share * self._mean_n
        self._low_s = fades * self._low_s + (elapsed if off_n < -far_n else 0.0)
        self._high_s = fades * self._high_s + (elapsed if off_n > far_n else 0.0)
        return min(self._low_s, self._high_s)
