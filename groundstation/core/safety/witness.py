"""Second witness: the autopilot's own attitude, compared with the poses'. Sans-IO.

A tracker and an autopilot that look at one body see the same tilt and the same turning, whatever
north each of them has. At the instants of the autopilot's messages two things are compared:

- *turning*, by the regression that compares the poses with the commands
  (:mod:`groundstation.core.safety.pose_response`), with the autopilot's turn in the place of the model's, and by the
  latency that fits both best;
- *tilt*, the angle between both directions of gravity, less what it was while the vehicle stood before arming (a body
  that is mounted askew). An autopilot that knows no accelerations takes a part of a lean that lasts for level.

Before arming, a vehicle that is moved by hand shows whether roll, pitch and yaw go the same way in both.
"""

import cmath
import math
from collections import deque
from typing import NamedTuple

from groundstation.core.geometry import Quat, Vec3, conjugate, euler_zyx, multiply, rotate, rotation_vector, third_row
from groundstation.core.messages import Pose, Sentence, notice
from groundstation.core.safety.pose_response import (
    BLOCK_S,
    LEAST_TURN_RAD,
    OWN_TURN,
    PLANE,
    TURN_MEMORY_S,
    HighPass,
    LatenessMonitor,
    Response,
)
from links.core import Attitude

GAP_S = 0.13
"""Interval of poses or attitudes after which nothing is known between them [s]: one message of 10 Hz may be missing."""
KEPT = 32
"""Attitudes that wait for a pose of their instant [-]."""
KNOWN_S = 1.0
"""Time for which an answer that was known stays known [s]: one question of the poses."""
SILENT_S = 0.6
"""Time without a comparison after which there is no second witness [s]."""
LASTS_S = 2.0
"""Time for which both must disagree to be told to the operator [s]: less may be an outlier."""
TILT_DEG = 10.0
"""Tilt between both, beyond that before arming, that is a disagreement [deg]: twice what vibration was seen to do."""
LEAN_SHARE = 0.3
"""Share of the lean by which an autopilot may be wrong that knows no accelerations [-]: PX4 and ArduCopter in steady
wind (`autopilots`)."""
TILT_MEMORY_S = 0.3
"""Time constant of the mean tilt between both [s]."""
LEARN_S = 10.0
"""Time constant of what is learnt before arming [s]."""
ASKEW_DEG = 8.0
"""Largest tilt between both of one body that stands [deg]."""
MOVED_MEMORY_S = 3.0
"""Time constant of how the vehicle was moved by hand [s]."""
MOVED_RAD = math.radians(8.0)
"""Turn by hand about an axis that shows which way it goes [rad], root of the sum of squares of .1 s each."""
STEP_S = 0.1
"""Time over which such turns are taken [s]."""
ALIKE_SHARE = 0.5
"""Share of the turning that is not common, below which both went the same way [-]."""
UNLIKE_SHARE = 0.8
"""Share of the turning that is not common, above which both went other ways [-]."""
AXES = ("roll", "pitch", "yaw")


class Agreement(NamedTuple):
    """Result of the comparison."""

    alarm: float
    """Larger of both statistics as a share of its limit: from 1 on they disagree [-]."""
    tilt_deg: float
    """Tilt between both, beyond that before arming [deg]."""
    askew_deg: float
    """Tilt between both before arming: a body mounted askew, or another one [deg]."""
    agrees: bool | None
    """Whether both turn alike, where the turning of late was enough to tell."""
    doubts_s: float | None
    """Instant since which they have disagreed, on the event loop's clock [s]; None where they do not."""
    alike: tuple[str, ...]
    """Those of roll, pitch and yaw that went the same way when the vehicle was moved last, before arming."""
    unlike: tuple[str, ...]
    """Those that did not."""


class Witness:
    """One vehicle's. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self._told: deque[Attitude] = deque(maxlen=KEPT)
        self._poses: deque[Pose] = deque()
        self._pair: _Pair | None = None
        self._at_s = self._known_s = -math.inf
        self._doubts_s: float | None = None
        self._is_told = self._is_armed = False
        self._turning = 0.0
        self._askew: tuple[float, float] | None = None
        self._tilt, self._lean = (0.0, 0.0), 0.0
        self._north = 0j
        self._moves = _HandMoves()
        self._restart()

    def _restart(self) -> None:
        """Compare anew; what was learnt before arming stays."""
        self._response = Response(PLANE, TURN_MEMORY_S, LEAST_TURN_RAD, OWN_TURN)
        self._lateness = LatenessMonitor()
        self._pass = HighPass(2, 4)
        self._block_s = 0.0

    def arm(self) -> None:
        """Learn no more of how the body is mounted."""
        self._is_armed = True

    def pose(self, pose: Pose) -> None:
        """Take one pose."""
        poses = self._poses
        last = poses[-1] if poses else None
        if last is None or pose.reset_count != last.reset_count or not 0.0 < pose.time_s - last.time_s <= GAP_S:
            poses.clear()
            self._pair = None
        poses.append(pose)
        while pose.time_s - poses[0].time_s > SILENT_S:
            poses.popleft()
        self._pair_up()

    def attitude(self, told: Attitude) -> None:
        """Take one attitude of the autopilot. Over a radio it comes after poses that are younger."""
        if self._told and told.time_s <= self._told[-1].time_s:
            if told.time_s < self._told[-1].time_s - SILENT_S:  # its clock is another one
                self._told.clear()
            return
        self._told.append(told)
        self._pair_up()

    def _pair_up(self) -> None:
        """Compare all attitudes that poses enclose."""
        poses = self._poses
        while self._told and poses and self._told[0].time_s <= poses[-1].time_s:
            told = self._told.popleft()
            while len(poses) > 1 and poses[1].time_s < told.time_s:
                poses.popleft()
            if len(poses) < 2 or told.time_s <= poses[0].time_s:
                continue
            last, pose = poses[0], poses[1]
            share = (told.time_s - last.time_s) / (pose.time_s - last.time_s)
            x, y, z = rotation_vector(multiply(conjugate(last.attitude), pose.attitude))
            self._compare(_Pair(told.time_s, rotate(last.attitude, (share * x, share * y, share * z)), told.attitude))

    def in_poses(self, told: Attitude) -> Quat | None:
        """Attitude of the autopilot in the axes of the poses; None where they were never compared."""
        if self._askew is None or self._north == 0j:
            return None
        half = 0.5 * cmath.phase(self._north)
        x, y = self._askew
        return rotate(multiply((math.cos(half), 0.0, 0.0, math.sin(half)), told.attitude), (y, -x, 0.0))

    def verdict(self, now_s: float) -> Agreement | None:
        """Result at ``now_s``; None where one of the two is silent."""
        if self._askew is None or now_s - self._at_s > SILENT_S:
            return None
        alike, unlike = self._moves.compare()
        known = self._at_s - self._known_s < KNOWN_S
        return Agreement(
            alarm=self._alarm,
            tilt_deg=math.degrees(math.hypot(*self._tilt)),
            askew_deg=math.degrees(math.hypot(*self._askew)),
            agrees=False if self._doubts_s is not None else True if known else None,
            doubts_s=self._doubts_s,
            alike=alike,
            unlike=unlike,
        )

    @property
    def _alarm(self) -> float:
        limit = math.radians(TILT_DEG) + LEAN_SHARE * self._lean
        return max(self._turning, math.hypot(*self._tilt) / limit)

    def describe_news(self) -> Sentence | None:
        """Sentence for the operator, once for each disagreement that lasts."""
        if self._doubts_s is None:
            self._is_told = False
            return None
        if self._is_told or self._at_s - self._doubts_s < LASTS_S:
            return None
        self._is_told = True
        return notice("pose.autopilot_disagrees")

    def _compare(self, pair: "_Pair") -> None:
        last, self._pair = self._pair, pair
        dt = pair.time_s - self._at_s
        self._at_s = pair.time_s
        (x, y, _), (a, b, c) = third_row(pair.seen), third_row(pair.told)
        off = (x - a, y - b)
        if self._askew is None:
            self._askew = off
        if not self._is_armed:
            self._askew = _towards(self._askew, off, min(dt / LEARN_S, 1.0))
        gain = min(dt / TILT_MEMORY_S, 1.0)
        self._tilt = _towards(self._tilt, (off[0] - self._askew[0], off[1] - self._askew[1]), gain)
        self._lean += gain * (math.acos(max(-1.0, min(c, 1.0))) - self._lean)
        if self._doubts_s is None:
            turned = euler_zyx(pair.seen)[2] - euler_zyx(pair.told)[2]
            self._north += min(dt / LEARN_S, 1.0) * (cmath.exp(1j * turned) - self._north)
        if last is None or not 0.0 < dt <= GAP_S:
            self._restart()
            return
        seen = rotation_vector(multiply(conjugate(last.seen), pair.seen))
        told = rotation_vector(multiply(conjugate(last.told), pair.told))
        self._take_turn(pair.time_s, seen, told, dt)
        if not self._is_armed:
            self._moves.add(seen, told, dt)

    def _take_turn(self, now_s: float, seen: Vec3, told: Vec3, dt: float) -> None:
        """Compare one turn; heading, which an autopilot resets, takes no part."""
        roll, pitch, told_roll, told_pitch = self._pass.step([*seen[:2], *told[:2]], dt)
        off = (roll - told_roll, pitch - told_pitch)
        self._response.add(off, (told_roll, told_pitch), (0.0, 0.0), dt)
        self._lateness.add(now_s, (roll, pitch), (told_roll, told_pitch), dt)
        self._block_s += dt
        if self._block_s < BLOCK_S - 1e-6:
            return
        self._block_s = min(self._block_s - BLOCK_S, BLOCK_S)
        alarm = self._response.look(LEAST_TURN_RAD)
        self._turning = max(alarm.asked, 1.0 if self._lateness.late_s > 0.0 else 0.0)
        if alarm.is_known and self._turning < ALIKE_SHARE:
            self._known_s = now_s
        doubts = self._alarm >= 1.0
        self._doubts_s = None if not doubts else now_s if self._doubts_s is None else self._doubts_s


class _Pair(NamedTuple):
    """Both attitudes of one instant."""

    time_s: float
    seen: Quat
    told: Quat


class _HandMoves:
    """Turning of both while the vehicle is moved by hand."""

    def __init__(self) -> None:
        self._step_s = 0.0
        self._seen, self._told = [0.0] * 3, [0.0] * 3
        self._sums = [[0.0] * 3 for _ in AXES]

    def add(self, seen: Vec3, told: Vec3, dt: float) -> None:
        """Take one turn about each axis [rad]."""
        self._step_s += dt
        for axis in range(3):
            self._seen[axis] += seen[axis]
            self._told[axis] += told[axis]
        if self._step_s < STEP_S:
            return
        keep = math.exp(-self._step_s / MOVED_MEMORY_S)
        for sums, x, y in zip(self._sums, self._seen, self._told, strict=True):
            if math.hypot(x, y) > LEAST_TURN_RAD * 10.0:
                for i, square in enumerate(((x - y) ** 2, x * x, y * y)):
                    sums[i] = keep * sums[i] + square
        self._step_s, self._seen, self._told = 0.0, [0.0] * 3, [0.0] * 3

    def compare(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Axes that went the same way in both, and those that did not."""
        alike, unlike = list[str](), list[str]()
        for name, (different, seen, told) in zip(AXES, self._sums, strict=True):
            if told > MOVED_RAD * MOVED_RAD:
                share = different / (seen + told)
                if share < ALIKE_SHARE:
                    alike.append(name)
                elif share > UNLIKE_SHARE:
                    unlike.append(name)
        return tuple(alike), tuple(unlike)


def _towards(what: tuple[float, float], there: tuple[float, float], share: float) -> tuple[float, float]:
    """``what``, moved by ``share`` of the way."""
    (x, y), (a, b) = what, there
    return x + share * (a - x), y + share * (b - y)
