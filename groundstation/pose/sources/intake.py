"""Pose intake: checks, the source's clock, our frames, numbers and counters, shared by every decoder. Sans-IO.

The source's clock puts its time stamps on our clock, and tells how late its messages come. A message can only come
late, never early: the smallest difference between arrival and stamp so far tells where the source's zero lies on our
clock. What comes later than that is late, however long it goes on so: a queue that stays, and one that fills, can't be
told from a clock that was set back or a frame counter that paused, and the older answer is the safe one. Three things
move the zero later: a slope that the source's clock may well have (``MAX_DRIFT``), as long as nothing is late by more
than ``SLACK_S``; an exchange of clocks, where there is one; and beginning anew.
Stamps are seconds, or numbers of frames. How much of our time passes from one to the next is measured from the least
delayed message of each half second (Theil and Sen: the median of the slopes between any two of them, which bursts and
stalls do not move). Of frames any rate is believed at first, as a told one is often wrong; from then on a
rate that is slower is lateness, too.
"""

import math
from collections import Counter, deque
from collections.abc import Sequence
from itertools import combinations
from typing import Protocol

from groundstation.core.geometry import Frames, Quat, Vec3
from groundstation.core.messages import FAR_M, Others, Pose, PoseStatus

MAX_DRIFT = 0.0015
"""So much slower than nominal may the source's clock run, as a share: what exceeds it is lateness that grows."""
SLACK_S = 0.02
"""A block whose least delayed message is late by more than this is late, and moves nothing [s]."""
BLOCK_S = 0.5
"""One least delayed message is kept of each so long [s]."""
BLOCKS = 40
"""So many of them tell the slope."""
FIRST_BLOCKS, SETTLED_BLOCKS = 5, 20
"""So many at least, where the rate of the frames is not known at all; and where a slope is to be told from jitter."""
ROUGH = MAX_DRIFT + SLACK_S / (FIRST_BLOCKS * BLOCK_S)
"""How far a rate that was measured over so few may be off, as a share."""
RATES = 100.0
"""A rate of frames that is off by more than this factor is none."""
RESTART_S = 1.0
"""A source that sends only old stamps for this long has started its clock anew [s]."""
ANEW_S = 4.0
"""After so long without a message, and with a frame as late as that, we begin anew [s]. No flight lives so long
without a fresh pose: what rests on one for 1 s at most is followed by a bring-down of 2 s."""
STEP_S = 0.2
"""A message that comes earlier by more than this than any before is a step of the source's clock [s]."""
AVERAGED = 20
"""Over so many messages the usual interval is averaged."""
GAP_INTERVALS = 2.5
"""Stamps further apart than so many usual intervals are a gap."""


class SourceClock:
    """The clock of one source."""

    def __init__(self, frame_s: float | None = None) -> None:
        """Nothing seen yet. Stamps are seconds; or frame numbers, ``frame_s`` being what the period was told to be."""
        self.restarts = 0
        """How often the source's clock began anew."""
        self.steps = 0
        """How often it leapt ahead."""
        self.gaps = 0
        """How often messages were missing."""
        self.interval_s = 0.0
        """Usual time from one message to the next, by the source [s]; 0 before the second."""
        self._frames = frame_s is not None
        self._told = 1.0 if frame_s is None else frame_s
        self._heard_s = -math.inf
        self._stamp: float | None = None
        self._old_since_s: float | None = None
        self._blocks: deque[tuple[float, float]] = deque(maxlen=BLOCKS)
        self._begin(0.0, 0.0)
        self._is_anew = True
        """Whether the next message begins it all."""

    def _begin(self, stamp: float, arrival_s: float) -> None:
        """Know nothing but what we were told, and that this message has come."""
        self._is_anew = False
        self._scale = self._nominal = self._told
        self._band = math.inf if self._frames else MAX_DRIFT
        self._own_s = self._arrival_s = arrival_s  # of the newest message: on our clock, had it come as fast as any
        self._seen = 0
        self._blocks.clear()
        self._block: tuple[float, float] | None = None
        self._block_begun = stamp, arrival_s
        self._late = (0.0, 0.0)
        self._lowered_s = 0.0
        self._early_blocks = 0

    @property
    def drift(self) -> float:
        """How much slower than nominal the source's clock runs, as a share of the time that passes."""
        return self._scale / self._told - 1.0

    @property
    def late_s(self) -> float:
        """How much later than at their best messages have come for the last two blocks [s]; 0 within the slack."""
        return min(self._late)

    def mark_alive(self, arrival_s: float) -> None:
        """The source has sent something, be it without a pose of ours, that came at ``arrival_s`` [s, our clock]."""
        if arrival_s - self._heard_s > ANEW_S:
            self._is_anew = True
        self._heard_s = arrival_s

    def stale(self, stamp: float, arrival_s: float) -> str:
        """Why a message stamped ``stamp`` must be dropped; an empty string where it must not.

        ``duplicate`` or ``out_of_order``; ``arrival_s`` is on our clock [s].
        """
        self.mark_alive(arrival_s)
        if self._stamp is None or stamp > self._stamp:
            return ""
        if stamp == self._stamp:
            return "duplicate"
        if self._old_since_s is None:
            self._old_since_s = arrival_s
        if arrival_s - self._old_since_s <= RESTART_S:
            return "out_of_order"
        self._is_anew = True
        self.restarts += 1
        return ""

    def time_s(self, stamp: float, arrival_s: float) -> float:
        """When a message that is not stale left its source [s, our clock]: ``arrival_s`` or earlier."""
        if self._is_anew or self._stamp is None or not self._goes_on(stamp - self._stamp, arrival_s):
            self._begin(stamp, arrival_s)
        self._stamp, self._arrival_s, self._old_since_s = stamp, arrival_s, None
        self._seen += 1
        best = self._block
        if best is None or arrival_s - best[1] < (stamp - best[0]) * self._scale:
            self._block = stamp, arrival_s
        if arrival_s >= self._block_begun[1] + BLOCK_S:
            self._close_block(stamp, arrival_s)
        return self._own_s

    def _goes_on(self, stamps: float, arrival_s: float) -> bool:
        """Go on to the next message, ``stamps`` after the last; False where it must be of another rate of frames."""
        elapsed = stamps * self._scale
        self._own_s += elapsed
        late = arrival_s - self._own_s
        if late > ANEW_S and self._frames:
            self.restarts += 1
            return False
        if late < -STEP_S:
            self.steps += 1
            self._blocks.clear()
            self._own_s = arrival_s - self.late_s  # nothing says that a queue has gone as the clock leapt
            return True
        self._count(elapsed, arrival_s - self._arrival_s)
        if late < 0.0:
            self._lowered_s -= late
            self._own_s = arrival_s
        return True

    def apply_exchange(self, ahead_s: float) -> None:
        """An exchange of clocks has shown that a source that stamps seconds is at most ``ahead_s`` ahead of us [s]."""
        if self._stamp is not None and not self._is_anew:
            own = self._stamp - ahead_s
            # What would have come long before it left was stamped by another clock than the one that was asked.
            if own <= self._arrival_s + SLACK_S and self._own_s < min(own, self._arrival_s):
                self._own_s = min(own, self._arrival_s)
                self._block = None
                self._blocks.clear()

    def _count(self, elapsed_s: float, waited_s: float) -> None:
        if elapsed_s - waited_s > STEP_S:
            return
        longest = GAP_INTERVALS * self.interval_s
        if self._seen > 10 and elapsed_s > longest:
            self.gaps += 1
            elapsed_s = longest
        self.interval_s += (elapsed_s - self.interval_s) / min(self._seen, AVERAGED)

    def _close_block(self, stamp: float, arrival_s: float) -> None:
        """Judge the block that ends with this message."""
        assert self._block is not None, "it holds this message"
        begun_stamp, begun_s = self._block_begun
        lasted = min((stamp - begun_stamp) * self._scale, arrival_s - begun_s)
        late = self._lateness(self._block)
        if self._band < math.inf:
            # With all that its slope may be, the clock is no slower than this; what piled up comes in no time.
            most = lasted * (self._nominal / self._scale * (1.0 + self._band) - 1.0)
            is_late = late - most > SLACK_S
            if is_late != (self._late[1] > 0.0):
                self._blocks.clear()  # from here on it is another line
            if not is_late:
                self._own_s = min(self._own_s + min(late, most), arrival_s)
            self._late = self._late[1], late if is_late else 0.0
            self._early_blocks = self._early_blocks + 1 if self._lowered_s > self._band * lasted else 0
        self._blocks.append(self._block)
        self._block, self._block_begun, self._lowered_s = None, (stamp, arrival_s), 0.0
        if self._frames and self._early_blocks >= FIRST_BLOCKS:
            # Nothing comes earlier and earlier: they are other frames than those that were measured.
            self._band, self._early_blocks = math.inf, 0
            self._blocks.clear()
        self._measure()

    def _lateness(self, message: tuple[float, float]) -> float:
        """How late (stamp, arrival) is by what we know now [s]."""
        assert self._stamp is not None, "there is a message"
        return message[1] - self._own_s - (message[0] - self._stamp) * self._scale

    def _measure(self) -> None:
        """Measure the slope, where there are blocks enough."""
        unknown = self._band == math.inf
        if len(self._blocks) < (FIRST_BLOCKS if unknown else SETTLED_BLOCKS):
            return
        slope = _median([(d - b) / (c - a) for (a, b), (c, d) in combinations(self._blocks, 2)])
        off = slope / self._nominal
        if unknown and 1.0 / RATES < off < RATES:
            self._scale = self._nominal = slope
            self._band = ROUGH
            self._own_s = min(self._own_s + min(map(self._lateness, self._blocks)), self._arrival_s)
        elif abs(off - 1.0) <= self._band:
            self._scale = slope
            if self._band > MAX_DRIFT and not self._late[1]:
                self._nominal, self._band = slope, MAX_DRIFT


UNIT_TOLERANCE = 1e-3
"""How far from 1 the length of a unit quaternion may be; 32-bit floats leave it within 1e-6."""
LATEST = 1e15
"""No stamp is further from zero, be it in seconds or frames: floats would no longer tell two of them apart."""
_AVERAGED = 50


def _median(values: list[float]) -> float:
    """The median, by which statistics, with fractions and all behind it, would be loaded before every flight."""
    ordered, middle = sorted(values), len(values) // 2
    return ordered[middle] if len(values) % 2 else (ordered[middle - 1] + ordered[middle]) / 2


class DatagramReader(Protocol):
    """Makes poses of the datagrams of one source. No bytes make it raise."""

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        ...

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The poses in ``datagram``, which arrived at ``arrival_s`` [s, our clock]: mostly one or none."""
        ...


class Intake:
    """Turns what one source measured into numbered poses; what is no pose is counted by reason."""

    def __init__(
        self,
        latency_s: float,
        frames: Frames | None = None,
        *,
        frame_s: float | None = None,
        others: Others | None = None,
    ) -> None:
        """``latency_s`` is the time from the instant of a pose to its earliest arrival here [s].

        ``frames`` leads from the source's axes into ours; None: they are ours. ``frame_s``: what stamps that number
        frames were told to be apart [s]; None for stamps in seconds. ``others`` are further bodies to look for.
        """
        self.accepted = 0
        """Poses made."""
        self.dropped: Counter[str] = Counter()
        """By reason. Here: not_finite, not_unit, absurd, duplicate, out_of_order."""
        self.clock = SourceClock(frame_s)
        self.others = others
        """Further bodies to look for; None: nobody asks for them."""
        self._base_latency_s = latency_s
        self._frames = frames
        self._latency_s = 0.0
        self._latency_max_s = 0.0

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        clock = self.clock
        return PoseStatus(
            accepted=self.accepted,
            dropped=dict(self.dropped),
            rate_hz=1.0 / clock.interval_s if clock.interval_s > 0.0 else 0.0,
            latency_s=self._latency_s,
            latency_max_s=self._latency_max_s,
            drift=clock.drift,
            gaps=clock.gaps,
            clock_steps=clock.steps,
            clock_restarts=clock.restarts,
            late_s=clock.late_s,
        )

    def mark_alive(self, arrival_s: float) -> None:
        """The source has sent something at all, perhaps without our body, that came at ``arrival_s`` [s, our clock]."""
        self.clock.mark_alive(arrival_s)

    def drop(self, reason: str) -> Pose | None:
        """Count one thing that made no pose; returns None, which stands for the pose."""
        self.dropped[reason] += 1
        return None

    def pose(
        self,
        stamp: float,
        arrival_s: float,
        position: Vec3,
        attitude: Quat,
        velocity_ned: Vec3 | None = None,
        *,
        resets: int = 0,
        age_s: float = 0.0,
    ) -> Pose | None:
        """The pose, or None where it is dropped and counted.

        ``stamp`` is the source's, in seconds or frames; ``age_s`` how old the pose was at that instant [s], beside
        the latency. ``position`` [m] and ``attitude`` are in the source's axes, ``velocity_ned`` is in ours.
        """
        x, y, z = position
        if not math.isfinite(x + y + z + sum(attitude) + stamp + age_s):
            return self.drop("not_finite")
        if abs(math.hypot(*attitude) - 1.0) > UNIT_TOLERANCE:
            return self.drop("not_unit")
        if max(abs(x), abs(y), abs(z)) > FAR_M or abs(stamp) > LATEST:
            return self.drop("absurd")
        clock = self.clock
        if reason := clock.stale(stamp, arrival_s):
            return self.drop(reason)
        time_s = clock.time_s(stamp, arrival_s) - self._base_latency_s - age_s
        number = self.accepted
        self.accepted = number + 1
        latency = arrival_s - time_s
        self._latency_s += (latency - self._latency_s) / min(number + 1, _AVERAGED)
        self._latency_max_s = max(self._latency_max_s, latency)
        if velocity_ned is not None and not math.isfinite(sum(velocity_ned)):
            velocity_ned = None  # PX4's way to say that it has none
        if self._frames is not None:
            position, attitude = self._frames.ours(position, attitude)
        return Pose(number, time_s, arrival_s, position, attitude, velocity_ned, resets + 256 * clock.restarts)

    def other(self, name: str, arrival_s: float, position: Vec3, *, age_s: float = 0.0) -> None:
        """One of :attr:`others` was at ``position`` [m, the source's axes], as its bytes came at ``arrival_s`` [s].

        ``age_s``: see :meth:`update`. The source's stamp is the business of our own body alone.
        """
        if self.others is not None:
            place = position if self._frames is None else self._frames.place(position)
            self.others.see(name, arrival_s - self.clock.late_s - self._base_latency_s - age_s, place)


class FrameCount:
    """A frame counter of fixed width as one that never runs over."""

    def __init__(self, bits: int = 32) -> None:
        """``bits`` is the counter's width on the wire."""
        self._half = 1 << (bits - 1)
        self._mask = (1 << bits) - 1
        self._last: int | None = None

    def whole(self, number: int) -> int:
        """``number`` with the turns of the counter: half of its circle lies ahead of the last one, half behind."""
        if self._last is not None:
            number = self._last + ((number - self._last + self._half) & self._mask) - self._half
        self._last = number
        return number
