"""A second witness: the vehicle's own tilt and turning, held against what the poses show. Sans-IO.

A tracker and an autopilot that look at one body see the same tilt and the same turning, whatever north each of them
has. Both are brought onto one grid of instants, ``STEP_S`` apart, as the direction of gravity in the body's axes and
the angle turned about it. Two things are compared there:

- *tilt*: the angle between both gravities, less what it was while the vehicle stood before arming (a body that is
  mounted askew), averaged over 0.1 s. The limit is 3°, more where they scattered by more than 1.5° before arming; and
  by a share of how far the vehicle leant of late, as an autopilot that knows no accelerations takes a part of a lean
  that lasts for level.
- *turning*: by how much both turn from 0.1 s to the next. Of all turning of the last 0.15 s, and of the last 0.6 s, the
  share that they do not have in common: none for one body, all where one stands still or turns at will, twice that
  where one turns the other way. It counts where it stands out of the noise of the poses.

Clocks may be apart and messages late: what the autopilot says of one instant is held against what the poses show up to
0.1 s before and after it, and the best of these counts. A heading that leaps, as an autopilot's estimator resets it,
tells nothing: where it goes farther than the gyros turned, turning is compared anew from there.
"""

import math
from collections import deque
from typing import NamedTuple

from groundstation.core.geometry.ops import Quat
from groundstation.core.geometry.so3 import conjugate, multiply
from groundstation.core.messages.pose import Pose
from links.core.port import Attitude

STEP_S = 0.05
"""From one instant that is compared to the next [s]."""
LAG = 2
"""The witnesses' clocks may be so many steps apart, either way."""
LAGS = tuple(range(-LAG, LAG + 1))
GAP_S = 0.13
"""Between two attitudes further apart nothing is known [s]."""
CLOSEST_S = 0.004
"""Poses that follow the last one faster tell nothing more [s]."""
LEAP_RAD = math.radians(1.5)
"""An autopilot's heading that goes so much farther than its gyros, from one message to the next, was reset."""
SILENT_S = 0.6
"""Nothing compared for so long: there is no second witness [s]."""

LEARN_S = 10.0
"""What is learnt before arming is that of so long [s]."""
TILT_UNIT_RAD, TILT_UNIT_MOST_RAD = math.radians(1.5), math.radians(3.0)
"""Their tilts scatter by so much at least, and believed is so much at most."""
TILT_UNITS = 2.0
"""The limit of the tilt, as a multiple of the scatter."""
TILT_TAU_S = 0.1
"""Over which the disagreement of the tilts is averaged [s]."""
LEAN_SHARE, LEAN_TAU_S = 0.3, 3.0
"""The share of the lean, that of now or its average over so long [s], by which an autopilot may be wrong."""
ASKEW_DEG = 8.0
"""The tilts of one body that stands are not farther apart [deg]."""
FOLLOW_RAD = math.radians(2.0)
"""In flight the tilts may drift apart by so much, slowly (the same ``LEARN_S``): vibrations shift an autopilot's."""

TURN_WINDOWS = ((0.15, 2, 4.0), (0.6, 6, 3.0))
"""Turning is compared over the last so long [s], from one instant to so many steps later, and stands out where its mean
square is about so many times that of the noise."""
SPAN = min(span for _, span, _ in TURN_WINDOWS)
"""So many steps after a gap the first turn is known."""
TURN_COUNTS_RAD_S = math.radians(20.0)
"""Faster turning counts as this [rad/s]: no leap counts for long."""
TURN_SHARE = 0.5
"""Of the turning, that share at most is not common."""
TURN_NOISE_RAD, TURN_NOISE_MOST_RAD = math.radians(0.3), math.radians(2.0)
"""Noise of a turn within 0.1 s is so much at least, and believed is so much at most."""
STANDS_RAD = math.radians(1.5)
"""A vehicle that turns less within 0.1 s stands, and its poses show their noise; else it is moved."""

MOVED_TAU_S = 3.0
"""How the vehicle was moved before arming: the newest so long of moving counts [s]."""
MOVED_RAD = math.radians(8.0)
"""Root of the sum of the squares of its turns about an axis, each within 0.1 s, that shows which way that goes."""
ALIKE, UNLIKE = 0.5, 0.8
"""Less of them is not common to both: the same way; more: another."""
AXES = (("pitch", 0), ("roll", 1), ("yaw", 3))
"""Which of a vector changes by it."""

_Vector = tuple[float, float, float, float]
"""Gravity in the body's axes, and the angle turned about it [rad]."""


class Agreement(NamedTuple):
    """What comes of holding both against each other."""

    share: float
    """The larger statistic as a share of its limit: from 1 on they disagree."""
    tilt_deg: float
    """How far the tilts are apart, beyond what they were before arming [deg]."""
    askew_deg: float
    """How far they were before arming: a body mounted askew, or another one [deg]."""
    turning: float
    """The statistic of the turning, as a share of its limit."""
    doubts_s: float | None
    """Since when they have disagreed, on the event loop's clock [s]; None where they agree."""
    alike: tuple[str, ...]
    """Of roll, pitch and yaw, those in which both went the same way when the vehicle was moved last, before arming."""
    unlike: tuple[str, ...]
    """Those in which they did not."""


class Witness:
    """One vehicle's. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """Nothing heard."""
        self._seen, self._felt = _Track(), _Track()
        self._pose: Pose | None = None
        self._told: Attitude | None = None
        self._next = 0
        self._judged_s = -math.inf
        self._armed = False
        self._learnt = 0
        self._askew = self._offset = (0.0, 0.0)
        self._scatter, self._noise = 0.0, TURN_NOISE_MOST_RAD**2  # squares
        self._moved = [(0.0, 0.0, 0.0) for _ in AXES]
        self._begin()

    def _begin(self) -> None:
        """Compare anew; what was learnt stays."""
        self._doubts_s: float | None = None
        self._apart: tuple[float, float, float] | None = None
        self._lean = self._tilting = self._turning = 0.0
        self._turns = [_Turns(*window) for window in TURN_WINDOWS]

    def arm(self) -> None:
        """From now on nothing is learnt but a slow drift of the tilts."""
        self._armed = True
        self._askew = self._offset = _within(self._askew, (0.0, 0.0), math.radians(ASKEW_DEG))

    def pose(self, pose: Pose) -> None:
        """Take one pose; one that is not newer than the last is ignored."""
        last, seen = self._pose, self._seen
        if last is None or pose.reset_count != last.reset_count:
            seen.forget()
            turned = 0.0
        elif pose.time_s - last.time_s < CLOSEST_S:
            return
        else:
            turned = seen.turned
        gravity = _gravity(pose.attitude)
        if last is not None:
            turned += _turn(last.attitude, pose.attitude, gravity)
        self._pose = pose
        if seen.take(pose.time_s, (*gravity, turned)):
            self._compare()

    def attitude(self, told: Attitude) -> None:
        """Take what the vehicle tells; what is not newer than the last is ignored."""
        last, felt = self._told, self._felt
        since = math.inf if last is None else told.time_s - last.time_s
        if -SILENT_S < since <= 0.0:
            return
        if since <= 0.0:  # its clock is another one
            felt.forget()
        gravity, turned = _gravity(told.attitude), felt.turned
        if last is not None and 0.0 < since <= GAP_S:
            (gx, gy, gz), (p, q, r), (a, b, c) = gravity, told.rates_rad_s, last.rates_rad_s
            by_gyros = 0.5 * since * ((p + a) * gx + (q + b) * gy + (r + c) * gz)
            by_angle = _turn(last.attitude, told.attitude, gravity)
            turned += by_angle
            if abs(by_angle - by_gyros) > LEAP_RAD:
                felt.forget()
        self._told = told
        if felt.take(told.time_s, (*gravity, turned)):
            self._compare()

    def verdict(self, now_s: float) -> Agreement | None:
        """What comes of it at ``now_s``; None where one of the two is silent."""
        if self._apart is None or now_s - self._judged_s > SILENT_S:
            return None
        alike, unlike = list[str](), list[str]()
        for (name, _), (different, seen, felt) in zip(AXES, self._moved, strict=True):
            if felt > MOVED_RAD * MOVED_RAD:
                share = different / (seen + felt)
                if share < ALIKE:
                    alike.append(name)
                elif share > UNLIKE:
                    unlike.append(name)
        return Agreement(
            share=max(self._tilting, self._turning),
            tilt_deg=math.degrees(math.hypot(*self._apart)),
            askew_deg=math.degrees(math.hypot(*self._askew)),
            turning=self._turning,
            doubts_s=self._doubts_s,
            alike=tuple(alike),
            unlike=tuple(unlike),
        )

    def _compare(self) -> None:
        """Judge every instant that both have come to, and the poses ``LAG`` steps beyond."""
        seen, felt = self._seen, self._felt
        end = min(seen.end - LAG, felt.end)
        number = max(self._next, seen.begin + LAG + SPAN, felt.begin + SPAN)
        while number < end:
            if number * STEP_S - self._judged_s > SILENT_S:
                self._begin()
            self._judge(number)
            number += 1
        self._next = number

    def _judge(self, number: int) -> None:
        seen, felt = self._seen, self._felt
        at, samples = number - seen.end, seen.samples
        a, b, c, _ = felt.samples[number - felt.end]
        x, y, _, _ = samples[at]
        askew = (x - a, y - b)
        if not self._armed:
            self._learn_askew(askew)
        ox, oy = self._offset
        least, apart = math.inf, (0.0, 0.0, 0.0)
        for lag in LAGS:
            x, y, z, _ = samples[at + lag]
            ex, ey, ez = x - a - ox, y - b - oy, z - c
            squared = ex * ex + ey * ey + ez * ez
            if squared < least:
                least, apart = squared, (ex, ey, ez)
        gain = STEP_S / TILT_TAU_S
        (x, y, z), (ex, ey, ez) = self._apart or apart, apart
        self._apart = x, y, z = x + gain * (ex - x), y + gain * (ey - y), z + gain * (ez - z)
        squared = x * x + y * y + z * z
        lean = math.sqrt(a * a + b * b)
        self._lean += (lean - self._lean) * (STEP_S / LEAN_TAU_S)
        unit = min(max(math.sqrt(self._scatter), TILT_UNIT_RAD), TILT_UNIT_MOST_RAD)
        self._tilting = math.sqrt(squared) / (TILT_UNITS * unit + LEAN_SHARE * max(lean, self._lean))
        noise = min(max(self._noise, TURN_NOISE_RAD**2), TURN_NOISE_MOST_RAD**2)
        for turns in self._turns:
            turns.add(number, seen, felt)
        self._turning = max([turns.statistic(noise) for turns in self._turns])
        self._judged_s = number * STEP_S
        agrees = self._tilting < 1.0 and self._turning < 1.0
        self._doubts_s = None if agrees else self._judged_s if self._doubts_s is None else self._doubts_s
        if self._armed and agrees:
            self._offset = _within(_towards(self._offset, askew, STEP_S / LEARN_S), self._askew, FOLLOW_RAD)
        elif not self._armed:
            self._note_moves(number)
            if agrees:
                self._learn_scatter(squared)

    def _learn_askew(self, askew: tuple[float, float]) -> None:
        """Take one instant into the mean of the last ``LEARN_S``, or of as long as there was."""
        self._learnt = min(self._learnt + 1, round(LEARN_S / STEP_S))
        self._askew = _towards(self._askew, askew, 1.0 / self._learnt)
        self._offset = _within(self._askew, (0.0, 0.0), math.radians(ASKEW_DEG))

    def _learn_scatter(self, squared: float) -> None:
        """The same of the square of what tilts are apart beyond that [rad²], and of turns while it stands."""
        gain, fast = 1.0 / self._learnt, self._turns[0]
        self._scatter += gain * (squared - self._scatter)
        if fast.felt < STANDS_RAD**2:
            self._noise += gain * (fast.newest - self._noise)

    def _note_moves(self, number: int) -> None:
        """Which way both turned where the vehicle was moved."""
        seen, felt, (_, span, _) = self._seen, self._felt, TURN_WINDOWS[0]
        lag = self._turns[-1].lag
        at = number - seen.end + lag
        p, p0 = seen.samples[at], seen.samples[at - span]
        at = number - felt.end
        q, q0 = felt.samples[at], felt.samples[at - span]
        keep = 1.0 - STEP_S / MOVED_TAU_S
        for axis, (_, n) in enumerate(AXES):
            by_seen, by_felt = p[n] - p0[n], q[n] - q0[n]
            if abs(by_felt) > STANDS_RAD:
                d, s, f = self._moved[axis]
                self._moved[axis] = (
                    keep * d + (by_seen - by_felt) ** 2, keep * s + by_seen**2, keep * f + by_felt**2
                )  # fmt: skip


class _Track:
    """One witness's attitudes on the grid."""

    def __init__(self) -> None:
        """Nothing taken."""
        self.end = 0
        """The number of the next instant."""
        self.samples: deque[_Vector] = deque(maxlen=round(2.0 / STEP_S))
        """Those since the last gap; the instant ``number`` is at ``number - end``."""
        self._time_s = -math.inf
        self._value: _Vector = (0.0, 0.0, 1.0, 0.0)

    @property
    def begin(self) -> int:
        """The number of the first instant that is known since the last gap."""
        return self.end - len(self.samples)

    @property
    def turned(self) -> float:
        """The newest angle about gravity [rad]."""
        return self._value[3]

    def take(self, time_s: float, value: _Vector) -> bool:
        """Take ``value`` at ``time_s`` [s], later than the last; returns whether an instant was passed."""
        last_s, last = self._time_s, self._value
        self._time_s, self._value = time_s, value
        since = time_s - last_s
        if since > GAP_S:
            self.samples.clear()
            self.end = math.floor(time_s / STEP_S) + 1
            return False
        if time_s < self.end * STEP_S:
            return False
        a, b, c, d = last
        x, y, z, w = value
        while self.end * STEP_S <= time_s:
            r = (self.end * STEP_S - last_s) / since
            self.samples.append((a + r * (x - a), b + r * (y - b), c + r * (z - c), d + r * (w - d)))
            self.end += 1
        return True

    def forget(self) -> None:
        """What comes next does not go on from here."""
        self._time_s = -math.inf


class _Turns:
    """How much of the turning of late is not common to both, at the lag where that is least."""

    def __init__(self, tau_s: float, span: int, noises: float) -> None:
        """Nothing has turned. See ``TURN_WINDOWS``."""
        self._gain = STEP_S / tau_s
        self._span = span
        self._noises = noises
        self._counts = (TURN_COUNTS_RAD_S * span * STEP_S) ** 2
        self._different = [0.0] * len(LAGS)
        self._all = 0.0
        self.newest = 0.0
        """The square of the newest difference, at no lag [rad²]."""
        self.felt = 0.0
        """The square of the newest turn that was felt [rad²]."""

    @property
    def lag(self) -> int:
        """By how many steps the poses are late."""
        return self._different.index(min(self._different)) - LAG

    def add(self, number: int, seen: "_Track", felt: "_Track") -> None:
        """Take the turns that end at the instant ``number``, where they began after the last gap."""
        span = self._span
        if number - span < max(felt.begin, seen.begin + LAG):
            return
        at, samples = number - felt.end, felt.samples
        (a, b, c, d), (x, y, z, w) = samples[at], samples[at - span]
        a, b, c, d = a - x, b - y, c - z, d - w
        self.felt = turned = a * a + b * b + c * c + d * d
        at, samples, squares = number - seen.end, seen.samples, []
        for n in LAGS:
            (p, q, r, s), (x, y, z, w) = samples[at + n], samples[at + n - span]
            p, q, r, s = p - x, q - y, r - z, s - w
            if n == 0:
                turned += p * p + q * q + r * r + s * s
            p, q, r, s = p - a, q - b, r - c, s - d
            squares.append(p * p + q * q + r * r + s * s)
        self.newest = squares[LAG]
        keep = 1.0 - self._gain
        counts = self._gain / (1.0 + turned / self._counts)
        self._all = keep * self._all + counts * turned
        self._different = [keep * old + counts * new for old, new in zip(self._different, squares, strict=True)]

    def statistic(self, noise: float) -> float:
        """As a share of its limit, where one that stands turns by ``noise``, squared [rad²]."""
        return min(self._different) / (TURN_SHARE * self._all + self._noises * noise)


def _gravity(attitude: Quat) -> tuple[float, float, float]:
    """The direction of gravity in the body's axes: the third row of R."""
    w, x, y, z = attitude
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)


def _turn(last: Quat, attitude: Quat, gravity: tuple[float, float, float]) -> float:
    """The small turn about ``gravity``, in the body's axes, from one attitude to the next [rad]."""
    w, x, y, z = multiply(conjugate(last), attitude)
    return math.copysign(2.0, w) * (x * gravity[0] + y * gravity[1] + z * gravity[2])


def _towards(what: tuple[float, float], there: tuple[float, float], share: float) -> tuple[float, float]:
    """``what``, moved by ``share`` of the way."""
    (x, y), (a, b) = what, there
    return x + share * (a - x), y + share * (b - y)


def _within(what: tuple[float, float], centre: tuple[float, float], radius: float) -> tuple[float, float]:
    """``what``, or the point nearest to it not farther than ``radius`` from ``centre``."""
    (x, y), (a, b) = what, centre
    far = math.hypot(x - a, y - b)
    return what if far <= radius else (a + (x - a) * radius / far, b + (y - b) * radius / far)
