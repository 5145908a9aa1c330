"""How late frames left, as a histogram that costs nothing to add to. Pure."""

from array import array
from bisect import bisect_left
from itertools import accumulate

_BINS = 50_000
"""One a microsecond; whatever is later goes into the last."""


class Lateness:
    """Counts by microsecond."""

    def __init__(self) -> None:
        self.count = 0
        """How many were added."""
        self._bins = array("L", bytes(_BINS * array("L").itemsize))
        self._top = 0

    def add(self, late_s: float) -> None:
        """One frame that left ``late_s`` [s] after its instant; early counts as in time."""
        at = min(max(int(late_s * 1e6), 0), _BINS - 1)
        self._bins[at] += 1
        self.count += 1
        self._top = max(self._top, at)

    def percentiles_us(self) -> tuple[int, int, int]:
        """The lateness that 50 %, 99 % and 99.9 % of the frames did not exceed [µs]; zeros where there are none."""
        sums = list(accumulate(self._bins[: self._top + 1]))
        p50, p99, p999 = (bisect_left(sums, share * self.count) for share in (0.5, 0.99, 0.999))
        return (p50, p99, p999) if self.count else (0, 0, 0)
