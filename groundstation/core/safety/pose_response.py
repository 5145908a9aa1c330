"""Pose response: how much of the commanded motion do the poses show? A regression with an instrument. Sans-IO.

Along each direction three signals go through the same high pass, which removes trims, steady wind and slow bias:

- u, the motion that was asked for by the excitation tones;
- v, the motion that the commands make beyond that: along the reference, and in answer to wind;
- e, what the poses show less what the commands make of the vehicle, u + v.

Over windows that end now, e is regressed on both, e = D_u u + D_v v + r. Wind moves the vehicle and the law follows, so
v depends on the wind; u does not, and with v regressed out, the wind is left in r and only widens the error of D_u. So
1 + D_u is the answer to what was asked: 1 for true poses, 0 for a pose that stands, -1 for a mirrored one.

1 + D_v is the answer to what the law does by itself. Under wind alone a true pose moves by -v/L, L
the loop's gain, whose phase lies between -90 and -270 degrees: Re(-1/L) >= 0, so 1 + D_v is never
negative. It is near 0 only where the law cancels the wind wholly, and that has a bound: the motion
that the strongest steady swing of wind would have made.

For the attitude the same is done with turns: rotors, gusts and a load turn a vehicle a little, too, and
the law answers that. docs/explanation/trust.md has the derivation.
"""

import math
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from operator import add, sub
from typing import NamedTuple

from groundstation.core.vehicle import new

PASS_RAD_S = 6.0
"""Corner of the high pass [rad/s]: below the tones (10 to 18), above the loop (4 to 6) in which wind is answered."""
BLOCK_S = 0.05
"""Time between two evaluations [s]."""
BLOCKS = (8, 12, 24, 48)
"""Windows of the regression in blocks, .4 to 2.4 s: an unstable image doubles in .2 s, tones over
noise need seconds."""
STANDARD_ERRORS = 5.0
"""Standard errors by which an answer must lie beyond its limit to be accused [-]: one in 3 million a look."""
LEAST_ANSWER = 0.5
"""Least answer to what was asked that is accepted [-]: scales and lags configured wrong by half."""
MOST_ANSWER = 1.5
"""Largest answer to what was asked that is accepted [-]; as above."""
MOST_CROSS_ANSWER = math.sin(math.radians(35.0))
"""Largest answer across the direction that was asked [-]: axes turned by 35 degrees."""
OWN_STANDARD_ERRORS = 4.0
"""The same of the answer to the law's own motion [-]: a mirrored pose doubles its speed within .1 s,
and true ones are a wide way from the limit (`alarms`)."""
LEAST_OWN_M = 0.003
"""Least RMS of the law's own motion that says anything [m]: below it gusts within the pass can mimic any
answer by chance (`alarms storm`)."""
CANCELLED_RAD = 0.0125
"""Turn that rotors and gusts would have made, high-passed, had the law not cancelled it [rad]: twice that
of ArduCopter's and PX4's own flights (`alarms --capture`)."""
LEAST_OWN_RAD = 0.03
"""Least RMS of the law's own turning that says anything [rad]."""
MOST_OWN_ERROR = 0.2
"""Largest standard error of that answer that says anything [-]."""
MOST_ERROR = 0.15
"""Largest standard error of an answer that says anything [-]."""
CANCELLED_M = 0.010
"""Way that the strongest swing of wind would have made, high-passed [m]: 2.5 m/s² once in 5 s, wholly cancelled."""
LEAST_OWN_ANSWER = -0.35
"""Least answer to the law's own motion that noise and wind explain in any case [-]: 0 in theory, less with a delay."""
LEAST_WAY_M = 0.0002
"""Residual that is granted at least, for positions [m]: a gust of .1 m/s² within the pass."""
LEAST_TURN_RAD = 0.0025
"""The same for attitudes [rad]: attitude noise of a tracker at 1 m."""
WAY_MEMORY_S = 0.1
"""Correlation time of the residual that wind leaves in positions, at the tones [s].

White acceleration through the pass leaves the power 16 a³ w² / (w² + a²)³ at w, as a share of the variance, a the
corner: .12 s at the slowest tone, .02 s at the fastest."""
OWN_WAY_MEMORY_S = 1.0 / PASS_RAD_S
"""Correlation time of that residual at the law's own motion [s]: the high pass lets it through."""
TURN_MEMORY_S = 0.1
"""Correlation time of the residual of attitudes [s]."""
MODEL_ERROR = 0.05
"""Share of the law's own motion by which the model may be wrong [-]: 10 ms of lag at the loop's 5 rad/s."""
NOISE_MEMORY_S = 0.02
"""Correlation time of the poses' own noise [s], at most."""
LATENESSES_S = (0.1, 0.2, 0.3, 0.4)
"""Latencies that are tried on the attitude [s]: half the first is a lag configured wrong; after the last,
flight.coast_s ends a flight by itself."""
LATE_MEMORY_S = 1.0
"""Time constant of that comparison [s]: ten independent samples."""
LATE_BETTER = 4.0
"""Ratio by which a latency must explain the turns better than none [-]: for true poses it is below .1, and 1 where the
latency is off by 50 ms."""

Pair = tuple[float, float]
Triple = tuple[float, float, float]


class HighPass:
    """(s / (s + w))^n of signals given by their increments; exact for signals that move steadily between samples."""

    def __init__(self, order: int, size: int) -> None:
        """``order`` stages for ``size`` signals."""
        self._stages = [[0.0] * size for _ in range(order)]

    def step(self, increments: list[float], dt_s: float) -> list[float]:
        """Return the filtered signals after ``increments`` within ``dt_s``."""
        keep = math.exp(-PASS_RAD_S * dt_s)
        gain = (1.0 - keep) / (PASS_RAD_S * dt_s)
        for stage in self._stages:
            for i, increment in enumerate(increments):
                now = keep * stage[i] + gain * increment
                increments[i], stage[i] = now - stage[i], now
        return self._stages[-1]


FEWEST_SAMPLES = 3.5
"""Independent samples below which a window says nothing [-]: two are spent on D_u and D_v."""
RIDGE = 1e-10
"""Excitation below which nothing was excited [m² s]."""


class Excitation(NamedTuple):
    """Integrals over one window of the products of u and v along one direction; uu and vv are ``RIDGE`` at least."""

    uu: float
    uv: float
    vv: float
    det: float
    """Determinant of the normal equations, uu vv - uv²."""


class Shown(NamedTuple):
    """Integrals over one window of the products of e: with u, with v and with itself."""

    eu: float
    ev: float
    ee: float


class Scatter:
    """Standard errors that a residual leaves over one window: what all directions have in common."""

    __slots__ = (
        "_freedom_s", "_least2", "_memory_s", "_noise2", "_prior", "_white", "_wider", "asked_least2", "time_s",
    )  # fmt: skip

    def __init__(self, time_s: float, memory_s: float, least: float, noise: float, own2: float = 0.0) -> None:
        """Take one window.

        Args:
            time_s: length of the window [s]: it holds about time_s / memory_s independent samples.
            memory_s: correlation time of the residual [s].
            least: residual that is granted at least.
            noise: white noise of e, 1 sigma.
            own2: integral of the square of the law's own motion along all directions, which the answer to it needs
                not: there the model's error is one of the answer.
        """
        # Few samples know little of their own scatter: 3 samples' worth of the granted residual as a prior, and a
        # wider interval, as Student's distribution has it.
        self._prior = 3.0 * memory_s * least * least + MODEL_ERROR * MODEL_ERROR * own2
        self._freedom_s = time_s - 2.0 * memory_s
        self._wider = 1.0 + 4.0 / (time_s / memory_s - 2.0)
        self._memory_s, self._noise2 = memory_s, noise * noise
        self._white = time_s * self._noise2
        self._least2 = self.error(0.0, 1.0) ** 2
        self.time_s = time_s
        """Length of the window [s]."""
        self.asked_least2 = 4.0 * least * least * time_s
        """Integral of the square of twice the granted residual."""

    def error(self, residual: float, det: float) -> float:
        """Standard error of D_u for an excitation vv of 1, and of D_v for uu."""
        beside_noise = (max(residual - self._white, 0.0) + self._prior) / self._freedom_s
        variance = beside_noise * self._memory_s + self._noise2 * NOISE_MEMORY_S
        return self._wider * math.sqrt(variance / det)

    def can_tell(self, excitation: float, most_error: float) -> bool:
        """Whether the standard error can be ``most_error`` or less, by the least residual that there is.

        It is least where u and v have nothing in common: det = uu vv.
        """
        return self._least2 <= most_error * most_error * excitation * ROUNDING

    def drowns(self, excited: Excitation) -> bool:
        """Whether the noise alone leaves a larger error than says anything."""
        uu, _, vv, det = excited
        return self._noise2 * NOISE_MEMORY_S * min(uu, vv) > MOST_ERROR * MOST_ERROR * det


ROUNDING = 1.0 + 1e-9
"""Factor on a bound that rounding may exceed it by [-]."""


def excess(answer: float, error: float, least: float, most: float) -> float:
    """How far an answer lies beyond its limits, in shares of ``STANDARD_ERRORS`` [-]; 0 where it says nothing."""
    if error > MOST_ERROR:
        return 0.0
    return max(least - answer, answer - most, 0.0) / (STANDARD_ERRORS * error)


class OwnMotion(NamedTuple):
    """Limits of the law's own motion, as wind and rotors ask for it."""

    cancelled: float
    """RMS that wind would have made, had the law not cancelled it [m or rad]."""
    least: float
    """RMS below which it says nothing [m or rad]."""
    memory_s: float
    """Correlation time of the residual at it [s]."""


OWN_WAY = OwnMotion(CANCELLED_M, LEAST_OWN_M, OWN_WAY_MEMORY_S)
OWN_TURN = OwnMotion(CANCELLED_RAD, LEAST_OWN_RAD, TURN_MEMORY_S)


def own_excess(answer: float, error: float, rms: float, limits: OwnMotion) -> float:
    """The same of the answer to the law's own motion of ``rms``: wind makes none below 0 but by noise."""
    if rms < limits.least or error > MOST_OWN_ERROR:
        return 0.0
    least = max(LEAST_ANSWER - limits.cancelled / rms, LEAST_OWN_ANSWER)
    return max(least - answer, 0.0) / (OWN_STANDARD_ERRORS * error)


def can_ask(uu: float, scatter: Scatter) -> bool:
    """Whether so much was asked that the answer can say anything: more than the residual that is granted."""
    return uu >= scatter.asked_least2 and scatter.can_tell(uu, MOST_ERROR)


def can_image(vv: float, scatter: Scatter, limits: OwnMotion) -> bool:
    """Whether the law's own motion is so large that the answer to it can say anything."""
    return vv * ROUNDING >= limits.least**2 * scatter.time_s and scatter.can_tell(vv, MOST_OWN_ERROR)


class Alarm(NamedTuple):
    """Largest excesses over all directions and windows, as shares of what convicts [-]."""

    asked: float
    """By answers to what was asked."""
    own: float
    """By answers to the law's own motion."""
    is_known: bool
    """Whether the newest answers are known well enough to say that the poses answer."""


NO_ALARM = Alarm(0.0, 0.0, False)
"""A window that says nothing."""


def combine(alarms: Iterable[Alarm]) -> Alarm:
    """Largest alarms of several windows; known where one of them is."""
    asked, own, known = zip(*alarms, strict=True)
    return Alarm(max(asked), max(own), any(known))


def judge_asked(excited: Excitation, shown: Shown, scatter: Scatter) -> tuple[float, bool]:
    """Excess of the answer along the direction that was asked [-], and whether that answer is known well enough."""
    (uu, uv, vv, det), (eu, ev, ee) = excited, shown
    asked, own = (eu * vv - ev * uv) / det, (ev * uu - eu * uv) / det
    error = scatter.error(ee - asked * eu - own * ev, det) * math.sqrt(vv)
    return excess(1.0 + asked, error, LEAST_ANSWER, MOST_ANSWER), error <= MOST_ERROR


def judge_across(excited: Excitation, shown: Shown, scatter: Scatter) -> float:
    """Excess of the answer across the direction that was asked [-]; ``shown`` is e across it."""
    (uu, uv, vv, det), (eu, ev, ee) = excited, shown
    asked = (eu * vv - ev * uv) / det
    if abs(asked) <= MOST_CROSS_ANSWER:
        return 0.0
    own = (ev * uu - eu * uv) / det
    error = scatter.error(ee - asked * eu - own * ev, det) * math.sqrt(vv)
    return excess(abs(asked), error, 0.0, MOST_CROSS_ANSWER)


def judge_own(excited: Excitation, shown: Shown, scatter: Scatter, limits: OwnMotion) -> float:
    """Excess of the answer to the law's own motion [-]."""
    (uu, uv, vv, det), (eu, ev, ee) = excited, shown
    own = (ev * uu - eu * uv) / det
    if 1.0 + own >= LEAST_ANSWER:
        return 0.0
    asked = (eu * vv - ev * uv) / det
    error = scatter.error(ee - asked * eu - own * ev, det) * math.sqrt(uu)
    return own_excess(1.0 + own, error, math.sqrt(vv / scatter.time_s), limits)


class Line(NamedTuple):
    """One direction in one window: its excitation, its standard errors, and the answers that can say anything."""

    excited: Excitation
    scatter: Scatter
    own_scatter: Scatter
    own_motion: OwnMotion
    asks: bool
    """Whether the answer to what was asked can."""
    images: bool
    """Whether the answer to the law's own motion can."""

    def judge(self, shown: Shown) -> Alarm:
        """Return the alarm of e along the direction."""
        excited, scatter, own_scatter, own_motion, asks, images = self
        asked, is_known = judge_asked(excited, shown, scatter) if asks else (0.0, False)
        own = judge_own(excited, shown, own_scatter, own_motion) if images and not is_known else 0.0
        return new(Alarm, (asked, own, is_known))


def open_line(
    uu: float, uv: float, vv: float, scatter: Scatter, own_scatter: Scatter, own_motion: OwnMotion
) -> Line | None:
    """Return the direction of an excitation; None where no answer along it says anything."""
    uu, vv = uu + RIDGE, vv + RIDGE
    asks, images = can_ask(uu, scatter), can_image(vv, own_scatter, own_motion)
    if not (asks or images):
        return None
    excited = new(Excitation, (uu, uv, vv, uu * vv - uv * uv))
    return None if scatter.drowns(excited) else new(Line, (excited, scatter, own_scatter, own_motion, asks, images))


class _Windows:
    """Running integrals, their values at the ends of the past blocks, and the newest alarm of each window.

    The last integral is the time. Longer windows are looked at less often.
    """

    def __init__(self, count: int, least_s: float) -> None:
        """``count`` integrals; windows shorter than ``least_s`` say nothing."""
        self._least_s = least_s
        self._now = [0.0] * count
        self._kept: deque[list[float]] = deque([self._now], maxlen=BLOCKS[-1] + 1)
        self._alarms = [NO_ALARM] * len(BLOCKS)
        self._count = 0

    def add(self, products: Sequence[float]) -> None:
        """Add one sample's ``products`` to the integrals."""
        self._now = list(map(add, self._now, products))

    def look(self, judge_window: Callable[[list[float]], Alarm]) -> Alarm:
        """Close a block; return the largest alarms of all windows, those that end now judged by ``judge_window``."""
        self._kept.append(self._now)
        self._count += 1
        for i, blocks in enumerate(BLOCKS):
            if blocks < len(self._kept) and self._count % (blocks // BLOCKS[0]) == 0:
                begun = self._kept[-blocks - 1]
                is_long = self._now[-1] - begun[-1] >= self._least_s
                self._alarms[i] = judge_window(list(map(sub, self._now, begun))) if is_long else NO_ALARM
        return combine(self._alarms)


class LineResponse:
    """Response along one line: the height."""

    def __init__(self, memory_s: float, least: float) -> None:
        """Begin without a sample; for the arguments see :class:`Scatter`."""
        self._memory, self._least = memory_s, least
        self._windows = _Windows(7, FEWEST_SAMPLES * OWN_WAY.memory_s)

    def add(self, e: float, u: float, v: float, dt_s: float) -> None:
        """Take one sample of the filtered signals."""
        x, y = u * dt_s, v * dt_s
        self._windows.add((u * x, u * y, v * y, e * x, e * y, e * e * dt_s, dt_s))

    def look(self, noise: float) -> Alarm:
        """Alarm at the end of a block; ``noise`` is the white noise of e, 1 sigma [m]."""
        return self._windows.look(lambda sums: self._look_along(sums, noise))

    def _look_along(self, sums: list[float], noise: float) -> Alarm:
        """Alarm of one window."""
        uu, uv, vv, eu, ev, ee, time_s = sums
        scatter = Scatter(time_s, self._memory, self._least, noise, vv)
        own_scatter = Scatter(time_s, OWN_WAY.memory_s, self._least, noise)
        line = open_line(uu, uv, vv, scatter, own_scatter, OWN_WAY)
        return NO_ALARM if line is None else line.judge(new(Shown, (eu, ev, ee)))


class LatenessMonitor:
    """Compares the turns as seen with the model's of some time ago: do they come late, whatever their stamps say?"""

    def __init__(self) -> None:
        self._times = list[float]()
        self._models = list[Pair]()
        self._off = [0.0] * (1 + len(LATENESSES_S))
        self._time_s = 0.0

    def add(self, time_s: float, seen: Pair, model: Pair, dt_s: float) -> None:
        """Take one sample of the filtered turns, roll and pitch of each [rad]."""
        times, models, off, (x, y) = self._times, self._models, self._off, seen
        times.append(time_s)
        models.append(model)
        oldest = bisect_left(times, time_s - LATENESSES_S[-1] - dt_s)
        del times[:oldest], models[:oldest]
        keep = math.exp(-dt_s / LATE_MEMORY_S)
        self._time_s += dt_s
        for i, late_s in enumerate((0.0, *LATENESSES_S)):
            u, v = models[max(bisect_right(times, time_s - late_s + 0.5 * dt_s) - 1, 0)]
            off[i] = keep * off[i] + dt_s * ((x - u) ** 2 + (y - v) ** 2)

    @property
    def late_s(self) -> float:
        """Latency that explains the turns [s]; 0 where none does better than none."""
        now, *later = self._off
        noise = 2.0 * LEAST_TURN_RAD**2 * min(self._time_s, LATE_MEMORY_S)
        if self._time_s < LATE_MEMORY_S or now < LATE_BETTER * (min(later) + noise):
            return 0.0
        return LATENESSES_S[later.index(min(later))]


DIAGONAL = math.sqrt(0.5)
DIRECTIONS: tuple[Pair, ...] = ((1.0, 0.0), (DIAGONAL, DIAGONAL), (0.0, 1.0), (-DIAGONAL, DIAGONAL))
"""Directions of a plane that are looked at: no direction is farther than 22.5 degrees from one of them."""


def most_along(xx: float, xy: float, yy: float) -> float:
    """Largest excitation along any direction: the larger eigenvalue of a symmetric matrix, with ``RIDGE``."""
    return 0.5 * (xx + yy + math.hypot(xx - yy, 2.0 * xy)) + RIDGE


class PlaneResponse:
    """Response along every direction of a plane, and across it: roll and pitch, or north and east."""

    def __init__(self, memory_s: float, least: float, own_motion: OwnMotion) -> None:
        """Begin without a sample; ``own_motion``: limits of v. See :class:`Scatter`."""
        self._memory, self._least, self._own_motion = memory_s, least, own_motion
        self._windows = _Windows(22, FEWEST_SAMPLES * own_motion.memory_s)

    def add(self, e: Pair, u: Pair, v: Pair, dt_s: float) -> None:
        """Take one sample of the filtered signals, x and y of each."""
        (ex, ey), (ux, uy), (vx, vy) = e, u, v
        p, q, r, s, a, b = ux * dt_s, uy * dt_s, vx * dt_s, vy * dt_s, ex * dt_s, ey * dt_s
        products = (
            ux * p, ux * q, uy * q, ux * r, ux * s, uy * r, uy * s, vx * r, vx * s, vy * s,
            ex * p, ex * q, ey * p, ey * q, ex * r, ex * s, ey * r, ey * s, ex * a, ex * b, ey * b, dt_s,
        )  # fmt: skip
        self._windows.add(products)

    def look(self, noise: float) -> Alarm:
        """Alarm at the end of a block; ``noise`` is the white noise of e, 1 sigma per axis."""
        return self._windows.look(lambda sums: self._look_around(sums, noise))

    def _look_around(self, sums: list[float], noise: float) -> Alarm:
        """Largest alarms of all directions in one window; known where all of them are."""
        uxx, uxy, uyy, _, _, _, _, vxx, vxy, vyy, *_, time_s = sums
        scatter = Scatter(time_s, self._memory, self._least, noise, vxx + vyy)
        own_scatter = Scatter(time_s, self._own_motion.memory_s, self._least, noise)
        asks = can_ask(most_along(uxx, uxy, uyy), scatter)
        if not (asks or can_image(most_along(vxx, vxy, vyy), own_scatter, self._own_motion)):
            return NO_ALARM
        alarms = [self._look_along(one, sums, scatter, own_scatter) for one in DIRECTIONS]
        asked, own, known = zip(*alarms, strict=True)
        return new(Alarm, (max(asked), max(own), all(known)))

    def _look_along(self, direction: Pair, sums: list[float], scatter: Scatter, own_scatter: Scatter) -> Alarm:
        """Alarm of one direction: of e along it, and of e across it, both by u and v along it."""
        a, b = direction
        (
            uxx, uxy, uyy, uvxx, uvxy, uvyx, uvyy, vxx, vxy, vyy,
            exux, exuy, eyux, eyuy, exvx, exvy, eyvx, eyvy, exx, exy, eyy, _,
        ) = sums  # fmt: skip
        aa, ab, bb = a * a, a * b, b * b
        uu = aa * uxx + 2.0 * ab * uxy + bb * uyy
        vv = aa * vxx + 2.0 * ab * vxy + bb * vyy
        uv = aa * uvxx + ab * (uvxy + uvyx) + bb * uvyy
        line = open_line(uu, uv, vv, scatter, own_scatter, self._own_motion)
        if line is None:
            return NO_ALARM
        exu, eyu, exv, eyv = a * exux + b * exuy, a * eyux + b * eyuy, a * exvx + b * exvy, a * eyvx + b * eyvy
        along = new(Shown, (a * exu + b * eyu, a * exv + b * eyv, aa * exx + 2.0 * ab * exy + bb * eyy))
        alarm = line.judge(along)
        if not line.asks:
            return alarm
        across = new(Shown, (a * eyu - b * exu, a * eyv - b * exv, aa * eyy - 2.0 * ab * exy + bb * exx))
        return alarm._replace(asked=max(alarm.asked, judge_across(line.excited, across, scatter)))
