"""Pose intake: the source's clock, our frames, counters, shared by every reader.

And the outlier gate. Sans-IO.

The source's clock converts its time stamps to our clock, and measures how late its messages arrive.
A message can only be late, never early: the smallest difference between arrival and stamp so far
gives the source's zero on our clock. A message later than that is late, however long this lasts: a
constant or growing queue can't be distinguished from a clock that was set back or a frame counter
that paused, and the older answer is the safe one. Three things move the zero later: a slope within
the plausible drift of the source's clock (``MAX_DRIFT``), as long as nothing is late by more than
``SLACK_S``; an exchange of clocks, if there is one; and a new start. Stamps are seconds, or numbers
of frames. Our time from one to the next is measured from the least delayed message of each half
second (Theil and Sen: the median of the slopes between any two of them, which bursts and stalls do
not move). Of frames any rate is accepted at first, as the configured one is often wrong; from then
on a slower rate is lateness, too. Stamps in the wrong unit would make every message the newest
ever, and none late. Stamps that run too fast, or of which each is a step, are therefore measured as
the numbers of frames are. If the clock steps again and again, the message after a step counts as
one usual interval newer than the one before: an unsteady clock makes no pose young.

Outlier gate: it drops implausible poses between a source and the flight. A reader knows one
datagram at a time; the gate compares each pose with those before it. Drops are counted by reason,
and reported once for each outbreak; the flight goes on with its model for as long as a command may
use one pose (flight.coast_s). After a pose that did not fit the next ones must fit better, until
one does. There are two ways to a new place. Either the source reports that it has moved its origin:
accepted at once, as the vehicle did not move. Or the poses that do not fit agree among themselves
for ``settle_s``, which is longer than any command may use one pose: no flight survives it, and on
the ground it recovers by itself. Outbreaks of dropped, late and missing poses are reported as they
begin and as they end.
"""

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from statistics import median
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, TypeVar

import msgspec

from groundstation.core.geometry import Frames, Quat, Vec3, so3
from groundstation.core.messages import (
    FAR_M,
    NOTICES,
    RESETS_S,
    Excess,
    Others,
    Pose,
    PoseStatus,
    Sentence,
    notice,
)
from links.core import NEWS_S, UNIT_TOLERANCE
from links.io import format_address

T = TypeVar("T")

MAX_DRIFT = 0.0015
"""Largest drift of a source's clock [-]: beyond it, messages get later and later."""
SLACK_S = 0.02
"""Lateness above which a block's least delayed message does not move the zero [s]."""
BLOCK_S = 0.5
"""Duration of a block, of which the least delayed message is kept [s]."""
BLOCKS = 40
"""Number of newest blocks that the slope is fitted to [-]; half of them distinguish it from
jitter."""
FIRST_BLOCKS = 5
"""Least number of blocks for a slope while the rate is not known [-]."""
ROUGH = MAX_DRIFT + SLACK_S / (FIRST_BLOCKS * BLOCK_S)
"""Largest error of a rate that was measured over so few blocks [-]."""
RESTART_S = 1.0
"""A source that sends only old stamps for this long has restarted its clock, and one that is silent
for as long gives its place to another sender [s]: longer than a flight may use one pose, so that no
flight goes over to it."""
ANEW_S = 4.0
"""Silence, and lateness of a frame, after which the clock is measured anew [s]. No flight lasts so
long without a fresh pose: 1 s at most on one pose, then a bring-down of 2 s."""
STEP_S = 0.2
"""Lead of a message on all before that is a step of the source's clock [s]."""
MANY = 3
"""Number of breaks of a clock within ``UNSTEADY_S``, or of moves within ``RESETS_S``, that are one
fault, and not told each by itself [-]."""
UNSTEADY_S = 30.0
"""A clock without a break for this long is steady again [s]."""
FAST = 1.2
"""Rate of stamps, either way, beyond which they are no seconds [-]: no queue drains so fast for so
long."""
RATE_S = 2.0
"""Time over which the rate of the stamps is measured [s]; it is given from half of it on."""
AVERAGED = 20
"""Number of messages over which the usual interval is averaged [-]."""
GAP_INTERVALS = 2.5
"""Stamps further apart than this many usual intervals are a gap [-]."""


class StampedArrival(NamedTuple):
    """One message of the source."""

    stamp: float
    """Seconds, or a number of frames, by the source."""
    arrival_s: float
    """Time of its arrival [s, our clock]."""


class StampScale(msgspec.Struct, gc=False):
    """Time of ours from one stamp to the next."""

    slope: float
    """Our seconds per stamp, as fitted."""
    nominal: float
    """Reference of the drift: the value as configured or first measured."""
    band: float
    """Largest deviation of the slope as a share [-]; infinite while the rate is unknown."""

    @property
    def is_known(self) -> bool:
        """Whether the rate is known up to the clock's drift."""
        return self.band < math.inf


class Block(msgspec.Struct, gc=False):
    """The messages of half a second."""

    begun: StampedArrival
    best: StampedArrival | None = None
    """The least delayed one."""
    lowered_s: float = 0.0
    """Time by which messages arrived earlier than any before [s]."""


class BlockLine:
    """Least delayed message of each newest block: a line while the clock keeps its rate."""

    def __init__(self) -> None:
        self.best: deque[StampedArrival] = deque(maxlen=BLOCKS)
        self.late = (0.0, 0.0)
        """Delays of the last two blocks beyond the drift [s]; 0 within the slack."""
        self.early = 0
        """Number of blocks in a row whose messages arrived earlier and earlier."""

    def is_straight(self, slope: float) -> bool:
        """Whether the blocks form a line of this ``slope`` within the slack."""
        off = [arrival_s - slope * stamp for stamp, arrival_s in self.best]
        middle = median(off)
        return slope > 0.0 and median([abs(one - middle) for one in off]) <= SLACK_S


class SourceClock:
    """The clock of one source."""

    def __init__(self, frame_s: float | None = None) -> None:
        """Stamps are seconds, or with the configured period ``frame_s`` [s] frame numbers."""
        self.restarts = 0
        """Number of restarts of the source's clock."""
        self.steps = 0
        """Number of forward steps of the source's clock."""
        self.gaps = 0
        """Number of gaps in the messages."""
        self.interval_s = 0.0
        """Usual time from one message to the next, by the source [s]; 0 before the second."""
        self._frames = frame_s is not None
        self._configured = 1.0 if frame_s is None else frame_s
        self._heard_s = -math.inf
        self._stamp: float | None = None
        self._old_since_s: float | None = None
        self._same_since_s = math.inf
        self._breaks: deque[float] = deque(maxlen=MANY)
        self._recent: deque[StampedArrival] = deque()
        self._begin(0.0, 0.0)
        self._is_anew = True
        """Whether the next message is the first."""

    def _begin(self, stamp: float, arrival_s: float) -> None:
        """Measure anew from this message on."""
        self._is_anew = False
        self._scale = StampScale(
            self._configured, self._configured, math.inf if self._frames else MAX_DRIFT
        )
        # Of the newest message, with the least delay so far.
        self._own_s = self._arrival_s = arrival_s
        self._seen = 0
        self._line = BlockLine()
        self._block = Block(StampedArrival(stamp, arrival_s))
        self._recent.clear()

    @property
    def drift(self) -> float:
        """Drift of the source's clock: slower than nominal by this share [-]."""
        return self._scale.slope / self._configured - 1.0

    @property
    def late_s(self) -> float:
        """Delay of the messages of the last two blocks above their best [s]; 0 within the slack."""
        return min(self._line.late)

    @property
    def is_unsteady(self) -> bool:
        """Whether the clock has stepped or restarted again and again, and its rate is not known."""
        breaks = self._breaks
        return len(breaks) == MANY and self._arrival_s - breaks[0] <= UNSTEADY_S

    @property
    def stamp_rate(self) -> float | None:
        """Seconds by the stamps (configured unit or rate) per second of ours [-].

        None after too few messages.
        """
        if not self._recent:
            return None
        (first, begun_s), (last, ended_s) = self._recent[0], self._recent[-1]
        elapsed_s = ended_s - begun_s
        return (last - first) * self._configured / elapsed_s if elapsed_s >= RATE_S / 2 else None

    def mark_alive(self, arrival_s: float) -> None:
        """Note that any message of the source arrived at ``arrival_s`` [s, our clock]."""
        if arrival_s - self._heard_s > ANEW_S:
            self._is_anew = True
        self._heard_s = arrival_s

    def stale(self, stamp: float, arrival_s: float) -> str:
        """Return why a message stamped ``stamp`` must be dropped; empty if it must not.

        ``duplicate``, ``same_stamp`` if the stamp has not changed for a second, or
        ``out_of_order``; ``arrival_s`` is on our clock [s].
        """
        self.mark_alive(arrival_s)
        if self._stamp is None or stamp > self._stamp:
            self._same_since_s = math.inf
            return ""
        if stamp == self._stamp:
            self._same_since_s = min(self._same_since_s, arrival_s)
            return "same_stamp" if arrival_s - self._same_since_s > RESTART_S else "duplicate"
        if self._old_since_s is None:
            self._old_since_s = arrival_s
        if arrival_s - self._old_since_s <= RESTART_S:
            return "out_of_order"
        self._is_anew = True
        self._restart(arrival_s)
        return ""

    def forget(self) -> None:
        """Measure anew from the next message on: those so far were of more than one clock."""
        self._is_anew, self._stamp, self._old_since_s = True, None, None

    def time_s(self, stamp: float, arrival_s: float) -> float:
        """Return when a fresh message left its source [s, our clock]: ``arrival_s`` or earlier."""
        if (
            self._is_anew
            or self._stamp is None
            or not self._goes_on(stamp - self._stamp, arrival_s)
        ):
            self._begin(stamp, arrival_s)
        self._stamp, self._arrival_s, self._old_since_s = stamp, arrival_s, None
        self._seen += 1
        self._recent.append(StampedArrival(stamp, arrival_s))
        while len(self._recent) > 2 and self._recent[1][1] <= arrival_s - RATE_S:
            self._recent.popleft()
        block, best = self._block, self._block.best
        if best is None or arrival_s - best[1] < (stamp - best[0]) * self._scale.slope:
            block.best = StampedArrival(stamp, arrival_s)
        if arrival_s >= block.begun[1] + BLOCK_S:
            self._close_block(stamp, arrival_s)
        return self._own_s

    def _goes_on(self, stamps: float, arrival_s: float) -> bool:
        """Go on to the next message, ``stamps`` after the last.

        Return False if the frame rate must have changed.
        """
        elapsed = stamps * self._scale.slope
        usual_s = self.interval_s
        is_gap = 0.0 < GAP_INTERVALS * usual_s < elapsed
        if is_gap and self.is_unsteady:
            self._line.best.clear()
            if elapsed - (arrival_s - self._arrival_s) > SLACK_S:
                self._breaks.append(arrival_s)
            elapsed = usual_s
        self._own_s += elapsed
        late = arrival_s - self._own_s
        if late > ANEW_S and self._frames:
            self._restart(arrival_s)
            return False
        if late < -STEP_S:
            self._step(arrival_s)
            return True
        # A small step: a lost message does not make the next one early.
        if is_gap and late < -SLACK_S:
            self._breaks.append(arrival_s)
        self._count(elapsed, arrival_s - self._arrival_s)
        if late < 0.0:
            self._block.lowered_s -= late
            self._own_s = arrival_s
        return True

    def _step(self, arrival_s: float) -> None:
        """The stamps have jumped ahead."""
        self.steps += 1
        self._breaks.append(arrival_s)
        if not self.is_unsteady:
            self._recent.clear()
        self._own_s = arrival_s - self.late_s  # a queue may still be there after the jump
        if self.is_unsteady and self.interval_s == 0.0:  # no message ever fitted: another unit
            self._lose_rate()
        else:
            self._line.best.clear()

    def _restart(self, arrival_s: float) -> None:
        """The source's clock has restarted."""
        self.restarts += 1
        self._breaks.append(arrival_s)

    def _lose_rate(self) -> None:
        """Measure the time between stamps from now on."""
        if self._scale.is_known:
            self._scale.band, self._line.early = math.inf, 0
            self._line.best.clear()

    def apply_exchange(self, ahead_s: float) -> None:
        """Use an exchange of clocks: stamps in seconds are at most ``ahead_s`` ahead of us [s]."""
        if self._stamp is not None and not self._is_anew:
            own = self._stamp - ahead_s
            # A message that would have arrived long before it left was stamped by another clock.
            if own <= self._arrival_s + SLACK_S and self._own_s < min(own, self._arrival_s):
                self._own_s = min(own, self._arrival_s)
                self._block.best = None
                self._line.best.clear()

    def _count(self, elapsed_s: float, waited_s: float) -> None:
        if elapsed_s - waited_s > STEP_S:
            return
        longest = GAP_INTERVALS * self.interval_s
        if self.interval_s == 0.0:
            self.interval_s = elapsed_s
            return
        if self._seen > 10 and elapsed_s > longest:
            self.gaps += 1
            elapsed_s = longest
        self.interval_s += (elapsed_s - self.interval_s) / min(self._seen, AVERAGED)

    def _close_block(self, stamp: float, arrival_s: float) -> None:
        """Judge the block that ends with this message."""
        block, line, scale = self._block, self._line, self._scale
        assert block.best is not None, "it holds this message"
        if scale.is_known:
            self._judge_block(
                block.best,
                min((stamp - block.begun.stamp) * scale.slope, arrival_s - block.begun.arrival_s),
            )
        line.best.append(block.best)
        self._block = Block(StampedArrival(stamp, arrival_s))
        if line.early >= FIRST_BLOCKS:
            self._lose_rate()  # nothing arrives earlier and earlier: the rate has changed
        self._measure()

    def _judge_block(self, best: StampedArrival, lasted_s: float) -> None:
        """Judge whether the block of ``lasted_s`` [s] is late, or earlier than its clock may be.

        Else keep its line.
        """
        line, scale, late = self._line, self._scale, self._lateness(best)
        # The clock is no slower than this; queued messages arrive in no time.
        most = lasted_s * (scale.nominal / scale.slope * (1.0 + scale.band) - 1.0)
        is_late = late - most > SLACK_S
        if is_late != (line.late[1] > 0.0):
            line.best.clear()  # another line begins here
        if not is_late:
            self._own_s = min(self._own_s + min(late, most), self._arrival_s)
        line.late = line.late[1], late if is_late else 0.0
        most_early = scale.band if self._frames else FAST - 1.0
        line.early = line.early + 1 if self._block.lowered_s > most_early * lasted_s else 0

    def _lateness(self, message: StampedArrival) -> float:
        """Return the delay of ``message`` by the present fit [s]."""
        assert self._stamp is not None, "there is a message"
        return message.arrival_s - self._own_s - (message.stamp - self._stamp) * self._scale.slope

    def _measure(self) -> None:
        """Measure the slope, if there are enough blocks."""
        line, scale = self._line, self._scale
        if len(line.best) < (BLOCKS // 2 if scale.is_known else FIRST_BLOCKS):
            return
        slope = median([(d - b) / (c - a) for (a, b), (c, d) in combinations(line.best, 2)])
        off = slope / scale.nominal
        if scale.is_known:
            if abs(off - 1.0) <= scale.band:
                scale.slope = slope
                if scale.band > MAX_DRIFT and not line.late[1]:
                    scale.nominal, scale.band = slope, MAX_DRIFT
        elif self._is_rate(slope):
            self._breaks.clear()
            scale.slope, scale.nominal, scale.band = slope, slope, ROUGH
            self._own_s = (
                min(self._own_s + min(map(self._lateness, line.best)), self._arrival_s)
                - self.late_s
            )
        elif not self._frames or self.is_unsteady:
            line.best.popleft()

    def _is_rate(self, slope: float) -> bool:
        """Whether ``slope`` [our seconds per stamp] is plausible."""
        return (self._frames and not self.is_unsteady) or self._line.is_straight(slope)


LATEST = 1e19
"""Largest plausible stamp [s or frames]: one in nanoseconds since 1970 is 1.8e18, where floats are
256 apart; its unit is found by its rate."""
_AVERAGED = 50
"""Poses over which the latency is averaged."""


FEW_POSES = 2
"""Largest number of poses of an address that may be one of many ports of one program [-]: some send
each datagram from a new port."""


class PoseSenders:
    """Addresses that send poses of the vehicle: of two that send at a time, the first is used."""

    def __init__(self) -> None:
        self._known: Any = None
        self._known_s = -math.inf
        self._count = 0
        """Number of poses of the known sender."""
        self._second: Any = None
        self._second_s = -math.inf
        self._is_mixed = False
        """Whether poses of another address were used while the known sender was new."""

    def is_second(self, sender: Any, arrival_s: float) -> bool:
        """Whether the pose that came from ``sender`` at ``arrival_s`` [s] is of a second one, and
        must not be used.
        """
        if sender == self._known or arrival_s - self._known_s > RESTART_S:
            self._count = self._count + 1 if sender == self._known else 1
            self._known, self._known_s = sender, arrival_s
            return False
        if self._count > FEW_POSES:
            self._second, self._second_s = sender, arrival_s
            return True
        self._is_mixed = True
        return False

    def take_mixed(self) -> bool:
        """Return once whether poses of another sender were used before the known one was clear."""
        was_mixed = self._is_mixed and self._count > FEW_POSES
        if was_mixed:
            self._is_mixed = False
        return was_mixed

    @property
    def conflict(self) -> str:
        """Which two addresses send poses of the vehicle; empty where one alone does."""
        if self._second == self._known or self._known_s - self._second_s > NEWS_S:
            return ""
        used, other = format_address(self._known), format_address(self._second)
        return notice("pose.two_senders", used=used, other=other).text


class Intake:
    """Makes numbered poses of the measurements of one source.

    Rejected ones are counted by reason.
    """

    def __init__(
        self,
        latency_s: float,
        frames: Frames | None = None,
        *,
        frame_s: float | None = None,
        others: Others | None = None,
    ) -> None:
        """``latency_s`` is the time from the instant of a pose to its earliest arrival here [s].

        ``frames`` converts the source's axes to ours; None: they are ours. ``frame_s``: configured
        period of stamps that number frames [s]; None for stamps in seconds. ``others`` are further
        bodies to look for.
        """
        self.accepted = 0
        """Poses made."""
        self.dropped: Counter[str] = Counter()
        """Counts by reason.

        Here: not_finite, not_unit, absurd, absurd_stamp, duplicate, same_stamp, out_of_order,
        same_name, no_such_body."""
        self.clock = SourceClock(frame_s)
        self.others = others
        """Further bodies to look for; None without any."""
        self.senders = PoseSenders()
        """Addresses that send the vehicle's poses, of a source that listens to any."""
        self.advice = ""
        """Reason why no poses arrive, for the operator; empty without a finding."""
        self._base_latency_s = latency_s
        self._frames = frames
        self._latency_s = 0.0
        self._latency_max_s = 0.0
        self._last: tuple[Vec3, Quat] | None = None

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
            stamp_rate=clock.stamp_rate,
            unsteady_clock=clock.is_unsteady,
            advice=self.advice or self.senders.conflict,
        )

    def drop(self, reason: str) -> Pose | None:
        """Count one rejected measurement; return None in the place of its pose."""
        self.dropped[reason] += 1
        return None

    def choose(self, own: Sequence[T], missing: str = "no_such_body") -> T | None:
        """Return the only body with the vehicle's name.

        None, which is counted, without one, or with several.
        """
        if len(own) == 1:
            return own[0]
        self.drop("same_name" if own else missing)
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
        """Make a pose; return None if it is dropped and counted.

        ``stamp`` is the source's, in seconds or frames; ``age_s`` is the age of the pose at that
        time [s], in addition to the latency. ``position`` [m] and ``attitude`` are in the source's
        axes, ``velocity_ned`` is in ours.
        """
        x, y, z = position
        if not math.isfinite(sum((*position, *attitude, stamp, age_s))):
            return self.drop("not_finite")
        if abs(math.hypot(*attitude) - 1.0) > UNIT_TOLERANCE:
            return self.drop("not_unit")
        if max(abs(x), abs(y), abs(z)) > FAR_M:
            return self.drop("absurd")
        if abs(stamp) > LATEST:
            return self.drop("absurd_stamp")
        clock = self.clock
        if self.senders.take_mixed() and self.accepted <= 2 * (FEW_POSES + 1):
            clock.forget()  # before any flight: lateness is measured from now on
        if reason := clock.stale(stamp, arrival_s):
            is_other = reason == "duplicate" and self._last != (position, attitude)
            return self.drop("same_stamp" if is_other else reason)
        self._last = position, attitude
        time_s = clock.time_s(stamp, arrival_s) - self._base_latency_s - age_s
        self.accepted += 1
        latency = arrival_s - time_s
        self._latency_s += (latency - self._latency_s) / min(self.accepted, _AVERAGED)
        self._latency_max_s = max(self._latency_max_s, latency)
        if velocity_ned is not None and not math.isfinite(sum(velocity_ned)):
            velocity_ned = None  # PX4's way to say that it has none
        if self._frames is not None:
            position, attitude = self._frames.to_ours(position, attitude)
        return Pose(
            self.accepted - 1,
            time_s,
            arrival_s,
            position,
            attitude,
            velocity_ned,
            resets + 256 * clock.restarts,
        )

    def see_other(self, name: str, arrival_s: float, position: Vec3, *, age_s: float = 0.0) -> None:
        """Note that a body was at ``position`` [m, the source's axes] if it is of :attr:`others`.

        Its bytes arrived at ``arrival_s`` [s]; ``age_s``: see :meth:`pose`. Its stamp is not
        needed.
        """
        if self.others is not None and name in self.others:
            place = position if self._frames is None else self._frames.convert_point(position)
            self.others.see(
                name, arrival_s - self.clock.late_s - self._base_latency_s - age_s, place
            )


class PoseReader:
    """Reads the poses of one vehicle from the datagrams of one source. No bytes make it raise."""

    def __init__(self, intake: Intake) -> None:
        self.intake = intake
        """Intake of the vehicle's poses."""
        self.names: tuple[str, ...] = ()
        """Names of the bodies that the source shows, for the operator."""
        self.sender: Any = "one sender"
        """Address of the sender of the next datagram."""

    @property
    def status(self) -> PoseStatus:
        """Present counters."""
        return self.intake.status

    def is_second(self, arrival_s: float) -> bool:
        """Whether a pose of the vehicle that came at ``arrival_s`` [s] is of a second sender, which
        is counted.
        """
        is_second = self.intake.senders.is_second(self.sender, arrival_s)
        if is_second:
            self.intake.drop("second_sender")
        return is_second

    def read(self, data: bytes, arrival_s: float) -> Sequence[Pose]:
        """Return the poses in ``data``, which arrived at ``arrival_s`` [s]: mostly one or none."""
        pose = self.read_pose(data, arrival_s)
        return () if pose is None else (pose,)

    def read_pose(self, data: bytes, arrival_s: float) -> Pose | None:
        """Return the pose in ``data``; None if it holds none, which is counted."""
        raise NotImplementedError


ANSWER_S = 5.0
"""Timeout of a tracking system's answer [s]; some would be waited for for ever."""


class ReaderSource:
    """Base of sources that deliver a reader's poses of received bytes on the event loop."""

    def __init__(self, reader: PoseReader) -> None:
        self._reader = reader
        self._deliver: Callable[[Pose], None] | None = None
        """The receiver; None before the start and after the end."""
        self._now: Callable[[], float] = lambda: 0.0
        """Time on the event loop's clock [s], also in a replay, where the loop does not run."""

    @property
    def status(self) -> PoseStatus:
        """Present counters."""
        return self._reader.status

    @property
    def other_objects(self) -> tuple[str, ...]:
        """Names of shown bodies: they distinguish a misspelt name from a silent stream."""
        return self._reader.names

    def _begin(self, deliver: Callable[[Pose], None], now: Callable[[], float]) -> None:
        """Deliver poses to ``deliver`` from now on; ``now`` returns the time [s]."""
        self._deliver, self._now = deliver, now

    def _take(self, data: bytes) -> None:
        """Deliver the poses in ``data``; the receiver of one may close the source."""
        for pose in self._reader.read(data, self._now()) if self._deliver is not None else ():
            if self._deliver is not None:
                self._deliver(pose)


BASE_S = 0.05
"""Least base of a speed [s]: from pose to pose it would be mostly noise and jitter."""
TURN_DEG = 15.0
"""Turn of a pose by noise and jitter [deg], in addition to ``rate_deg_s``."""
DOUBT = 0.25
"""Factor on the allowed deviation after a jump, until a pose fits [-]: of many wild poses one may
come near by chance, and would disturb the estimate. The allowance is never more than ``jump_m``:
however old the last pose is, a place a little aside of it is not where the vehicle has flown."""
EXACT_TOLERANCE = 1e-6
"""Tolerance of a unit quaternion's squared length [-], as of 32-bit floats."""
UNANNOUNCED = 1 << 32
"""Added to ``reset_count`` for each place that was not announced: no source counts that far."""


class GateConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits on the change between poses; beyond a vehicle's motion, below mix-ups."""

    jump_m: Annotated[
        float,
        msgspec.Meta(
            ge=0.001,
            le=10.0,
            description="How far a pose may be from the prediction by the ones before [m], in "
            "addition to `acceleration_m_s2`.",
        ),
    ] = 0.15
    acceleration_m_s2: Annotated[
        float,
        msgspec.Meta(
            ge=0.1, le=1000.0, description="Largest acceleration that is believed [m/s²]."
        ),
    ] = 30.0
    speed_m_s: Annotated[
        float, msgspec.Meta(ge=0.01, le=100.0, description="Fastest speed that is believed [m/s].")
    ] = 20.0
    rate_deg_s: Annotated[
        float,
        msgspec.Meta(ge=50.0, le=20000.0, description="Fastest turn that is believed [deg/s]."),
    ] = 1000.0
    tilt_deg: Annotated[
        float,
        msgspec.Meta(
            ge=10.0,
            le=180.0,
            description="Largest angle between the vehicle's vertical and the world's [deg]; 180 "
            "allows all.",
        ),
    ] = 120.0
    frozen_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.001,
            le=60.0,
            description="A pose that has been the same to the last bit for this long is no longer "
            "measured [s].",
        ),
    ] = 0.1
    drop_frozen: Annotated[
        bool,
        msgspec.Meta(
            description="Whether that counts; off for simulations without noise, and for trackers "
            "that round to the millimetre."
        ),
    ] = True
    settle_s: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=60.0,
            description="A place that does not fit is believed after the poses have agreed on it "
            "for this long [s].",
        ),
    ] = 1.5


class Gate:
    """The poses of one source, in the order of their arrival."""

    def __init__(self, config: GateConfig) -> None:
        self.dropped: Counter[str] = Counter()
        """Counts by reason: not_finite, not_unit, out_of_order, tilted, frozen, too_fast, jump,
        spin."""
        self.excesses: dict[str, Excess] = {}
        """Value and limit of the newest drop by reason, where there is a limit."""
        self._config = config
        self._cos_tilt = math.cos(math.radians(config.tilt_deg))
        self._track: PoseTrack | None = None
        self._other: PoseTrack | None = None
        self._unannounced = 0
        self._moved_s: deque[float] = deque()
        self._moves_again = False
        self._raw: Pose | None = None
        self._since_s = 0.0

    @property
    def newest(self) -> Pose | None:
        """The newest pose that has passed."""
        return None if self._track is None else self._track.last

    def count_moves(self, now_s: float) -> int:
        """Count the moves of the source's origin within ``RESETS_S`` before ``now_s`` [s]."""
        while self._moved_s and now_s - self._moved_s[0] >= RESETS_S:
            self._moved_s.popleft()
        return len(self._moved_s)

    def filter_pose(self, pose: Pose) -> tuple[Pose | None, Sentence | None]:
        """Return ``pose`` with a normalised attitude, or None if it is dropped.

        And a sentence for the operator.
        """
        checked = self._check_alone(pose)
        if checked is None:
            return None, None
        track, other = self._track, self._other
        if track is None:
            self._track = PoseTrack(checked, self._config)
            return self._add_moves(checked), None
        if checked.reset_count != track.last.reset_count:
            return self._move_track(checked, track.last, notice("pose.origin_moved"))
        why, excess = track.refuses(checked, after_jump=other is not None and other.why == "jump")
        if why == "out_of_order":
            return self.drop(why), None
        # The older the last pose, the more fits it: so the pose belongs to the nearer of two
        # tracks.
        if (
            other is not None
            and not other.refuses(checked)[0]
            and (why or other.misfit(checked) < track.misfit(checked))
        ):
            other.add(checked)
            if checked.time_s - other.first_s >= self._config.settle_s:
                self._unannounced += 1
                return self._move_track(
                    checked, track.last, notice("pose.agreed", settle_s=self._config.settle_s)
                )
            return self.drop(why or other.why, excess), None
        if why:
            self._other = PoseTrack(checked, self._config, why)
            return self.drop(why, excess), None
        self._other = None
        track.add(checked)
        return self._add_moves(checked), None

    def _check_alone(self, pose: Pose) -> Pose | None:
        """Return ``pose`` with a unit quaternion that continues the last one.

        None if it is implausible by itself.
        """
        w, x, y, z = pose.attitude
        if not math.isfinite(sum((*pose.position_ned, *pose.attitude, pose.time_s))):
            return self.drop("not_finite")
        square = w * w + x * x + y * y + z * z
        if not 0.8 < square < 1.2:
            return self.drop("not_unit")
        if self._is_frozen(pose):
            return self.drop("frozen", (pose.time_s - self._since_s, self._config.frozen_s))
        upright = 1.0 - 2.0 * (x * x + y * y) / square
        if upright < self._cos_tilt:
            return self.drop("tilted", (so3.angle_deg(upright), self._config.tilt_deg))
        velocity = pose.velocity_ned
        if velocity is not None and not math.hypot(*velocity) <= self._config.speed_m_s:
            return self.drop("too_fast", (math.hypot(*velocity), self._config.speed_m_s))
        if abs(square - 1.0) > EXACT_TOLERANCE:
            w, x, y, z = so3.normalize((w, x, y, z))
        last = self._track.last.attitude if self._track is not None else (w, x, y, z)
        if w * last[0] + x * last[1] + y * last[2] + z * last[3] < 0.0:
            w, x, y, z = -w, -x, -y, -z
        attitude: Quat = (w, x, y, z)
        return (
            pose if attitude == pose.attitude else msgspec.structs.replace(pose, attitude=attitude)
        )

    def _is_frozen(self, pose: Pose) -> bool:
        raw, self._raw = self._raw, pose
        if raw is None or (raw.position_ned, raw.attitude) != (pose.position_ned, pose.attitude):
            self._since_s = pose.time_s
            return False
        return self._config.drop_frozen and pose.time_s - self._since_s >= self._config.frozen_s

    def drop(self, why: str, excess: Excess | None = None) -> Pose | None:
        """Count a pose that is dropped, with the value beyond a limit, and the limit.

        Return None in its place.
        """
        self.dropped[why] += 1
        if excess is not None:
            self.excesses[why] = excess
        return None

    def _add_moves(self, pose: Pose) -> Pose:
        if not self._unannounced:
            return pose
        return msgspec.structs.replace(
            pose, reset_count=pose.reset_count + self._unannounced * UNANNOUNCED
        )

    def _move_track(self, pose: Pose, last: Pose, why: Sentence) -> tuple[Pose, Sentence | None]:
        """Begin a new track at ``pose``.

        Of many moves in a row only the first ones are reported.
        """
        turn = turned_deg(last.attitude, pose.attitude)
        far = math.dist(last.position_ned, pose.position_ned)
        self._track, self._other = PoseTrack(pose, self._config), None
        self._moved_s.append(pose.arrival_s)
        moves, before = self.count_moves(pose.arrival_s), self._moves_again
        self._moves_again = moves >= MANY
        says: Sentence | None = notice("pose.elsewhere", far_m=far, turn_deg=turn, why=why)
        if self._moves_again:
            says = None if before else describe_origin_moves(moves)
        return self._add_moves(pose), says


class PoseTrack:
    """Poses that fit each other."""

    def __init__(self, pose: Pose, config: GateConfig, why: str = "") -> None:
        self.first_s = pose.time_s
        """Time of its first pose [s]."""
        self.last = pose
        """Its newest pose."""
        self.why = why
        """Reason why its first pose did not fit the other track; empty for the first track."""
        self._config = config
        self._anchor = self._next_anchor = pose

    def add(self, pose: Pose) -> None:
        """Add a pose that fits."""
        self.last = pose
        if pose.time_s - self._next_anchor.time_s >= BASE_S:
            self._anchor, self._next_anchor = self._next_anchor, pose

    def refuses(self, pose: Pose, *, after_jump: bool = False) -> tuple[str, Excess | None]:
        """Return why ``pose`` can't be of the vehicle, or empty, and the value beyond its limit.

        ``after_jump``: the one before jumped.
        """
        config, elapsed = self._config, pose.time_s - self.last.time_s
        if elapsed <= 0.0:
            return "out_of_order", None
        # Without a speed any may be meant; with one, it had ``elapsed`` and half the base to
        # change.
        base = self._base_s
        allowed = (
            0.5 * config.acceleration_m_s2 * elapsed * (elapsed + base)
            if base
            else config.speed_m_s * elapsed
        )
        limit = config.jump_m + allowed
        limit = min(DOUBT * limit, config.jump_m) if after_jump else limit
        away = self._away_m(pose)
        if away > limit:
            return "jump", (away, limit)
        far = math.dist(pose.position_ned, self._anchor.position_ned)
        took_s = pose.time_s - self._anchor.time_s
        if far > config.jump_m + config.speed_m_s * took_s:
            return "too_fast", ((far - config.jump_m) / took_s, config.speed_m_s)
        # The floor levels a leaning vehicle at touchdown in less time than passes between two
        # poses.
        levels = max(_lean_deg(self.last.attitude) - _lean_deg(pose.attitude), 0.0)
        turn = turned_deg(self.last.attitude, pose.attitude) - levels
        limit = TURN_DEG + config.rate_deg_s * elapsed
        return ("spin", (turn, limit)) if turn > limit else ("", None)

    def misfit(self, pose: Pose) -> float:
        """Return the misfit of ``pose`` to this track, to compare tracks by [-]."""
        turn = turned_deg(self.last.attitude, pose.attitude)
        return self._away_m(pose) / self._config.jump_m + turn / TURN_DEG

    @property
    def _base_s(self) -> float:
        """Time over which the speed is measured [s]; 0 while it is too short."""
        base = self.last.time_s - self._anchor.time_s
        return base if base >= 0.5 * BASE_S else 0.0

    def _away_m(self, pose: Pose) -> float:
        """Return the distance of ``pose`` from this track's prediction [m]."""
        base, last = self._base_s, self.last
        ahead = (pose.time_s - last.time_s) / base if base else 0.0
        (x, y, z), (a, b, c) = last.position_ned, self._anchor.position_ned
        return math.dist(
            pose.position_ned, (x + ahead * (x - a), y + ahead * (y - b), z + ahead * (z - c))
        )


def _lean_deg(attitude: Quat) -> float:
    """The angle between the body's vertical and the world's [deg], 0..180."""
    return so3.angle_deg(so3.third_column(attitude)[2])


def turned_deg(a: Quat, b: Quat) -> float:
    """The angle from attitude ``a`` to ``b`` [deg], 0..180."""
    (w, x, y, z), (p, q, r, s) = a, b
    return math.degrees(2.0 * math.acos(min(1.0, abs(w * p + x * q + y * r + z * s))))


MORE = 2.0
"""A rise of the latency by this factor is reported again [-]."""
QUIET_S = 2.0
"""An outbreak is over when nothing has been dropped for its reason for this long [s]."""


class Outbreaks:
    """Finds news in the counters of a source, each reported once.

    Times are on the event loop's clock [s].
    """

    def __init__(self, lost_s: float) -> None:
        """Poses count as lost after ``lost_s`` [s] without one."""
        self._lost_s = lost_s
        self._status = PoseStatus(0, {})
        self._running: dict[str, Outbreak] = {}
        self._looked_s: float | None = None
        self._newest: Pose | None = None
        self._lost = False
        self._late_s = 0.0
        self._late_until_s = 0.0
        self._advice = ""

    def look(self, now_s: float, status: PoseStatus, newest: Pose | None) -> list[Sentence]:
        """Return the news since the last look; ``newest`` is the newest accepted pose."""
        before, self._status = self._status, status
        news = self._find_lateness(now_s, status.late_s)
        if status.unsteady_clock != before.unsteady_clock:
            news.append(
                describe_unsteady_clock() if status.unsteady_clock else notice("pose.steady_clock")
            )
        for reason, count in status.dropped.items():
            if count == (known := before.dropped.get(reason, 0)):
                continue
            if reason not in self._running:
                self._running[reason] = Outbreak(
                    known, now_s if self._looked_s is None else self._looked_s
                )
                news.append(notice("pose.dropping", why=describe_drop(reason, status.excesses)))
            self._running[reason].newest_s = now_s
        self._looked_s = now_s
        if status.advice not in ("", self._advice):
            self._advice = status.advice
            news.append(notice("pose.advice", says=status.advice))
        for reason, outbreak in [*self._running.items()]:
            if now_s - outbreak.newest_s >= QUIET_S:
                del self._running[reason]
                count = status.dropped[reason] - outbreak.before
                lasted_s = outbreak.newest_s - outbreak.begun_s
                news.append(notice("pose.passed", reason=reason, count=count, lasted_s=lasted_s))
        return news if newest is None else [*news, *self._find_loss(now_s, newest)]

    def _find_lateness(self, now_s: float, late_s: float) -> list[Sentence]:
        if late_s > 0.0:
            self._late_until_s = now_s + QUIET_S
            if late_s > MORE * self._late_s:
                self._late_s = late_s
                return [notice("pose.later", late_ms=1e3 * late_s)]
        elif self._late_s and now_s >= self._late_until_s:
            self._late_s = 0.0
            return [notice("pose.punctual")]
        return []

    def _find_loss(self, now_s: float, newest: Pose) -> list[Sentence]:
        before, self._newest = self._newest, newest
        lost = now_s - newest.time_s > self._lost_s
        if lost == self._lost:
            return []
        self._lost = lost
        if lost:
            age_s = now_s - newest.time_s
            return [notice("pose.lost", age_ms=1e3 * age_s, limit_ms=1e3 * self._lost_s)]
        return [
            notice("pose.back", gap_s=newest.time_s - before.time_s if before is not None else 0.0)
        ]


class Outbreak(msgspec.Struct):
    """Drops for one reason in a row."""

    before: int
    """Count before it began."""
    begun_s: float
    newest_s: float = 0.0
    """Time of the newest drop [s]."""


def describe_origin_moves(count: int) -> Sentence:
    """Describe a source that moves its origin again and again, and the remedy."""
    return notice("pose.origin_moves", count=count, within_s=RESETS_S)


def describe_unsteady_clock() -> Sentence:
    """Describe a clock that steps again and again, and the remedy."""
    return notice("pose.unsteady_clock", count=MANY, within_s=UNSTEADY_S)


def describe_drop(reason: str, excesses: Mapping[str, Excess] = MappingProxyType({})) -> Sentence:
    """Describe the reason of dropped poses, with value and limit if ``excesses`` has them."""
    if reason in excesses:
        value, limit = excesses[reason]
        return notice(f"drop.{reason}.by", value=value, limit=limit)
    id = f"drop.{reason}"
    return notice(id) if id in NOTICES else notice("drop.other", reason=reason)
