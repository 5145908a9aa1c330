"""A second witness: the vehicle's own tilt and turning, held against what the poses show. Sans-IO.

A tracker and an autopilot that look at one body see the same tilt and the same turning, whatever north each of them
has. Both are brought onto one grid of instants, as the direction of gravity in the body's axes and the angle turned
about it. Two things are compared there, every 0.05 s, or every 0.15 s while all is well:

- *tilt*: the angle between both gravities, less what it was while the vehicle stood before arming (a body that is
  mounted askew), averaged over 0.1 s. The limit is 3°, more where they scattered by more than 1.5° before arming; and
  by a share of how far the vehicle leant of late, as an autopilot that knows no accelerations takes a part of a lean
  that lasts for level.
- *turning*: by how much both turn from 0.1 s to the next. Of all turning of the last 0.15 s, and of the last 0.6 s, the
  share that they do not have in common: none for one body, all where one stands still or turns at will, twice that
  where one turns the other way. It counts where it stands out of the noise of the poses.

Clocks may be apart and messages late: what the autopilot says of one instant is held against what the poses show up to
0.1 s before and after it, and the best of these counts; it is looked for only where they disagree by more than their
noise as they come. Through a radio attitudes come ten times a second at best, and without rates: of the turning only
that of the last 0.6 s counts there. A heading that leaps, as an autopilot's estimator resets it, tells nothing: where
it goes farther than the gyros turned, turning is compared anew from there.

Pose latency is how much later poses are than told, by the same attitude. It is found as the monitor of obedience finds
how much later the vehicle answers (:mod:`groundstation.core.safety.obedience`), but ω is what the autopilot tells.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from groundstation.core.geometry import Quat, third_row
from groundstation.core.messages import Pose
from groundstation.core.safety.obedience import AGAIN_S, LATENCY_MEMORY_S, SLOW_S, LatencyFit, describe_latency
from links.core import Attitude

STEP_S = 0.05
"""From one instant that may be compared to the next [s]."""
LAG = 2
"""The witnesses' clocks may be so many steps apart, either way."""
LAGS = tuple(lag for lag in range(-LAG, LAG + 1) if lag)
CALM, STRIDE = 0.3, 3
"""While both statistics are below this share of their limits, only every so many instants are compared."""
GAP_S = 0.13
"""Between two attitudes further apart nothing is known [s]."""
CLOSEST_S = 0.004
"""Poses that follow the last one faster tell nothing more [s]."""
LEAP_RAD = math.radians(1.5)
"""An autopilot's heading that goes so much farther than its gyros, from one message to the next, was reset."""
LEAST = 0.25 * LEAP_RAD
"""Sine of half an angle that is no leap."""
SILENT_S = 0.6
"""Nothing compared for so long: there is no second witness [s]."""

LASTS_S = 2.0
"""What they disagree for without a break is told to the operator: less may be an outlier [s]."""
REPEATS_S = 10.0
"""After so long without such a disagreement the next one is told again [s]."""

LEARN_S = 10.0
"""What is learnt before arming is that of so long [s]."""
TILT_UNIT_RAD, TILT_UNIT_MOST_RAD = math.radians(1.5), math.radians(3.0)
"""Their tilts scatter by so much at least, and believed is so much at most."""
TILT_UNITS = 2.0
"""The limit of the tilt, as a multiple of the scatter."""
TILT_TAU_S = 0.1
"""Over which the disagreement of the tilts is averaged [s]."""
NEAR_RAD = math.radians(0.75)
"""Tilts that are not farther apart agree as they come."""
LEAN_SHARE, LEAN_TAU_S = 0.3, 3.0
"""The share of the lean, that of now or its average over so long [s], by which an autopilot may be wrong."""
ASKEW_DEG = 8.0
"""The tilts of one body that stands are not farther apart [deg]."""
FOLLOW_RAD = math.radians(2.0)
"""In flight the tilts may drift apart by so much, slowly (the same ``LEARN_S``): vibrations shift an autopilot's."""

TURN_WINDOWS = ((0.15, 2, 4.0), (0.6, 6, 3.0))
"""Turning is compared over the last so long [s], from one instant to so many steps later, and stands out where its mean
square is about so many times that of the noise."""
COARSE = 2.0
"""Of an attitude that comes ten times a second the noise is so much more: what it did between is not known [-]."""
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
        self._seen, self._felt = _AttitudeTrack(), _AttitudeTrack()
        self._pose: Pose | None = None
        self._told: Attitude | None = None
        self._next = 0
        self._judged = -round(1e9)
        """The number of the instant that was compared last."""
        self._told_s = -math.inf
        """When a disagreement that is told of was still there [s]."""
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
        last, seen, time_s = self._pose, self._seen, pose.time_s
        if last is None or pose.reset_count != last.reset_count or time_s - last.time_s > GAP_S:
            seen.begin_at(time_s)
        elif time_s - last.time_s < CLOSEST_S:
            return
        elif time_s >= seen.due_s:
            seen.take(last.time_s, last.attitude, time_s, pose.attitude)
            if seen.end - LAG > self._next < self._felt.end:
                self._compare()
        self._pose = pose

    def attitude(self, told: Attitude) -> None:
        """Take what the vehicle tells; what is not newer than the last is ignored."""
        last, felt, time_s = self._told, self._felt, told.time_s
        since = math.inf if last is None else time_s - last.time_s
        if -SILENT_S < since <= 0.0:
            return
        if last is None or not 0.0 < since <= GAP_S or _leaps(last, told, since):  # or its clock is another one
            felt.begin_at(time_s)
        elif time_s >= felt.due_s:
            felt.take(last.time_s, last.attitude, time_s, told.attitude)
            if felt.end > self._next < self._seen.end - LAG:
                self._compare()
        self._told = told

    def verdict(self, now_s: float) -> Agreement | None:
        """What comes of it at ``now_s``; None where one of the two is silent."""
        if self._apart is None or now_s - self._judged * STEP_S > SILENT_S:
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

    def describe_news(self) -> str | None:
        """A line for the operator, where both have disagreed for ``LASTS_S``; once, as that begins."""
        since, judged_s = self._doubts_s, self._judged * STEP_S
        if since is None or judged_s - since < LASTS_S:
            return None
        known, self._told_s = judged_s - self._told_s < REPEATS_S, judged_s
        if known or self._apart is None:
            return None
        apart = math.degrees(math.hypot(*self._apart))
        differ = f"disagree by at least {apart:.0f} degrees of tilt" if self._tilting >= 1.0 else "turn differently"
        return (
            f"the vehicle's own attitude and the poses {differ}: land, and check that the tracked body is this "
            "vehicle, its axes and markers, and the autopilot's level (over CRSF link.attitude_pitch, too)"
        )

    def _compare(self) -> None:
        """Judge the instants that both have come to, and the poses ``LAG`` steps beyond: one at least."""
        seen, felt = self._seen, self._felt
        end = min(seen.end - LAG, felt.end)
        number = max(self._next, seen.begin + LAG + SPAN, felt.begin + SPAN)
        while number < end:
            steps = number - self._judged
            if steps * STEP_S > SILENT_S:
                self._begin()
            self._judge(number, min(steps, STRIDE))
            self._judged = number
            number += STRIDE if max(self._tilting, self._turning) < CALM else 1
        self._next = number

    def _judge(self, number: int, steps: int) -> None:
        """Hold both against each other at one instant, so many steps after the last. Written out: it runs in flight."""
        samples, felt = self._seen.samples, self._felt.samples
        at, then = number - self._seen.end, number - self._felt.end
        a, b, c, _ = felt[then]
        x, y, z, _ = samples[at]
        askew_x, askew_y = x - a, y - b
        if not self._armed:
            self._learn_askew((askew_x, askew_y), steps)
        ox, oy = self._offset
        a, b = a + ox, b + oy
        ex, ey, ez = x - a, y - b, z - c
        least = ex * ex + ey * ey + ez * ez
        if least > NEAR_RAD * NEAR_RAD:
            for lag in LAGS:
                x, y, z, _ = samples[at + lag]
                x, y, z = x - a, y - b, z - c
                squared = x * x + y * y + z * z
                if squared < least:
                    least, ex, ey, ez = squared, x, y, z
        if self._apart is not None:
            x, y, z = self._apart
            gain = _over(steps, STEP_S / TILT_TAU_S)
            ex, ey, ez = x + gain * (ex - x), y + gain * (ey - y), z + gain * (ez - z)
        self._apart = ex, ey, ez
        squared = ex * ex + ey * ey + ez * ez
        lean = math.hypot(a - ox, b - oy)
        self._lean += (lean - self._lean) * (steps * STEP_S / LEAN_TAU_S)
        unit = min(max(math.sqrt(self._scatter), TILT_UNIT_RAD), TILT_UNIT_MOST_RAD)
        self._tilting = math.sqrt(squared) / (TILT_UNITS * unit + LEAN_SHARE * max(lean, self._lean))
        noise = min(max(self._noise, TURN_NOISE_RAD**2), TURN_NOISE_MOST_RAD**2)
        fast, slow = self._turns
        fast.add(samples, at, felt, then, noise, steps)
        slow.add(samples, at, felt, then, noise, steps)
        coarse = self._told is None or self._told.rates_rad_s is None
        self._turning = slow.statistic(COARSE * noise) if coarse else max(fast.statistic(noise), slow.statistic(noise))
        agrees = self._tilting < 1.0 and self._turning < 1.0
        self._doubts_s = None if agrees else number * STEP_S if self._doubts_s is None else self._doubts_s
        if self._armed and agrees:
            self._offset = _within(
                _towards(self._offset, (askew_x, askew_y), steps * STEP_S / LEARN_S), self._askew, FOLLOW_RAD
            )
        elif not self._armed:
            self._note_moves(at, then, steps)
            if agrees:
                self._learn_scatter(squared, steps)

    def _learn_askew(self, askew: tuple[float, float], steps: int) -> None:
        """Take one instant into the mean of the last ``LEARN_S``, or of as long as there was."""
        self._learnt = min(self._learnt + steps, round(LEARN_S / STEP_S))
        self._askew = _towards(self._askew, askew, min(steps / self._learnt, 1.0))
        self._offset = _within(self._askew, (0.0, 0.0), math.radians(ASKEW_DEG))

    def _learn_scatter(self, squared: float, steps: int) -> None:
        """The same of the square of what tilts are apart beyond that [rad²], and of turns while it stands."""
        gain, fast = steps / self._learnt, self._turns[0]
        self._scatter += gain * (squared - self._scatter)
        if fast.felt < STANDS_RAD**2:
            self._noise += gain * (fast.newest - self._noise)

    def _note_moves(self, at: int, then: int, steps: int) -> None:
        """Which way both turned where the vehicle was moved."""
        span = TURN_WINDOWS[0][1]
        p, p0 = (self._seen.samples[at + self._turns[-1].lag - back] for back in (0, span))
        q, q0 = (self._felt.samples[then - back] for back in (0, span))
        keep = 1.0 - steps * STEP_S / MOVED_TAU_S
        for axis, (_, n) in enumerate(AXES):
            by_seen, by_felt = p[n] - p0[n], q[n] - q0[n]
            if abs(by_felt) > STANDS_RAD:
                d, s, f = self._moved[axis]
                self._moved[axis] = (
                    keep * d + (by_seen - by_felt) ** 2, keep * s + by_seen**2, keep * f + by_felt**2
                )  # fmt: skip


class _AttitudeTrack:
    """One witness's attitudes on the grid."""

    def __init__(self) -> None:
        self._last: Quat | None = None
        self._turned = 0.0
        self.end = 0
        """The number of the next instant."""
        self.due_s = math.inf
        """When that is [s]."""
        self.samples: deque[_Vector] = deque(maxlen=round(2.0 / STEP_S))
        """Those since the last gap; the instant ``number`` is at ``number - end``."""

    @property
    def begin(self) -> int:
        """The number of the first instant that is known since the last gap."""
        return self.end - len(self.samples)

    def begin_at(self, time_s: float) -> None:
        """What comes from ``time_s`` on does not go on from before [s]."""
        self.samples.clear()
        self._last = None
        self.end = math.floor(time_s / STEP_S) + 1
        self.due_s = self.end * STEP_S

    def take(self, last_s: float, last: Quat, time_s: float, attitude: Quat) -> None:
        """Go on to ``attitude`` at ``time_s`` [s] from the ``last``: not before the instant that is due."""
        a, b, c, d = last
        p, q, r, s = attitude
        if a * p + b * q + c * r + d * s < 0.0:
            p, q, r, s = -p, -q, -r, -s
        due_s, before, turned = self.due_s, self._last, self._turned
        while due_s <= time_s:
            share = (due_s - last_s) / (time_s - last_s)
            w, x, y, z = at = (a + share * (p - a), b + share * (q - b), c + share * (r - c), d + share * (s - d))
            k = 2.0 / (w * w + x * x + y * y + z * z)  # between two attitudes it is a little shorter
            if before is not None:  # the small turn about the vertical since then
                e, f, g, h = before
                half = k * (e * z - h * w + g * x - f * y)
                turned += half if e * w + f * x + g * y + h * z > 0.0 else -half
            self.samples.append((k * (x * z - w * y), k * (y * z + w * x), 1.0 - k * (x * x + y * y), turned))
            before = at
            self.end += 1
            due_s = self.end * STEP_S
        self.due_s, self._last, self._turned = due_s, before, turned


class _Turns:
    """How much of the turning of late is not common to both, at the lag where that is least."""

    def __init__(self, tau_s: float, span: int, noises: float) -> None:
        """Nothing has turned. See ``TURN_WINDOWS``."""
        self._gain = STEP_S / tau_s
        self._span = span
        self._noises = noises
        self._counts = (TURN_COUNTS_RAD_S * span * STEP_S) ** 2
        self._different = self._all = 0.0
        self._beyond: list[float] | None = None
        """How much more is different at each of :data:`LAGS`; None where it is not worth looking."""
        self.newest = 0.0
        """The square of the newest difference, at no lag [rad²]."""
        self.felt = 0.0
        """The square of the newest turn that was felt [rad²]."""

    @property
    def lag(self) -> int:
        """By how many steps the poses are late."""
        beyond = self._beyond
        return 0 if beyond is None or min(beyond) >= 0.0 else LAGS[beyond.index(min(beyond))]

    def add(self, seen: deque[_Vector], at: int, felt: deque[_Vector], then: int, noise: float, steps: int) -> None:
        """Take the turns that end at ``at`` and ``then``, where they began after the last gap."""
        span = self._span
        if then - span < -len(felt) or at - span - LAG < -len(seen):
            return
        a, b, c, d = felt[then]
        x, y, z, w = felt[then - span]
        a, b, c, d = a - x, b - y, c - z, d - w
        p, q, r, s = seen[at]
        x, y, z, w = seen[at - span]
        p, q, r, s = p - x, q - y, r - z, s - w
        self.felt = turned = a * a + b * b + c * c + d * d
        turned += p * p + q * q + r * r + s * s
        p, q, r, s = p - a, q - b, r - c, s - d
        self.newest = newest = p * p + q * q + r * r + s * s
        gain, beyond = _over(steps, self._gain), self._beyond
        keep, counts = 1.0 - gain, gain / (1.0 + turned / self._counts)
        self._all = keep * self._all + counts * turned
        self._different = keep * self._different + counts * newest
        if newest > noise:
            found = []
            for i, lag in enumerate(LAGS):
                p, q, r, s = seen[at + lag]
                x, y, z, w = seen[at + lag - span]
                p, q, r, s = p - x - a, q - y - b, r - z - c, s - w - d
                more = counts * (p * p + q * q + r * r + s * s - newest)
                found.append(more if beyond is None else keep * beyond[i] + more)
            self._beyond = found
        elif beyond is not None:
            self._beyond = [keep * more for more in beyond] if self._different > 0.1 * noise else None

    def statistic(self, noise: float) -> float:
        """As a share of its limit, where one that stands turns by ``noise``, squared [rad²]."""
        least = self._different if self._beyond is None else self._different + min(0.0, *self._beyond)
        return least / (TURN_SHARE * self._all + self._noises * noise)


def _over(steps: int, gain: float) -> float:
    """The gain of an average that moves on by so many steps at once."""
    return gain if steps == 1 else gain * (2.0 - gain)


def _leaps(last: Attitude, told: Attitude, since: float) -> bool:
    """Whether the heading went farther than the gyros turned, ``since`` [s] before; where nobody tells, it did not."""
    a, b, c, d = last.attitude
    w, x, y, z = told.attitude
    half = a * z - d * w + c * x - b * y
    if -LEAST < half < LEAST:  # nobody turns just against a leap
        return False
    turned = 2.0 * half if a * w + b * x + c * y + d * z > 0.0 else -2.0 * half
    if told.rates_rad_s is None or last.rates_rad_s is None:
        return False
    (p, q, r), (e, f, g) = told.rates_rad_s, last.rates_rad_s
    gx, gy, gz = third_row(told.attitude)
    by_gyros = 0.5 * since * ((p + e) * gx + (q + f) * gy + (r + g) * gz)
    return abs(turned - by_gyros) > LEAP_RAD


def _towards(what: tuple[float, float], there: tuple[float, float], share: float) -> tuple[float, float]:
    """``what``, moved by ``share`` of the way."""
    (x, y), (a, b) = what, there
    return x + share * (a - x), y + share * (b - y)


def _within(what: tuple[float, float], centre: tuple[float, float], radius: float) -> tuple[float, float]:
    """``what``, or the point nearest to it not farther than ``radius`` from ``centre``."""
    (x, y), (a, b) = what, centre
    far = math.hypot(x - a, y - b)
    return what if far <= radius else (a + (x - a) * radius / far, b + (y - b) * radius / far)


LEAST_S = 0.008
"""Less is left to the noise of clocks, and to autopilots that tell what their last loop had [s]."""
LOOKS = 100
"""Instants that are looked at, before anything is said."""
KEPT = 32
"""So many attitudes are kept until a pose of their instant comes."""


class PoseLatency:
    """One vehicle's. Times are on the event loop's clock [s]."""

    def __init__(self, memory_s: float = LATENCY_MEMORY_S) -> None:
        """Nothing heard; what is older than ``memory_s`` [s] counts less."""
        self._told: deque[Attitude] = deque(maxlen=KEPT)
        self._last: tuple[float, tuple[float, float]] | None = None
        self._at_s = -math.inf
        self._fit = LatencyFit(memory_s, LOOKS)
        self._said_s = 0.0

    def attitude(self, told: Attitude) -> None:
        """What the vehicle tells of itself; nothing where it tells no rates, as nobody tells either when that was."""
        if told.rates_rad_s is None:
            return
        if not self._told or told.time_s > self._told[-1].time_s:
            self._told.append(told)
        elif told.time_s < self._told[-1].time_s - GAP_S:  # its clock is another one
            self._told.clear()

    def pose(self, pose: Pose) -> None:
        """A pose has come: look at all that was told of the time since the one before."""
        time_s, (x, y, _) = pose.time_s, third_row(pose.attitude)
        last, self._last = self._last, (time_s, (x, y))
        told = self._told
        if last is None or not 0.0 < time_s - last[0] <= GAP_S:
            return
        since, (x0, y0) = last
        while told and told[0].time_s <= time_s:
            one = told.popleft()
            share = (one.time_s - since) / (time_s - since)
            if share > 0.0:
                self._look(one, x0 + share * (x - x0), y0 + share * (y - y0))

    def _look(self, told: Attitude, x: float, y: float) -> None:
        """At one instant, at which the poses have gravity along ``x`` and ``y`` of the body."""
        a, b, c = third_row(told.attitude)
        assert told.rates_rad_s is not None, "others are not kept"
        p, q, r = told.rates_rad_s
        now = (x - a, y - b, r * b - q * c, p * c - r * a)
        dt, self._at_s = told.time_s - self._at_s, told.time_s
        if dt > SLOW_S:
            self._fit.begin(now)
        else:
            self._fit.add(dt, 1.0, now)

    @property
    def estimate(self) -> tuple[float, float] | None:
        """How much later poses are than told, below 0 earlier, and one deviation of that [s]; None at first."""
        return self._fit.estimate

    @property
    def late_s(self) -> float | None:
        """The same [s]; None while that could be chance, or little."""
        return self._fit.late_s(LEAST_S)

    def describe_news(self, clock_off_s: Callable[[], float]) -> str | None:
        """A line for the operator, where there is something that was not told yet.

        ``clock_off_s`` tells by how much the vehicle's clock may be taken wrong [s]: half of a round trip.
        """
        late = self.late_s
        if late is None or abs(late - self._said_s) < AGAIN_S or abs(late) < LEAST_S + clock_off_s():
            return None
        self._said_s = late
        found = f"poses seem {describe_latency(late)} than told, by the vehicle's own attitude"
        return f"{found}: measure their latency"
