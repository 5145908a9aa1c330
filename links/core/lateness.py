"""Histogram of the lateness of frames. Pure."""

from array import array
from bisect import bisect_left
from itertools import accumulate

_LATEST_US = 2**23 - 1
"""Whatever is later counts as this [µs]."""
_BITS = 9
"""Bins of 1 µs below 2**9 µs; above, each is 1/256 of its octave wide, 0.4 %."""


class Lateness:
    """Counts by lateness."""

    def __init__(self) -> None:
        self.count = 0
        """Number of added frames [-]."""
        self.octaves = [0] * (_LATEST_US.bit_length() + 1)
        """Entry k: how many were late by less than 2**k µs, and not by less than 2**(k-1)."""
        self._bins = array("L", [0] * (_bin(_LATEST_US) + 1))
        self._top = 0

    def add(self, late_s: float) -> None:
        """One frame that left ``late_s`` [s] after its instant; early counts as in time."""
        late_us = min(max(int(late_s * 1e6), 0), _LATEST_US)
        at = _bin(late_us)
        self._bins[at] += 1
        self.octaves[late_us.bit_length()] += 1
        self.count += 1
        self._top = max(self._top, at)

    def percentiles_us(self) -> tuple[int, int, int]:
        """The lateness that 50 %, 99 % and 99.9 % of the frames did not exceed [µs].

        Zeros where there are none.
        """
        sums = list(accumulate(self._bins[: self._top + 1]))
        p50, p99, p999 = (
            _end_us(bisect_left(sums, share * self.count)) for share in (0.5, 0.99, 0.999)
        )
        return (p50, p99, p999) if self.count else (0, 0, 0)


def _bin(late_us: int) -> int:
    shift = max(0, late_us.bit_length() - _BITS)
    return (shift << (_BITS - 1)) + (late_us >> shift)


def _end_us(at: int) -> int:
    """The last microsecond that belongs to bin ``at``."""
    shift = max(0, (at >> (_BITS - 1)) - 1)
    return ((at - (shift << (_BITS - 1)) + 1) << shift) - 1
