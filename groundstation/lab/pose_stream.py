"""Pose stream: its rate, age, jitter, gaps, place, and its noise while the vehicle rests. Sans-IO."""

import math
from collections import Counter, deque
from itertools import pairwise
from statistics import fmean, pstdev

import msgspec

from groundstation.core.estimation import fourth_difference
from groundstation.core.geometry import Vec3, conjugate, euler_zyx, multiply, rotation_vector
from groundstation.core.messages import Pose, PoseEvent, PoseStatus

WINDOW_S = 2.0
"""Jitter and noise are those of the last so many seconds [s]."""
REST_M, REST_NOISE = 0.002, 4.0
"""At rest the halves of the window have the same mean within this, and so many times the noise of one pose [m]."""
KEPT_EVENTS = 20


class PoseStreamSummary(msgspec.Struct, frozen=True, kw_only=True):
    """A stream of poses as it is now."""

    poses: int
    """That have passed the gate."""
    recorded: bool
    """Whether a recording is played: all that follows is then as it was, up to the newest pose."""
    rate_hz: float
    """Arrivals per second, over the window [1/s]."""
    source_rate_hz: float
    """By the source's own stamps [1/s]; 0 where there are too few."""
    age_s: float | None
    """Time since the newest pose was true [s]; None before the first, and of a recording."""
    latency_s: float
    """From the instant of a pose to its arrival, averaged [s]."""
    latency_max_s: float
    """The longest [s]."""
    jitter_s: float
    """Standard deviation of the time from one arrival to the next [s]."""
    longest_s: float
    """The longest time from one arrival to the next, of all [s]."""
    gaps: int
    """How often poses were missing."""
    clock_steps: int
    """How often the source's clock leapt ahead or began anew."""
    drift: float | None
    """How much slower than ours the source's clock runs, as a share; None of a recording."""
    position_ned: Vec3 | None
    """[m]"""
    roll_pitch_yaw_deg: Vec3 | None
    at_rest: bool
    """Whether the vehicle stood still for the whole window."""
    noise_m: Vec3 | None
    """Standard deviation north, east, down while at rest [m]; None where it moves."""
    noise_deg: Vec3 | None
    """The same about its own axes forward, right, down [deg]."""
    dropped: dict[str, int]
    """By reason."""
    bodies: tuple[str, ...]
    """Names that the source has told, where ours was not among them or it tells all."""
    events: tuple[str, ...]
    """The newest, oldest first, each ``12.3 text`` with the seconds since the start."""

    @property
    def ok(self) -> bool:
        """Whether there are poses now; of a recording, any at all."""
        if self.recorded:
            return self.poses > 0
        return self.age_s is not None and self.rate_hz > 0.0


class PoseStreamMonitor:
    """Remembers what it takes to say that; times are on the event loop's clock [s]."""

    def __init__(self, begun_s: float, *, recorded: bool = False) -> None:
        """Nothing seen at ``begun_s`` [s]; ``recorded`` where a recording is played."""
        self._recorded = recorded
        self._begun_s = begun_s
        self._recent: deque[Pose] = deque()
        self._events: deque[str] = deque(maxlen=KEPT_EVENTS)
        self._longest_s = 0.0
        self._poses = 0

    def pose(self, pose: Pose) -> None:
        """One more."""
        if self._recent:
            self._longest_s = max(self._longest_s, pose.arrival_s - self._recent[-1].arrival_s)
        self._poses += 1
        self._recent.append(pose)
        self._forget(pose.arrival_s - WINDOW_S, least=2)

    def event(self, event: PoseEvent, now_s: float) -> None:
        """Something happened to them."""
        self._events.append(f"{now_s - self._begun_s:.1f} {event.text}")

    def summarize(self, now_s: float, status: PoseStatus, bodies: tuple[str, ...] = ()) -> PoseStreamSummary:
        """All of it; ``status`` and ``bodies`` are the source's."""
        newest = self._recent[-1] if self._recent else None
        if self._recorded and newest is not None:  # played faster it arrives in the future, and at its end is no fault
            now_s = newest.arrival_s
        recent = [pose for pose in self._recent if pose.arrival_s > now_s - WINDOW_S]
        apart = [b.arrival_s - a.arrival_s for a, b in pairwise(recent)]
        window_s = min(WINDOW_S, now_s - self._begun_s)
        noise = _at_rest(recent) if window_s >= WINDOW_S else None
        return PoseStreamSummary(
            poses=self._poses,
            recorded=self._recorded,
            rate_hz=(len(apart) / sum(apart) if len(recent) > 1 and now_s - recent[-1].arrival_s < 1.0 else 0.0),
            source_rate_hz=status.rate_hz,
            age_s=None if newest is None or self._recorded else now_s - newest.time_s,
            latency_s=status.latency_s,
            latency_max_s=status.latency_max_s,
            jitter_s=pstdev(apart) if apart else 0.0,
            longest_s=self._longest_s,
            gaps=status.gaps,
            clock_steps=status.clock_steps + status.clock_restarts,
            drift=None if self._recorded else status.drift,
            position_ned=None if newest is None else newest.position_ned,
            roll_pitch_yaw_deg=None if newest is None else _degrees(euler_zyx(newest.attitude)),
            at_rest=noise is not None,
            noise_m=None if noise is None else noise[0],
            noise_deg=None if noise is None else noise[1],
            dropped=dict(sorted(Counter(status.dropped).items())),
            bodies=bodies,
            events=tuple(self._events),
        )

    def _forget(self, before_s: float, least: int) -> None:
        while len(self._recent) > least and self._recent[0].arrival_s < before_s:
            self._recent.popleft()


def _at_rest(poses: list[Pose]) -> tuple[Vec3, Vec3] | None:
    """Noise of place [m] and attitude [deg] where the vehicle does not move; None where it does, or who knows."""
    if len(poses) < 10:
        return None
    places = [pose.position_ned for pose in poses]
    fives = zip(places, places[1:], places[2:], places[3:], places[4:], strict=False)
    noise = math.sqrt(fmean(fourth_difference(*five)[0] for five in fives))
    half = len(places) // 2
    if math.dist(_mean(places[:half]), _mean(places[half:])) > REST_M + REST_NOISE * noise:
        return None
    back = conjugate(poses[0].attitude)
    turns = [_degrees(rotation_vector(multiply(back, pose.attitude))) for pose in poses]
    return _deviation(places), _deviation(turns)


def _mean(vectors: list[Vec3]) -> Vec3:
    x, y, z = (fmean(axis) for axis in zip(*vectors, strict=True))
    return x, y, z


def _deviation(vectors: list[Vec3]) -> Vec3:
    x, y, z = (pstdev(axis) for axis in zip(*vectors, strict=True))
    return x, y, z


def _degrees(angles: Vec3) -> Vec3:
    x, y, z = map(math.degrees, angles)
    return x, y, z
