"""What every decoder of poses shares: checks, the source's clock, our frames, numbers and counters. Sans-IO."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Protocol

from groundstation.core.geometry import Frames, Quat, Vec3
from groundstation.core.messages import FAR_M, Others, Pose, PoseStatus
from groundstation.pose.intake.source_clock import SourceClock

UNIT_TOLERANCE = 1e-3
"""How far from 1 the length of a unit quaternion may be; 32-bit floats leave it within 1e-6."""
LATEST = 1e15
"""No stamp is further from zero, be it in seconds or frames: floats would no longer tell two of them apart."""
_AVERAGED = 50


class Reader(Protocol):
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

    def heard(self, arrival_s: float) -> None:
        """The source has sent something at all, perhaps without our body, that came at ``arrival_s`` [s, our clock]."""
        self.clock.heard(arrival_s)

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

        ``age_s``: see :meth:`pose`. The source's stamp is the business of our own body alone.
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
