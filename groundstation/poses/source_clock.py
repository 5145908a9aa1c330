"""A source's own time stamps on our clock, without any exchange of clocks. Sans-IO.

A message can only arrive late, never early: the smallest difference between arrival and stamp seen so far tells
where the source's zero lies on our clock, and a message that was held up still gets the time that it is true for.
Stamps may be seconds or mere frame numbers. How much of our time passes between two of them is measured as the
median slope from the least delayed message of one half second to that of the next, which bursts, stalls and steps do
not move.
The minimum itself slowly forgets, so that it follows what the slope has not yet seen.
"""

import math
from collections import deque
from itertools import pairwise
from statistics import median

CREEP = 0.01
"""The offset may rise by this share of the time that passes, whatever arrives."""
FORGET_S = 3.0
"""Above that it approaches later arrivals with this time constant [s]: a queue that stays is believed that late."""
FORGET_AT_FIRST_S = 1.0
"""The same while the slope is not known yet [s]."""
RESTART_S = 1.0
"""A source that sends only old stamps for this long has started its clock anew [s]."""
BLOCK_S = 0.5
"""One least delayed message is kept of each so long [s]."""
BLOCKS = 20
"""How many of them tell the slope."""
TRUSTED_BLOCKS = 4
"""So many, at least."""
WRONG_SCALE = 0.02
"""Where we were told a slope that is off by more than this share, what is known of the offset is worth nothing."""
STEP_S = 0.2
"""Stamps that run ahead of the arrivals by more than this from one message to the next are a step of the clock [s]."""
AVERAGED = 20
"""Over so many messages the usual interval is averaged."""
GAP_INTERVALS = 2.5
"""Stamps further apart than so many usual intervals are a gap."""


class SourceClock:
    """The clock of one source."""

    def __init__(self, seconds_per_unit: float = 1.0) -> None:
        """Nothing seen yet; ``seconds_per_unit`` is the nominal time from one stamp to the next higher number [s]."""
        self.restarts = 0
        """How often the source's clock began anew."""
        self.steps = 0
        """How often it leapt ahead."""
        self.gaps = 0
        """How often messages were missing."""
        self.interval_s = 0.0
        """Usual time from one message to the next, by the source [s]; 0 before the second."""
        self._nominal = self._scale = seconds_per_unit
        self._stamp: float | None = None
        self._own_s = 0.0  # the last stamp in our seconds, from an arbitrary zero
        self._offset_s = 0.0
        self._arrival_s = 0.0
        self._seen = 0
        self._old_since_s: float | None = None
        self._blocks: deque[tuple[float, float]] = deque(maxlen=BLOCKS)
        self._block: tuple[float, float] | None = None
        self._block_end_s = -math.inf
        self._forget_s = FORGET_AT_FIRST_S

    @property
    def drift(self) -> float:
        """How much slower than nominal the source's clock runs, as a share of the time that passes."""
        return self._scale / self._nominal - 1.0

    def stale(self, stamp: float, arrival_s: float) -> str:
        """Why a message stamped ``stamp`` must be dropped; an empty string where it must not.

        ``duplicate`` or ``out_of_order``; ``arrival_s`` is on our clock [s].
        """
        if self._stamp is None or stamp > self._stamp:
            return ""
        if stamp == self._stamp:
            return "duplicate"
        if self._old_since_s is None:
            self._old_since_s = arrival_s
        if arrival_s - self._old_since_s <= RESTART_S:
            return "out_of_order"
        self._stamp = None
        self.restarts += 1
        return ""

    def time_s(self, stamp: float, arrival_s: float) -> float:
        """When a message that is not stale left its source [s, our clock]: ``arrival_s`` or earlier."""
        own = 0.0
        offset = arrival_s
        if self._stamp is not None:
            elapsed = (stamp - self._stamp) * self._scale
            own = self._own_s + elapsed
            offset = arrival_s - own
            waited = arrival_s - self._arrival_s
            self._count(elapsed, waited)
            late = offset - self._offset_s
            if late > 0.0:
                # Whatever had piled up comes at once: that is no time in which to forget.
                offset = min(offset, self._offset_s + min(elapsed, waited) * (CREEP + late / self._forget_s))
        self._stamp, self._own_s, self._offset_s, self._old_since_s = stamp, own, offset, None
        self._arrival_s = arrival_s
        self._seen += 1
        if self._learn(stamp, arrival_s):
            self._offset_s = arrival_s - own
            self.interval_s, self._seen = 0.0, 1
            return arrival_s
        return own + offset

    def _count(self, elapsed_s: float, waited_s: float) -> None:
        if elapsed_s - waited_s > STEP_S:
            self.steps += 1
            return
        longest = GAP_INTERVALS * self.interval_s
        if self._seen > 10 and elapsed_s > longest:
            self.gaps += 1
            elapsed_s = longest
        self.interval_s += (elapsed_s - self.interval_s) / min(self._seen, AVERAGED)

    def _learn(self, stamp: float, arrival_s: float) -> bool:
        """Take one message into the measured slope; True where the one that we were told was far off."""
        best = self._block
        if best is None or arrival_s - best[1] < (stamp - best[0]) * self._scale:
            self._block = (stamp, arrival_s)
        if arrival_s < self._block_end_s:
            return False
        if self._block_end_s > -math.inf and self._block is not None:
            self._blocks.append(self._block)
        self._block, self._block_end_s = None, arrival_s + BLOCK_S
        if len(self._blocks) < TRUSTED_BLOCKS:
            return False
        # Neighbours only: a step or a restart of the clock spoils one slope, and a median does not mind one.
        slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(self._blocks) if b[0] != a[0]]
        scale = median(slopes) if slopes else self._scale
        if not 0.01 < scale / self._nominal < 100.0:
            return False
        first, self._forget_s = self._forget_s == FORGET_AT_FIRST_S, FORGET_S
        wrong = first and abs(scale / self._scale - 1.0) > WRONG_SCALE
        self._scale = scale
        return wrong
