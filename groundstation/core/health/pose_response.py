"""Pose response: how much of the commanded motion do the poses show?

A regression with an instrument. Sans-IO.

Along each direction three signals go through the same high pass, which removes trims, steady wind
and slow bias:

- u, the motion commanded by the excitation tones;
- v, the motion commanded beyond that: along the reference, and against wind;
- e, the measured motion less the commanded one, u + v.

Over windows that end now, e is regressed on both, e = D_u u + D_v v + r. Wind moves the vehicle and
the law follows, so v depends on the wind; u does not, and with v regressed out, the wind is left in
r and only widens the error of D_u. So 1 + D_u is the response to the tones: 1 for true poses, 0 for
a frozen one, -1 for a mirrored one. By chance v may look like u for a while; then D_v v counts for
u. The instrument alone, D_u = (u e) / (u c), knows nothing of v: a response is evidence only if
both agree.

1 + D_v is the response to the law's own motion. Under wind alone a true pose moves by -v/L, L the
loop's gain, whose phase is between -90 and -270 degrees: Re(-1/L) >= 0, so 1 + D_v is never
negative. It is near 0 only where the law cancels the wind wholly, and that has a bound: the motion
that the strongest steady swing of wind would have made.

For the attitude the same is done with turns: rotors, gusts and a load turn a vehicle a little, too,
and the law reacts to that. docs/explanation/trust.md has the derivation.
"""

import math
import operator
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from groundstation.core.estimation import HIGHLY_SIGNIFICANT, SIGNIFICANT
from groundstation.core.messages import ROUNDING_S

POSE_GAP_S = 0.26
"""Interval of poses after which comparisons with the model begin anew [s]: ``flight.coast_s``,
after which the model is not believed."""
PASS_RAD_S = 6.0
"""Corner of the high pass [rad/s]: below the tones (10 to 18), above the loop (4 to 6) that rejects
wind."""
BLOCK_S = 0.05
"""Time between two evaluations [s]."""
BLOCKS = (8, 12, 24, 48)
"""Windows of the regression in blocks, .4 to 2.4 s: an unstable image doubles in .2 s, tones over
noise need seconds."""
LEAST_RESPONSE = 0.5
"""Least response to the tones that is accepted [-]: scales and lags configured wrong by half."""
CONFIRMING_ERRORS = 2.0
"""Standard errors by which a response must exceed the least one to confirm the poses [-]: one in
40."""
MOST_CROSS_RESPONSE = math.sin(math.radians(35.0))
"""Largest response across the direction of the tones [-]: axes turned by 35 degrees."""
LEAST_OWN_M = 0.003
"""Least RMS of the law's own motion that is evaluated [m]: below it gusts within the pass can mimic
any response by chance (`alarms storm`)."""
CANCELLED_RAD = 0.0125
"""Turn that rotors and gusts would have made, high-passed, had the law not cancelled it [rad]:
twice that of ArduCopter's and PX4's own flights (those of tests/golden)."""
LEAST_OWN_RAD = 0.03
"""Least RMS of the law's own turning that is evaluated [rad]."""
MOST_OWN_ERROR = 0.2
"""Largest standard error of the response to the law's own motion that is evaluated [-]."""
MOST_ERROR = 0.15
"""Largest standard error of the response to the tones that is evaluated [-]."""
CANCELLED_M = 0.010
"""Motion that the strongest swing of wind would have made, high-passed [m]: 2.5 m/s² once in 5 s,
wholly cancelled."""
LEAST_OWN_RESPONSE = -0.35
"""Least response to the law's own motion that noise and wind explain in any case [-]: in theory 0,
less with delay."""
LEAST_DISPLACEMENT_M = 0.0002
"""Least residual that is assumed for positions [m]: a gust of .1 m/s² within the pass."""
LEAST_TURN_RAD = 0.0025
"""Least residual that is assumed for attitudes [rad]: attitude noise of a tracker at 1 m."""
TONE_MEMORY_S = 0.1
"""Correlation time of the residual at the tones, of positions and of attitudes [s].

White acceleration through the pass leaves the power 16 a³ w² / (w² + a²)³ at w, as a share of the
variance, a the corner: .12 s at the slowest tone, .02 s at the fastest."""
OWN_LATERAL_MEMORY_S = 1.0 / PASS_RAD_S
"""Correlation time of the residual of positions at the law's own motion [s]: the high pass lets it
through."""
MODEL_ERROR = 0.025
"""Share of the law's own motion by which the model may be wrong [-]: half an interval of poses at
100 Hz, 5 ms of lag at the loop's 5 rad/s."""
NOISE_MEMORY_S = 0.02
"""Longest correlation time of the poses' own noise [s]."""
LATENESSES_S = tuple(0.1 * n for n in range(1, 5))
"""Latencies that are tried on the attitude [s]: half the first is a lag configured wrong; after the
last, flight.coast_s ends a flight by itself."""
LATE_MEMORY_S = 1.0
"""Time constant of that comparison [s]: ten independent samples."""
LATE_BETTER = 4.0
"""Ratio by which a latency must explain the turns better than none [-]: for true poses it is below
.1, and 1 where the latency is off by 50 ms."""

Pair = tuple[float, float]


class HighPass:
    """(s / (s + w))^n of signals given by their increments.

    Exact for signals that move steadily between samples.
    """

    def __init__(self, order: int) -> None:
        """Begin at 0 with ``order`` stages, for as many signals as the first step has."""
        self._order = order
        self._stages: list[list[float]] = []

    def step(self, increments: list[float], dt_s: float) -> list[float]:
        """Return the filtered signals after ``increments`` within ``dt_s``."""
        self._stages = self._stages or [[0.0] * len(increments) for _ in range(self._order)]
        keep = math.exp(-PASS_RAD_S * dt_s)
        gain = (1.0 - keep) / (PASS_RAD_S * dt_s)
        for stage in self._stages:
            for i, increment in enumerate(increments):
                now = keep * stage[i] + gain * increment
                increments[i], stage[i] = now - stage[i], now
        return self._stages[-1]


FEWEST_SAMPLES = 3.5
"""Independent samples below which a window is not evaluated [-]: two are spent on the two
responses."""
PRIOR_SAMPLES = 3.0
"""Samples that the assumed residual counts for [-]: as many as the shortest window has."""
TONES_LEAST = 2.0
"""Least RMS of the tones that is evaluated, as a multiple of the assumed residual [-]."""
STEADY_TONE = 1.5
"""Mean square of the power of a steady tone over the square of its mean [-]: that of sin²."""
RIDGE = 1e-10
"""Excitation below which nothing was excited [m² s or rad² s]. It is added to the squares of both
signals, so that the matrix of their products has an inverse."""
DIAGONAL = math.sqrt(0.5)


class OwnMotion(NamedTuple):
    """Limits of the law's own motion, which wind and rotors cause."""

    cancelled: float
    """RMS that wind would have made, had the law not cancelled it [m or rad]."""
    least: float
    """RMS below which it is not evaluated [m or rad]."""
    memory_s: float
    """Correlation time of the residual at it [s]."""
    burst_s: float = math.inf
    """Time that a burst of it counts for at least [s]; infinite: every window counts for its
    length."""


BURST_S = BLOCKS[2] * BLOCK_S
"""Least time that a burst of the law's own lateral motion counts for [s]: the tilt reacts to a step
of the wind .15 s late, and a calm before must not make that short time certain; thrust and rates
react at once."""
OWN_HEIGHT = OwnMotion(CANCELLED_M, LEAST_OWN_M, OWN_LATERAL_MEMORY_S)
OWN_LATERAL = OWN_HEIGHT._replace(burst_s=BURST_S)
OWN_TURN = OwnMotion(CANCELLED_RAD, LEAST_OWN_RAD, TONE_MEMORY_S)


class Alarm(NamedTuple):
    """Largest excesses over all directions and windows, as shares of what fails the poses [-]."""

    tones: float
    """Excess of the responses to the tones."""
    own: float
    """Excess of the responses to the law's own motion."""
    is_known: bool
    """Whether the newest responses are known well enough to confirm that the poses respond."""


SUSPECT_ALARM = 0.5
"""Alarm from which the compared motions are suspect, and below which they are alike [-]: half the
standard errors that fail the poses."""
NO_ALARM = Alarm(0.0, 0.0, False)
"""Result without evidence."""


LINE = ((1.0, 0.0),)
"""Direction of a signal with one axis; its second component is 0."""
PLANE = ((1.0, 0.0), (DIAGONAL, DIAGONAL), (0.0, 1.0), (-DIAGONAL, DIAGONAL))
"""Directions of a plane that are evaluated: no direction is farther than 22.5 degrees from one of
them. Every other one is an axis."""


class Products(NamedTuple):
    """Integrals of products of the signals u, v, e along one direction, and x, which is e across it
    [m² s or rad² s].
    """

    uu: float = 0.0
    uv: float = 0.0
    vv: float = 0.0
    ue: float = 0.0
    ve: float = 0.0
    ee: float = 0.0
    ux: float = 0.0
    vx: float = 0.0
    xx: float = 0.0
    v4: float = 0.0
    """Fourth power of v, by means over blocks [m⁴ s or rad⁴ s]."""

    def add(self, block: "Products") -> "Products":
        """Return the integrals until the end of ``block``."""
        return Products(*map(operator.add, self, block))

    def since(self, then: "Products") -> "Products":
        """Return the integrals over the time since ``then``."""
        return Products(*map(operator.sub, self, then))


class SignalSample(NamedTuple):
    """Filtered signals of one pose, one value an axis."""

    dt_s: float
    """Time since the pose before [s]."""
    u: Pair
    v: Pair
    e: Pair
    """Commanded by the tones, commanded beyond that, and measured beyond both [m or rad]."""


def integrate_products(
    samples: Iterable[SignalSample], direction: Pair, block_s: float
) -> Products:
    """Return the integrals over ``samples`` of one block of ``block_s`` [s]."""
    a, b = direction
    uu = uv = vv = ue = ve = ee = ux = vx = xx = 0.0
    for dt_s, (u_x, u_y), (v_x, v_y), (e_x, e_y) in samples:
        u, v, e, x = a * u_x + b * u_y, a * v_x + b * v_y, a * e_x + b * e_y, a * e_y - b * e_x
        uu, uv, vv = uu + dt_s * u * u, uv + dt_s * u * v, vv + dt_s * v * v
        ue, ve, ee = ue + dt_s * u * e, ve + dt_s * v * e, ee + dt_s * e * e
        ux, vx, xx = ux + dt_s * u * x, vx + dt_s * v * x, xx + dt_s * x * x
    return Products(uu, uv, vv, ue, ve, ee, ux, vx, xx, vv * vv / block_s)


class Integrals(NamedTuple):
    """Integrals of the signals from the beginning until one instant."""

    time_s: float
    u2: float
    """Square of the tones along all axes [m² s or rad² s]."""
    v2: float
    """Square of the law's own motion along all axes [m² s or rad² s]."""
    u4: float
    """Fourth power of the tones, by means over blocks [m⁴ s or rad⁴ s]."""
    along: tuple[Products, ...]
    """One of each direction."""


class Regression(NamedTuple):
    """Regression of e, and of e across, on u and v along one direction."""

    along_u: float
    """D_u of e [-]."""
    along_v: float
    """D_v of e [-]."""
    across_u: float
    """D_u of e across [-]."""
    residual: float
    """Integral of the square of what is left of e [m² s or rad² s]."""
    residual_across: float
    """Integral of the square of what is left of e across [m² s or rad² s]."""
    variance_u: float
    """Variance of D_u over the density of the residual [1 / (m² s) or 1 / (rad² s)]."""
    variance_v: float
    """Variance of D_v over that density."""


def regress(products: Products) -> Regression:
    """Regress e and e across on u and v."""
    uv, ue, ve, ux, vx = products.uv, products.ue, products.ve, products.ux, products.vx
    uu, vv = products.uu + RIDGE, products.vv + RIDGE
    determinant = uu * vv - uv * uv
    along_u, along_v = (vv * ue - uv * ve) / determinant, (uu * ve - uv * ue) / determinant
    across_u, across_v = (vv * ux - uv * vx) / determinant, (uu * vx - uv * ux) / determinant
    return Regression(
        along_u,
        along_v,
        across_u,
        products.ee - along_u * ue - along_v * ve,
        products.xx - across_u * ux - across_v * vx,
        vv / determinant,
        uu / determinant,
    )


class Response:
    """Response along and across every direction of a line or a plane: height, roll and pitch, north
    and east.
    """

    def __init__(
        self, directions: tuple[Pair, ...], memory_s: float, least: float, own_motion: OwnMotion
    ) -> None:
        """Begin without a sample.

        Args:
            directions: ``LINE`` or ``PLANE``.
            memory_s: correlation time of the residual at the tones [s].
            least: least residual that is assumed [m or rad].
            own_motion: limits of v.
        """
        self._directions, self._own = directions, own_motion
        self._memory_s, self._least = memory_s, least
        self._samples = list[SignalSample]()
        """Samples since the last look."""
        self._time_s = 0.0
        self._kept = deque(
            [Integrals(0.0, 0.0, 0.0, 0.0, tuple(Products() for _ in directions))],
            maxlen=BLOCKS[-1] + 1,
        )
        """Integrals until the end of each of the last blocks."""

    def add(self, e: Pair, u: Pair, v: Pair, dt_s: float) -> None:
        """Take one sample of the filtered signals, one value an axis."""
        self._samples.append(SignalSample(dt_s, u, v, e))
        self._time_s += dt_s

    def look(self, noise: float) -> Alarm:
        """Close a block; return the largest alarms of all windows that end now.

        Known where one of them is.

        ``noise`` is the white noise of e, 1 sigma per axis.
        """
        begun = [self._kept[-blocks] for blocks in BLOCKS if blocks <= len(self._kept)]
        self._close_block()
        alarms = [self._judge(then, noise) for then in begun if self._has_moved(then)]
        if not alarms:
            return NO_ALARM
        tones, owns, known = zip(*alarms, strict=True)
        return Alarm(max(tones), max(owns), any(known))

    def _close_block(self) -> None:
        """Add the samples since the last look to the integrals."""
        last, samples = self._kept[-1], self._samples
        if not samples:
            self._kept.append(last._replace(time_s=self._time_s))
            return
        block_s = self._time_s - last.time_s
        block = [integrate_products(samples, each, block_s) for each in self._directions]
        # Every other direction is an axis.
        u2, v2 = sum(axis.uu for axis in block[::2]), sum(axis.vv for axis in block[::2])
        along = tuple(before.add(each) for before, each in zip(last.along, block, strict=True))
        self._kept.append(
            Integrals(self._time_s, last.u2 + u2, last.v2 + v2, last.u4 + u2 * u2 / block_s, along)
        )
        self._samples = []

    def _has_moved(self, then: Integrals) -> bool:
        """Whether the window since ``then`` is long enough, and the motion in it large enough, to
        be evaluated.
        """
        now, own = self._kept[-1], self._own
        time_s = now.time_s - then.time_s
        if time_s < FEWEST_SAMPLES * own.memory_s - ROUNDING_S:
            return False
        least = TONES_LEAST * self._least
        is_excited = now.u2 - then.u2 >= least * least * time_s
        return is_excited or now.v2 - then.v2 >= own.least * own.least * time_s

    def _judge(self, then: Integrals, noise: float) -> Alarm:
        """Return the largest alarms of all directions in the window since ``then``; known where all
        of them are.
        """
        now, own = self._kept[-1], self._own
        time_s, own2 = now.time_s - then.time_s, (now.v2 - then.v2) / (now.time_s - then.time_s)
        # Tones at one end of a window are few samples. Of a steady tone all its time counts.
        burst_s = STEADY_TONE * _burst_s(now.u2 - then.u2, now.u4 - then.u4)
        sounded_s = min(max(burst_s, FEWEST_SAMPLES * self._memory_s), time_s)
        tones, owns, is_known = 0.0, 0.0, True
        for until, before in zip(now.along, then.along, strict=True):
            products = until.since(before)
            found = regress(products)
            excess, knows = self._judge_tones(products, found, sounded_s, noise, own2)
            tones, is_known = max(tones, excess), is_known and knows
            # A gust at the end of a calm window is few samples.
            moved_s = min(max(_burst_s(products.vv, products.v4), own.burst_s), time_s)
            owns = max(owns, self._judge_own(products, found, time_s, moved_s, noise))
        return Alarm(tones, owns, is_known)

    def _judge_tones(
        self, products: Products, found: Regression, sounded_s: float, noise: float, own2: float
    ) -> tuple[float, bool]:
        """Return the excess of the response to the tones along one direction [-], and whether the
        poses are known to respond.

        ``sounded_s``: time for which the tones were there [s]; ``own2``: mean square of the law's
        own motion [m² or rad²].
        """
        commanded = products.uu + products.uv
        least2 = (TONES_LEAST * self._least) ** 2
        # Where none is commanded, v has undone the tones.
        if products.uu < least2 * sounded_s or commanded <= 0.0:
            return 0.0, False
        # Where less than half of the tones' motion is measured at all, no error of the model of v
        # is the cause: it would be measured, too.
        crossed = products.uv + products.ue + products.ve
        measured2 = products.uu + products.vv + products.ee + 2.0 * crossed
        moves = measured2 >= LEAST_RESPONSE * LEAST_RESPONSE * products.uu
        model2 = MODEL_ERROR * MODEL_ERROR * own2 if moves else 0.0
        along, across = (
            self._error(residual, found.variance_u, sounded_s, self._memory_s, noise, model2)
            for residual in (found.residual, found.residual_across)
        )
        beyond = min(abs(found.along_u), abs(products.ue) / commanded) - (1.0 - LEAST_RESPONSE)
        crossed = min(abs(found.across_u), abs(products.ux) / commanded) - MOST_CROSS_RESPONSE
        excess = max(
            beyond / along if along <= MOST_ERROR else 0.0,
            crossed / across if across <= MOST_ERROR else 0.0,
            0.0,
        )
        return excess / HIGHLY_SIGNIFICANT, along <= MOST_ERROR and beyond <= 0.0

    def _judge_own(
        self, products: Products, found: Regression, time_s: float, moved_s: float, noise: float
    ) -> float:
        """Return the excess of the response to the law's own motion along one direction [-].

        Wind makes no response below 0, except by noise. Poses that respond to the tones are neither
        frozen nor mirrored: something else cancels the motion.
        """
        own = self._own
        rms = math.sqrt(max(products.vv, RIDGE) / time_s)
        least = max(LEAST_RESPONSE - own.cancelled / rms, LEAST_OWN_RESPONSE)
        below = least - 1.0 - found.along_v
        if rms < own.least or below <= 0.0:
            return 0.0
        error = self._error(found.residual, found.variance_v, moved_s, own.memory_s, noise)
        tone_error = self._error(found.residual, found.variance_u, time_s, self._memory_s, noise)
        responds = 1.0 + found.along_u >= LEAST_RESPONSE + CONFIRMING_ERRORS * tone_error
        return 0.0 if responds or error > MOST_OWN_ERROR else below / (SIGNIFICANT * error)

    def _error(
        self,
        residual: float,
        variance: float,
        time_s: float,
        memory_s: float,
        noise: float,
        model2: float = 0.0,
    ) -> float:
        """Return the standard error of a response [-].

        Args:
            residual: integral of the square of what the regression leaves [m² s or rad² s].
            variance: variance of the response over the density of that residual.
            time_s: time for which the signal was there [s].
            memory_s: correlation time of the residual [s].
            noise: white noise of e, 1 sigma per axis [m or rad].
            model2: mean square by which the model of the other signal is wrong [m² or rad²].
        """
        # Few samples know little of their own scatter: the assumed residual is a prior worth some
        # samples, and the interval is wider, as by Student's distribution.
        noise2 = noise * noise
        prior = PRIOR_SAMPLES * memory_s * self._least * self._least + time_s * model2
        freedom = time_s / memory_s - 2.0
        beside_noise = (max(residual - time_s * noise2, 0.0) + prior) / freedom
        return (1.0 + 4.0 / freedom) * math.sqrt(
            (beside_noise + noise2 * NOISE_MEMORY_S) * variance
        )


def _burst_s(power: float, power2: float) -> float:
    """Return the time for which a signal x is there [s]: (∫x²)²/∫x⁴.

    ``power`` is ∫x², ``power2`` ∫x⁴ by means over blocks.
    """
    return power * power / max(power2, RIDGE * RIDGE)


class LatenessMonitor:
    """Latency of the measured turns behind the model's, whatever the stamps of the poses are."""

    def __init__(self) -> None:
        self._times = list[float]()
        self._models = list[Pair]()
        self._off = [0.0] * (1 + len(LATENESSES_S))
        self._time_s = 0.0

    def add(self, time_s: float, measured: Pair, model: Pair, dt_s: float) -> None:
        """Take one sample of the filtered turns, roll and pitch of each [rad]."""
        times, models, off, (x, y) = self._times, self._models, self._off, measured
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
