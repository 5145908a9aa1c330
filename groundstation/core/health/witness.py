"""Second witness of the attitude: the autopilot's own, compared with the poses. Sans-IO.

A tracker and an autopilot on the same body measure the same tilt and the same turning, even if
their norths differ. At the instants of the autopilot's messages two things are compared:

- *Turning*, in two ways: by the regression of :mod:`groundstation.core.health.pose_response`, with
  the autopilot's turn in the place of that by tones, and by the latency at which both fit best.
- *Tilt*: the angle between both directions of gravity, less the same angle at rest before arming
  (the mounting offset). An autopilot without a velocity source takes a part of a lasting lean for
  level.

If the vehicle is moved by hand before arming, the same axes must turn the same way in both.

Constants without a named origin were chosen; `groundstation-sim dev autopilots` and `dev faults`
fly them.
"""

import cmath
import math
from collections import deque
from typing import NamedTuple

import msgspec

from groundstation.core.geometry import (
    ZERO,
    Quat,
    Vec3,
    add,
    add_scaled,
    conjugate,
    euler_zyx,
    interpolate,
    multiply,
    rotate,
    rotation_vector,
    third_row,
)
from groundstation.core.health.latency import ATTITUDES_KEPT
from groundstation.core.health.pose_response import (
    BLOCK_S,
    LEAST_TURN_RAD,
    OWN_TURN,
    PLANE,
    SUSPECT_ALARM,
    TONE_MEMORY_S,
    HighPass,
    LatenessMonitor,
    Response,
)
from groundstation.core.messages import ROUNDING_S, Pose, Sentence, notice
from links.core import Attitude

GAP_S = 0.13
"""Longest interval between two poses, or two attitudes, that are interpolated or subtracted [s].

At 10 Hz, the slowest usual attitude messages, it bridges their jitter, but no missing message.
"""
KNOWN_S = 1.0
"""Time for which both are known to agree after they were last found to turn alike [s]."""
SILENT_S = 0.6
"""Time without a comparison after which there is no result [s]; poses of that long are kept."""
REPORTED_AFTER_S = 2.0
"""Duration of a disagreement before it is reported [s]: a shorter one may be an outlier."""
TILT_DEG = 10.0
"""Tilt between both beyond the mounting offset that is a disagreement [deg]: twice the largest
effect of vibration."""
LEAN_SHARE = 0.3
"""Share of the lean that is added to ``TILT_DEG`` [-]: the error of PX4 and ArduCopter in steady
wind (`groundstation-sim dev autopilots`)."""
TILT_MEMORY_S = 0.3
"""Time constant of the mean tilt between both [s]."""
LEARN_S = 10.0
"""Time constant of mounting offset and north [s]: the offset is averaged before arming, the north
as long as both agree."""
MOUNTING_DEG = 8.0
"""Largest mounting offset, tilt between both at rest, that the pre-arm check accepts [deg]."""
MOVED_MEMORY_S = 3.0
"""Time constant of the turns by hand [s]."""
MOVED_RAD = math.radians(8.0)
"""Turn by hand about an axis from which its directions are compared [rad]: root of the sum of the
squared turns in steps of ``STEP_S``. A turn by 25° in 1 s gives it."""
STEP_S = 0.1
"""Length of a step of a turn by hand [s]."""
MOVED_STEP_RAD = 10.0 * LEAST_TURN_RAD
"""Least turn in a step that counts as a turn by hand [rad]: above the noise of a vehicle at
rest."""
ALIKE_SHARE = 0.5
"""Share of squared turning that differs below which both turned the same way [-]: 0 for equal
turns, 1 for unrelated, 2 for opposite ones. It is 1 less the correlation of turns of one size."""
UNLIKE_SHARE = 0.8
"""Share of squared turning that differs above which they turned different ways [-]: unrelated turns
count, too. Between ``ALIKE_SHARE`` and this the axis counts as neither."""
AXES = ("roll", "pitch", "yaw")
"""Names of the axes that are compared before arming."""


class Agreement(NamedTuple):
    """Result of the comparison."""

    alarm: float
    """Larger of the two statistics, tilt and turning, as a share of its limit [-]: from 1 on, both
    disagree."""
    tilt_deg: float
    """Tilt between both, beyond the mounting offset [deg]."""
    mounting_deg: float
    """Mounting offset: tilt between both before arming [deg]. A large one may mean another body."""
    agrees: bool | None
    """Whether both agree; None if the vehicle turned too little of late to decide."""
    disagrees_since_s: float | None
    """Begin of the present disagreement, on the event loop's clock [s]; None without one."""
    alike: tuple[str, ...]
    """Axes of roll, pitch and yaw that turned the same way when the vehicle was last moved by hand,
    before arming."""
    unlike: tuple[str, ...]
    """Axes that turned different ways."""


class Witness:
    """The comparison for one vehicle. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self._attitudes: deque[Attitude] = deque(maxlen=ATTITUDES_KEPT)
        """Attitudes of the autopilot that wait for poses."""
        self._poses: deque[Pose] = deque()
        self._pair: _Pair | None = None
        """Newest comparison."""
        self._at_s = -math.inf
        """Instant of the newest comparison."""
        self._known_s = -math.inf
        """Newest instant at which both were found to turn alike."""
        self._disagrees_since_s: float | None = None
        self._is_reported = self._is_armed = False
        self._turning = 0.0
        """Alarm of the turning [-]."""
        self._mounting: tuple[float, float] | None = None
        """Mean difference of both directions of gravity before arming, forward and right [rad, for
        small angles]."""
        self._tilt, self._lean = (0.0, 0.0), 0.0
        """Mean difference beyond that, and mean lean by the autopilot [rad]."""
        self._north = 0j
        """Mean of e^(i δ), δ the heading by the poses less that by the autopilot."""
        self._moves = _HandMoves()
        self._restart()

    def _restart(self) -> None:
        """Forget the turning; mounting offset and north stay."""
        self._response = Response(PLANE, TONE_MEMORY_S, LEAST_TURN_RAD, OWN_TURN)
        self._lateness = LatenessMonitor()
        self._pass = HighPass(2)
        self._block_s = 0.0

    def arm(self) -> None:
        """Freeze the mounting offset: the motors start."""
        self._is_armed = True

    def add_pose(self, pose: Pose) -> None:
        """Take one pose; :meth:`pair_up` compares it."""
        poses = self._poses
        last = poses[-1] if poses else None
        if (
            last is None
            or pose.reset_count != last.reset_count
            or not 0.0 < pose.time_s - last.time_s <= GAP_S
        ):
            poses.clear()
            self._pair = None
        poses.append(pose)
        while pose.time_s - poses[0].time_s > SILENT_S:
            poses.popleft()

    def add_attitude(self, reported: Attitude) -> None:
        """Take one attitude reported by the autopilot.

        Over a radio it arrives after poses of later instants.
        """
        if self._attitudes and reported.time_s <= self._attitudes[-1].time_s:
            # The autopilot's clock has restarted.
            if reported.time_s < self._attitudes[-1].time_s - SILENT_S:
                self._attitudes.clear()
            return
        self._attitudes.append(reported)
        self.pair_up()

    def pair_up(self) -> None:
        """Compare each attitude whose instant is between two poses with the pose interpolated at
        it.
        """
        poses = self._poses
        while self._attitudes and poses and self._attitudes[0].time_s <= poses[-1].time_s:
            reported = self._attitudes.popleft()
            while len(poses) > 1 and poses[1].time_s < reported.time_s:
                poses.popleft()
            if len(poses) < 2 or reported.time_s <= poses[0].time_s:
                continue
            last, pose = poses[0], poses[1]
            share = (reported.time_s - last.time_s) / (pose.time_s - last.time_s)
            x, y, z = rotation_vector(multiply(conjugate(last.attitude), pose.attitude))
            measured = rotate(last.attitude, (share * x, share * y, share * z))
            self._compare(_Pair(reported.time_s, measured, reported.attitude))

    def convert_to_poses(self, reported: Attitude) -> Quat | None:
        """Convert an attitude of the autopilot to the north and the body axes of the poses.

        None before the first comparison.
        """
        if self._mounting is None or self._north == 0j:
            return None
        half = 0.5 * cmath.phase(self._north)
        in_north_of_poses = multiply((math.cos(half), 0.0, 0.0, math.sin(half)), reported.attitude)
        # The small turn of the body that moves gravity in its axes by the mounting offset.
        x, y = self._mounting
        return rotate(in_north_of_poses, (y, -x, 0.0))

    def agrees(self, now_s: float) -> bool | None:
        """Return whether both agree at ``now_s``; None where that is not known: one of both is
        missing, or the vehicle has turned too little of late.
        """
        if now_s - self._at_s > SILENT_S:
            return None
        if self._disagrees_since_s is not None:
            return False
        return True if self._at_s - self._known_s < KNOWN_S else None

    def verdict(self, now_s: float) -> Agreement | None:
        """Return the result at ``now_s``; None while the poses or the attitudes are missing."""
        if self._mounting is None or now_s - self._at_s > SILENT_S:
            return None
        alike, unlike = self._moves.compare()
        return Agreement(
            alarm=self._alarm,
            tilt_deg=math.degrees(math.hypot(*self._tilt)),
            mounting_deg=math.degrees(math.hypot(*self._mounting)),
            agrees=self.agrees(now_s),
            disagrees_since_s=self._disagrees_since_s,
            alike=alike,
            unlike=unlike,
        )

    @property
    def _alarm(self) -> float:
        """Larger alarm of turning and tilt [-]: from 1 on, both disagree."""
        limit = math.radians(TILT_DEG) + LEAN_SHARE * self._lean
        return max(self._turning, math.hypot(*self._tilt) / limit)

    def describe_news(self) -> Sentence | None:
        """Return the sentence for the operator, once for each disagreement that has lasted
        ``REPORTED_AFTER_S``; None otherwise.
        """
        if self._disagrees_since_s is None:
            self._is_reported = False
            return None
        if self._is_reported or self._at_s - self._disagrees_since_s < REPORTED_AFTER_S:
            return None
        self._is_reported = True
        return notice("pose.autopilot_disagrees")

    def _compare(self, pair: "_Pair") -> None:
        """Compare tilt and turning of one instant."""
        last, self._pair = self._pair, pair
        dt = pair.time_s - self._at_s
        self._at_s = pair.time_s
        # Direction of gravity in the body's axes, by the poses and by the autopilot.
        (x, y, _), (a, b, c) = third_row(pair.measured), third_row(pair.reported)
        difference = (x - a, y - b)
        learn, gain = min(dt / LEARN_S, 1.0), min(dt / TILT_MEMORY_S, 1.0)
        if self._mounting is None:
            self._mounting = difference
        if not self._is_armed:
            self._mounting = interpolate(self._mounting, difference, learn)
        beyond_mounting = (difference[0] - self._mounting[0], difference[1] - self._mounting[1])
        self._tilt = interpolate(self._tilt, beyond_mounting, gain)
        self._lean += gain * (math.acos(max(-1.0, min(c, 1.0))) - self._lean)
        if self._disagrees_since_s is None:
            turned = euler_zyx(pair.measured)[2] - euler_zyx(pair.reported)[2]
            self._north += learn * (cmath.exp(1j * turned) - self._north)
        if last is None or not 0.0 < dt <= GAP_S:
            self._restart()
            return
        measured = rotation_vector(multiply(conjugate(last.measured), pair.measured))
        reported = rotation_vector(multiply(conjugate(last.reported), pair.reported))
        self._add_turn(pair.time_s, measured, reported, dt)
        if not self._is_armed:
            self._moves.add(measured, reported, dt)

    def _add_turn(self, now_s: float, measured: Vec3, reported: Vec3, dt: float) -> None:
        """Compare one turn about roll and pitch. Heading is left out: an autopilot may reset it."""
        roll, pitch, reported_roll, reported_pitch = self._pass.step(
            [*measured[:2], *reported[:2]], dt
        )
        difference = (roll - reported_roll, pitch - reported_pitch)
        # All of the reported turn counts as commanded by tones, and nothing as the law's own.
        self._response.add(difference, (reported_roll, reported_pitch), (0.0, 0.0), dt)
        self._lateness.add(now_s, (roll, pitch), (reported_roll, reported_pitch), dt)
        self._block_s += dt
        if self._block_s < BLOCK_S - ROUNDING_S:
            return
        self._block_s = min(self._block_s - BLOCK_S, BLOCK_S)
        alarm = self._response.look(LEAST_TURN_RAD)
        self._turning = max(alarm.tones, 1.0 if self._lateness.late_s > 0.0 else 0.0)
        if alarm.is_known and self._turning < SUSPECT_ALARM:
            self._known_s = now_s
        if self._alarm < 1.0:
            self._disagrees_since_s = None
        elif self._disagrees_since_s is None:
            self._disagrees_since_s = now_s


class _Pair(msgspec.Struct, frozen=True, gc=False):
    """Both attitudes of one instant."""

    time_s: float
    measured: Quat
    """Attitude by the poses."""
    reported: Quat
    """Attitude by the autopilot."""


class _HandMoves:
    """Turns about roll, pitch and yaw, by the poses and by the autopilot, while the vehicle is
    moved by hand.
    """

    def __init__(self) -> None:
        self._step_s, self._measured, self._reported = 0.0, ZERO, ZERO
        self._sums = [ZERO for _ in AXES]
        """For each axis, fading sums of squared turns in steps: of the difference, by the poses, by
        the autopilot."""

    def add(self, measured: Vec3, reported: Vec3, dt: float) -> None:
        """Take one turn about each axis, by the poses and by the autopilot [rad]."""
        self._step_s += dt
        self._measured = add(self._measured, measured)
        self._reported = add(self._reported, reported)
        if self._step_s < STEP_S:
            return
        keep = math.exp(-self._step_s / MOVED_MEMORY_S)
        for axis, (x, y) in enumerate(zip(self._measured, self._reported, strict=True)):
            if math.hypot(x, y) > MOVED_STEP_RAD:
                self._sums[axis] = add_scaled(((x - y) ** 2, x * x, y * y), keep, self._sums[axis])
        self._step_s, self._measured, self._reported = 0.0, ZERO, ZERO

    def compare(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the axes that turned the same way in both, and those that turned different ways.

        Of the others it is not known.
        """
        alike, unlike = list[str](), list[str]()
        for name, (different, measured, reported) in zip(AXES, self._sums, strict=True):
            if reported > MOVED_RAD * MOVED_RAD:
                share = different / (measured + reported)
                if share < ALIKE_SHARE:
                    alike.append(name)
                elif share > UNLIKE_SHARE:
                    unlike.append(name)
        return tuple(alike), tuple(unlike)
