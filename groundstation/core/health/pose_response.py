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
from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

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
Array = NDArray[np.float64]


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
"""Excitation below which nothing was excited [m² s or rad² s]."""
RIDGES = RIDGE * np.eye(2)
"""Excitation that is added to both signals' products, so that these have an inverse [m² s or rad²
s]."""
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


SIGNALS = ("u", "v", "e")
"""Signals of each axis, in the order of the matrices."""


def _directions(*along: Sequence[float]) -> Array:
    """Make the matrices from u, v and e of all axes to those along one direction, and to e across
    it in the last row.

    Shape (directions, signals + 1, signals x axes).
    """
    axes = len(along[0])
    matrices = np.zeros((len(along), len(SIGNALS) + 1, len(SIGNALS) * axes))
    for matrix, direction in zip(matrices, along, strict=True):
        for signal in range(len(SIGNALS)):
            matrix[signal, signal * axes : (signal + 1) * axes] = direction
        if axes == 2:
            matrix[-1, -axes:] = -direction[1], direction[0]
    return matrices


LINE = _directions((1.0,))
PLANE = _directions((1.0, 0.0), (DIAGONAL, DIAGONAL), (0.0, 1.0), (-DIAGONAL, DIAGONAL))
"""Directions of a plane that are evaluated: no direction is farther than 22.5 degrees from one of
them."""


LIMITS = np.array([1.0 - LEAST_RESPONSE, MOST_CROSS_RESPONSE])
"""Limits of |D_u|, along and across [-]: a response, 1 + D_u along, may be as much too large as too
small."""
ADJUGATE = np.array([[1.0, -1.0], [-1.0, 1.0]])
"""Signs of the adjugate of a symmetric matrix of two rows, which is that matrix with both its axes
turned around."""


class Response:
    """Response along and across every direction of a line or a plane: height, roll and pitch, north
    and east.
    """

    def __init__(
        self, directions: Array, memory_s: float, least: float, own_motion: OwnMotion
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
        self._samples: list[tuple[float, ...]] = []
        """Samples since the last look: interval [s], then the filtered signals."""
        count, rows, _ = directions.shape
        self._time_s = 0.0
        self._kept = deque(
            [_Integrals(0.0, np.zeros((count, rows, rows)), np.zeros(count), 0.0)],
            maxlen=BLOCKS[-1] + 1,
        )
        """Integrals until the end of each of the last blocks."""

    def add(self, e: Sequence[float], u: Sequence[float], v: Sequence[float], dt_s: float) -> None:
        """Take one sample of the filtered signals, one value an axis."""
        self._samples.append((dt_s, *u, *v, *e))
        self._time_s += dt_s

    def look(self, noise: float) -> Alarm:
        """Close a block; return the largest alarms of all windows that end now.

        Known where one of them is.

        ``noise`` is the white noise of e, 1 sigma per axis.
        """
        kept, own = self._kept, self._own
        begun = [kept[-blocks] for blocks in BLOCKS if blocks <= len(kept)]
        self._close_block()
        shortest_s = FEWEST_SAMPLES * own.memory_s - ROUNDING_S
        begun = [each for each in begun if self._time_s - each.time_s >= shortest_s]
        if not begun:
            return NO_ALARM
        now = kept[-1]
        time_s = np.array([now.time_s - each.time_s for each in begun])[:, None]
        along = now.products - np.array([each.products for each in begun])
        # Every other direction is an axis.
        powers = along[:, ::2].diagonal(axis1=2, axis2=3).sum(axis=1) / time_s
        tones2, own2, least = powers[:, 0], powers[:, 1], TONES_LEAST * self._least
        if tones2.max() < least * least and own2.max() < own.least * own.least:
            return NO_ALARM
        found = _regress(along)
        # Where less than half of the tones' motion is measured at all, no error of the model of v
        # is the cause: it would be measured, too.
        measured2, tones_along2 = along[..., :3, :3].sum(axis=(-2, -1)), along[..., 0, 0]
        moves = measured2 >= LEAST_RESPONSE * LEAST_RESPONSE * tones_along2
        model2 = np.where(moves, MODEL_ERROR * MODEL_ERROR * own2[:, None], 0.0)[..., None]
        # Tones at one end of a window are few samples. Of a steady tone all its time counts.
        u4 = now.u4 - np.array([[each.u4] for each in begun])
        sounded_s = np.clip(
            STEADY_TONE * _burst_s(tones2[:, None] * time_s, u4),
            FEWEST_SAMPLES * self._memory_s,
            time_s,
        )
        tones, is_known = self._judge_tones(along, found, sounded_s, noise, model2)
        moved_s = time_s
        if math.isfinite(own.burst_s):
            # A gust at the end of a calm window is few samples.
            v4 = now.v4 - np.array([each.v4 for each in begun])
            moved_s = np.clip(_burst_s(along[..., 1, 1], v4), own.burst_s, time_s)
        own_excess = self._judge_own(along, found, time_s, moved_s, noise)
        return Alarm(float(tones.max()), float(own_excess.max()), bool(is_known.all(axis=1).any()))

    def _close_block(self) -> None:
        """Add the samples since the last look to the integrals."""
        last = self._kept[-1]
        if not self._samples:
            self._kept.append(msgspec.structs.replace(last, time_s=self._time_s))
            return
        samples, self._samples = np.array(self._samples), []
        signals = self._directions @ samples[:, 1:].T
        block = (signals * samples[:, 0]) @ signals.transpose(0, 2, 1)
        block_s = self._time_s - last.time_s
        self._kept.append(
            _Integrals(
                self._time_s,
                last.products + block,
                last.v4 + block[:, 1, 1] ** 2 / block_s,
                last.u4 + block[::2, 0, 0].sum() ** 2 / block_s,
            )
        )

    def _judge_tones(
        self, along: Array, found: "_Regression", sounded_s: Array, noise: float, model2: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return the excess of the responses to the tones [-], and where the poses are known to
        respond.

        ``along``: integrals of the products of u, v, e and e across, shape (windows, directions, 4,
        4); ``model2``: mean square by which the model of v is wrong, shape (windows, directions,
        1).
        """
        rms = np.sqrt(np.maximum(along[..., 0, 0], 0.0) / sounded_s)
        is_excited = rms >= TONES_LEAST * self._least
        if not is_excited.any():
            return np.zeros_like(rms), is_excited
        errors = self._find_errors(found, 0, sounded_s, self._memory_s, noise, model2)
        commanded = along[..., 0, 0] + along[..., 0, 1]
        alone = along[..., 0, 2:] / np.maximum(commanded, RIDGE)[..., None]
        beyond = np.minimum(np.abs(found.slopes[..., 0, :]), np.abs(alone)) - LIMITS
        # Otherwise v has undone the tones.
        counts = (errors <= MOST_ERROR) & (is_excited & (commanded > 0.0))[..., None]
        excess = np.where(counts, np.maximum(beyond, 0.0) / (HIGHLY_SIGNIFICANT * errors), 0.0).max(
            axis=-1
        )
        return excess, counts[..., 0] & (beyond[..., 0] <= 0.0)

    def _judge_own(
        self, along: Array, found: "_Regression", time_s: Array, moved_s: Array, noise: float
    ) -> Array:
        """Return the excess of the responses to the law's own motion [-].

        Wind makes no response below 0, except by noise. Poses that respond to the tones are neither
        frozen nor mirrored: something else cancels the motion.
        """
        own = self._own
        rms = np.sqrt(np.maximum(along[..., 1, 1], RIDGE) / time_s)
        least = np.maximum(LEAST_RESPONSE - own.cancelled / rms, LEAST_OWN_RESPONSE)
        below = least - 1.0 - found.slopes[..., 1, 0]
        counts = (rms >= own.least) & (below > 0.0)
        if not counts.any():
            return np.zeros_like(rms)
        errors = self._find_errors(found, 1, moved_s, own.memory_s, noise)[..., 0]
        tone_errors = self._find_errors(found, 0, time_s, self._memory_s, noise)[..., 0]
        responds = 1.0 + found.slopes[..., 0, 0] >= LEAST_RESPONSE + CONFIRMING_ERRORS * tone_errors
        counts &= (errors <= MOST_OWN_ERROR) & ~responds
        return np.where(counts, below / (SIGNIFICANT * errors), 0.0)

    def _find_errors(
        self,
        found: "_Regression",
        signal: int,
        time_s: Array,
        memory_s: float,
        noise: float,
        model2: Array | float = 0.0,
    ) -> Array:
        """Return the standard errors of the responses to u (``signal`` 0) or v (1).

        Shape (windows, directions, 2).

        ``model2``: mean square by which the model of the other signal is wrong.
        """
        # Few samples know little of their own scatter: the assumed residual is a prior worth some
        # samples, and the interval is wider, as by Student's distribution.
        window_s, noise2 = time_s[..., None], noise * noise
        prior = PRIOR_SAMPLES * memory_s * self._least * self._least + window_s * model2
        freedom = window_s / memory_s - 2.0
        beside_noise = (np.maximum(found.residual - window_s * noise2, 0.0) + prior) / freedom
        variance = (beside_noise + noise2 * NOISE_MEMORY_S) * found.inverse[
            ..., signal, signal, None
        ]
        return (1.0 + 4.0 / freedom) * np.sqrt(variance)


class _Integrals(msgspec.Struct, frozen=True, gc=False):
    """Integrals of the signals from the beginning until one instant."""

    time_s: float
    products: Array
    """Products of u, v, e and e across, for each direction."""
    v4: Array
    """Fourth power of v for each direction, by means over blocks."""
    u4: float
    """Fourth power of |u|, by means over blocks."""


def _burst_s(power: Array, power2: Array) -> Array:
    """Return the time for which a signal x is there [s]: (∫x²)²/∫x⁴.

    ``power`` is ∫x², ``power2`` ∫x⁴ by means over blocks.
    """
    return power**2 / np.maximum(power2, RIDGE * RIDGE)


class _Regression(msgspec.Struct, frozen=True, gc=False):
    """Regression of e and e across on u and v, for each window and direction."""

    slopes: Array
    """D_u and D_v, of e and of e across; shape (windows, directions, 2, 2)."""
    inverse: Array
    """Inverse of the integrals of the products of u and v, of the same shape."""
    residual: Array
    """Integrals of the squares of what is left of e and of e across; shape (windows, directions,
    2)."""


def _regress(along: Array) -> _Regression:
    """Regress e and e across on u and v; ``along`` as in :meth:`Response._judge_tones`."""
    squares, products = along[..., :2, :2] + RIDGES, along[..., :2, 2:]
    determinant = squares[..., 0, 0] * squares[..., 1, 1] - squares[..., 0, 1] ** 2
    inverse = ADJUGATE * squares[..., ::-1, ::-1] / determinant[..., None, None]
    slopes = inverse @ products
    residual = along.diagonal(axis1=-2, axis2=-1)[..., 2:] - (slopes * products).sum(axis=-2)
    return _Regression(slopes, inverse, residual)


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
