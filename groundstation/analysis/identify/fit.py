"""Fit: how a vehicle turns and is lifted after what was commanded, by least squares, and how far
that may be off.

Innovations are what a model left unexplained, made white by the Kalman filter of
core/estimation/estimator.py. What is measured is x0 + noise, where x0 is the integral of x1, and x1
that of x2; white noise drives each. An error that comes in at a derivative (wind on an
acceleration, a lost frame on a body rate) then counts as what it is, and a fit weighs every
frequency as it should: prediction errors (L. Ljung, System Identification, 2nd ed., chapter 7).

The turn between two poses, in the body's frame, is the integral of the body rates. Summed up, the
measured turns and those of the commands through lag and delay differ by the attitude's noise and by
whatever else turned the vehicle.

Thrust fit: scale, curve and lag of thrust, and drag, from how position follows thrust along the
measured attitude.

    p¨ = -(1 - s t) λ T/m · R e3 - k v + R (l ω2, -l ω1, 0) + g e3 + wind        measured: p + R c +
                                                                                 noise

T is the told thrust through curve, delay and lag; λ its scale at mid-flight, s how it sags in time.
The wind is white noise's integral, so that only what is faster than it tells of thrust. Two things
are found only so that they pass for nothing else: c, how far the tracked point is from the centre
of mass (2 cm pass for 8 % of thrust at 1 Hz), and l, which takes up rotors that are not centred and
attitudes that are not of the positions' instant.

Thrust goes by its signal, where curve and scale are not as told (links/core/deadman.py).
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from groundstation.analysis.identify.stretch import (
    POSE_GAP_S,
    Column,
    FlightStretch,
    components,
)
from groundstation.core.estimation import (
    PP,
    Covariance,
    Densities,
    predict_covariance,
    update_covariance,
)
from groundstation.core.geometry import arrays, so3
from groundstation.settings import Config
from links.core import signal, thrust

ROUNDS = 15
"""Most steps of a fit, and most turns of fitting model and noise."""
CLOSE = 0.01
"""Step, as a share of each deviation, below which the fit has converged [-]."""
MEMORY_S = 1.0
"""Innovations may hang together over this time [s]; the deviations count that in."""
FALLS = 8
"""A step that makes it worse is halved so often."""
NOTHING = 1e-9
"""Information of what is not seen, per step squared."""
Whiten = Callable[[Sequence[Column]], Column]
"""Sets of P parameters, S of them → innovations of unit variance, (N, k, S)."""


class Parameter(NamedTuple):
    """A parameter that is fitted, in its own unit."""

    least: float
    most: float
    step: float
    """Step for the derivative."""


class Bounds(NamedTuple):
    """Bounds and steps of each of P parameters."""

    least: Column
    most: Column
    steps: Column
    """Step of each for its derivative."""
    expected: Column
    spread: Column
    """An independent estimate ``expected`` ± ``spread`` (one deviation) counts like a measurement;
    infinite: none."""

    @classmethod
    def of(cls, parameters: Iterable[Parameter], expected: Column, spread: Column) -> "Bounds":
        """Those of ``parameters``."""
        least, most, steps = np.array(list(parameters)).T
        return cls(least, most, steps, expected, spread)


class Fit(NamedTuple):
    """The likeliest parameters."""

    values: Column
    """(P,)"""
    covariance: Column
    """(P, P), each deviation the larger of the noise model's and the innovations'."""
    news: Column
    """Innovations that are left, (N, k)."""

    @property
    def deviations(self) -> Column:
        """One standard deviation of each, (P,)."""
        spread: Column = np.sqrt(np.diag(self.covariance))
        return spread

    def widen(self, other: "Fit") -> "Fit":
        """Widen the covariance by the difference from a fit that weighs frequencies otherwise.

        A model that lacks nothing finds the same both times.
        """
        apart = other.values - self.values
        return self._replace(covariance=self.covariance + np.outer(apart, apart))

    def condition_on(self, index: int, value: float) -> Column:
        """The likeliest parameters where the one at ``index`` is known to be ``value``."""
        share = self.covariance[:, index] / self.covariance[index, index]
        likeliest: Column = self.values + share * (value - self.values[index])
        return likeliest


def minimize(whitened: Whiten, start: Column, bounds: Bounds, interval_s: float) -> Fit:
    """The parameters of least innovations, from ``start``; samples are ``interval_s`` [s] apart.

    Intervals that rest on white innovations alone are too short where these hang together. So both
    are computed: the inverse information, and the same with the scores' own covariance over a
    second (Newey and West, Econometrica 55, 1987); the larger deviation is kept.
    """
    values = np.clip(start, bounds.least, bounds.most)
    sure = 1.0 / bounds.spread**2
    information, slopes, news = _linearize(whitened, values, bounds)
    for _ in range(ROUNDS):
        pull = np.einsum("nap,na->p", slopes, news) + sure * (values - bounds.expected)
        step = -np.linalg.solve(information, pull)
        deviations = np.sqrt(np.diag(np.linalg.inv(information)))
        before = values
        values, news = _down(whitened, values, step, news, bounds)
        information, slopes, news = _linearize(whitened, values, bounds)
        if np.all(np.abs(values - before) < CLOSE * deviations):
            break
    inverse = np.linalg.inv(information)
    scores = np.einsum("nap,na->np", slopes, news)
    lags = round(MEMORY_S / interval_s)
    meat = scores.T @ scores
    for lag in range(1, min(lags, len(scores) - 1) + 1):
        part = scores[lag:].T @ scores[:-lag]
        meat += (1.0 - lag / (lags + 1)) * (part + part.T)
    robust = inverse @ (meat + np.diag(sure)) @ inverse
    wider = np.sqrt(np.maximum(np.diag(robust) / np.diag(inverse), 1.0))
    return Fit(values, inverse * np.outer(wider, wider), news)


def _linearize(whitened: Whiten, values: Column, bounds: Bounds) -> tuple[Column, Column, Column]:
    """Information (P, P), how innovations move with each parameter (N, k, P), and the innovations
    (N, k).
    """
    moved = [values + step for step in np.diag(bounds.steps)]
    news = whitened([values, *moved])
    slopes = (news[:, :, 1:] - news[:, :, :1]) / bounds.steps
    information = np.einsum("nap,naq->pq", slopes, slopes) + np.diag(1.0 / bounds.spread**2)
    # What nothing shows has no information at all: it then stays where it is, and its deviation
    # says so.
    information[np.diag_indices(len(values))] += NOTHING / bounds.steps**2
    return information, slopes, news[:, :, 0]


def _down(
    whitened: Whiten, values: Column, step: Column, news: Column, bounds: Bounds
) -> tuple[Column, Column]:
    """The values after the longest of the steps ``step``/2ⁿ that leaves less than ``news``."""

    def cost(values: Column, news: Column) -> float:
        return float((news**2).sum() + (((values - bounds.expected) / bounds.spread) ** 2).sum())

    before = cost(values, news)
    for n in range(FALLS):
        tried = np.clip(values + step * 0.5**n, bounds.least, bounds.most)
        left = whitened([tried])[:, :, 0]
        if cost(tried, left) <= before:
            return tried, left
    return values, news


Ratios: TypeAlias = tuple[float, float, float]
"""Spectral densities of the noise that drives x0, x1, x2, over the variance of a measurement."""
DIFFUSE = 1e8
"""Variance of what is unknown at first, in units of the noise's."""
LOOKS = 800
"""Number of samples, in the middle of the flight, for the noise levels [-]."""
COARSE = np.arange(-4.0, 4.1, 1.0)
"""Powers of ten that are tried first, about where the search begins; FINE fills in between."""
FINE = np.arange(-0.75, 0.76, 0.25)
"""Finer grid of the noises' decimal powers, about the best of the coarse one."""


class Noise(NamedTuple):
    """Noise levels."""

    variance: float
    """Variance of each measurement."""
    ratios: Ratios

    def reweigh(self) -> Ratios:
        """Ratios that weigh frequencies another way: what is slow counts less."""
        a, b, c = self.ratios
        return OTHERWISE * a, OTHERWISE * b, OTHERWISE * c


OTHERWISE = 10.0**0.5
"""Factor on the driving noises for the other weighing of frequencies [-]."""


class InnovationFilter(NamedTuple):
    """Gains over N samples: they do not depend on the data."""

    spans_s: Column
    """Time since the sample before, (N,); 0 at the first."""
    gains: Column
    """(N, 3)"""
    variances: Column
    """Variances of the innovations, in units of the measurement's, (N,); infinite at the start."""

    def innovations(self, measured: Column, pushes: Column | None = None) -> tuple[Column, Column]:
        """Compute the innovations of ``measured`` (N, k) over their deviations, and x1 halfway to
        the next (N, k).

        Both rest on the samples up to then only. ``pushes`` (N, 2, k) are known inputs: what is
        added to x0 and x1 over the span before each sample.
        """
        count, width = measured.shape
        # The filter is linear: all blocks of samples run at once from nothing, and beside them from
        # each of its states.
        spans, gains, seen = (_lay(self.spans_s[:, None]), _lay(self.gains), _lay(measured, 3))
        pushed = None if pushes is None else _lay(pushes, 3)
        states = np.zeros((3, seen.shape[1], width + 3))
        for which in range(3):
            states[which, :, width + which] = 1.0
        x0, x1, x2 = states
        news, halfway = np.empty_like(seen), np.empty_like(seen)
        for k, h in enumerate(spans):
            x0 = x0 + h * (x1 + (0.5 * h) * x2)
            before, x1 = x1, x1 + h * x2
            if pushed is not None:
                x0, x1 = x0 + pushed[k, :, 0], x1 + pushed[k, :, 1]
            halfway[k] = 0.5 * (before + x1)
            news[k] = new = seen[k] - x0
            g = gains[k, :, :, None]
            x0, x1, x2 = x0 + g[:, 0] * new, x1 + g[:, 1] * new, x2 + g[:, 2] * new
        begins = _find_beginnings(np.stack([x0, x1, x2], axis=1), width)
        left = _join(news, begins, count) / np.sqrt(self.variances)[:, None]
        return left, np.roll(_join(halfway, begins, count), -1, axis=0)


def _lay(values: Column, more: int = 0) -> Column:
    """Lay N samples (N, …) out in about √N blocks: (length, blocks, …), with so many columns of
    zeros ``more``.
    """
    length = max(1, math.isqrt(len(values)))
    blocks = -(-len(values) // length)
    spare = [(0, blocks * length - len(values))] + [(0, 0)] * (values.ndim - 2) + [(0, more)]
    laid: Column = (
        np.pad(values, spare).reshape(blocks, length, *values.shape[1:-1], -1).swapaxes(0, 1)
    )
    return laid


def _find_beginnings(ends: Column, width: int) -> Column:
    """The state in which each block begins (blocks, 3, ``width``), from the ``ends`` of all from
    nothing and from each state.
    """
    begins, state = np.zeros((len(ends), 3, width)), np.zeros((3, width))
    for block, end in enumerate(ends):
        begins[block] = state
        state = end[:, :width] + end[:, width:] @ state
    return begins


def _join(values: Column, begins: Column, count: int) -> Column:
    """Join the blocks' results from nothing with those from each block's beginning."""
    width = begins.shape[-1]
    whole = values[:, :, :width] + np.einsum("lbs,bsw->lbw", values[:, :, width:], begins)
    joined: Column = whole.swapaxes(0, 1).reshape(-1, width)[:count]
    return joined


def design_filter(at_s: Column, ratios: Ratios, gap_s: float) -> InnovationFilter:
    """The filter for samples at ``at_s`` (N,) [s].

    After a span longer than ``gap_s`` it begins anew.
    """
    spans = np.diff(at_s, prepend=at_s[0])
    gains, variances = np.zeros((len(at_s), 3)), np.full(len(at_s), np.inf)
    # The first innovations are left out, one a state: the filter starts without knowledge.
    densities, cover, known = Densities(*ratios, 0.0), _unknown(ratios), -len(ratios)
    for k, span in enumerate(spans.tolist()):
        if span > gap_s:
            cover, known = _unknown(ratios), -len(ratios)
        cover = predict_covariance(cover, span, densities)
        total = cover[PP] + 1.0
        gain, cover = update_covariance(cover, 1.0)
        gains[k] = gain[:3]
        known += 1
        if known > 0:
            variances[k] = total
    return InnovationFilter(spans, gains, variances)


def _unknown(ratios: tuple[Any, Any, Any]) -> Covariance:
    """x0 and x1 are; x2 is only where something drives it."""
    return (DIFFUSE, 0.0, 0.0, 0.0, DIFFUSE, 0.0, 0.0, DIFFUSE * (ratios[2] > 0.0), 0.0, 0.0)


def fit_noise(
    at_s: Column,
    left: Column,
    about: Ratios,
    gap_s: float,
    powers: Sequence[Column] = (COARSE, FINE),
) -> tuple[Noise, InnovationFilter]:
    """The likeliest noise of what a model has ``left`` unexplained (N, k), and its filter.

    The search goes from the ratios ``about`` by these ``powers`` of ten, in turn; a ratio of 0
    stays so. The variance has a closed form.
    """
    first = max(0, (len(at_s) - LOOKS) // 2)
    few = slice(first, first + LOOKS)
    best, variance = about, 1.0
    for some in powers:
        factors = [10.0**some if ratio > 0.0 else np.zeros(1) for ratio in best]
        grid = np.meshgrid(*factors, indexing="ij")
        tried = [ratio * part.ravel() for ratio, part in zip(best, grid, strict=True)]
        unlikely, variances = _unlikely(at_s[few], left[few], (tried[0], tried[1], tried[2]), gap_s)
        i = int(unlikely.argmin())
        best, variance = (
            (float(tried[0][i]), float(tried[1][i]), float(tried[2][i])),
            float(variances[i]),
        )
    return Noise(variance, best), design_filter(at_s, best, gap_s)


def find_noise(at_s: Column, left: Column, *, wanders: bool) -> Ratios:
    """The likeliest noise of positions of which a model has ``left`` (N, 3) [m] unexplained.

    ``wanders``: their errors may last from pose to pose. Returns densities of what drives position
    [m/√s], acceleration [m/s² per √Hz] and its change [m/s³ per √Hz].
    """
    noise, _ = fit_noise(at_s, left, ABOUT_POSES if wanders else ABOUT_THRUST, POSE_GAP_S)
    a, b, c = (math.sqrt(noise.variance * ratio) for ratio in noise.ratios)
    return a, b, c


def _unlikely(
    at_s: Column, left: Column, ratios: tuple[Column, Column, Column], gap_s: float
) -> tuple[Column, Column]:
    """Minus the mean log likelihood of ``left`` for each of G sets of ratios, and the measurement's
    variance, (G,).
    """
    # Elementwise: what flies one vehicle in floats takes G of them in arrays.
    elements: tuple[Any, Any, Any] = ratios
    rates = Densities(*elements, 0.0)
    sets = len(ratios[0])
    x0, x1, x2 = (np.zeros((sets, left.shape[1])) for _ in range(3))
    squares, logs, count = np.zeros(sets), np.zeros(sets), 0
    cover, known = _unknown(ratios), -len(ratios)
    for k, h in enumerate(np.diff(at_s, prepend=at_s[0]).tolist()):
        if h > gap_s:
            cover, known = _unknown(ratios), -len(ratios)
        cover = predict_covariance(cover, h, rates)
        total = cover[PP] + 1.0
        gain, cover = update_covariance(cover, 1.0)
        x0 = x0 + h * (x1 + (0.5 * h) * x2)
        x1 = x1 + h * x2
        new = left[k] - x0
        x0, x1, x2 = (
            x + np.asarray(g)[..., None] * new for x, g in zip((x0, x1, x2), gain, strict=False)
        )
        known += 1
        if known > 0:
            squares = squares + (new * new).sum(axis=1) / total
            logs = logs + np.log(total)
            count += 1
    variances = squares / max(count * left.shape[1], 1)
    return np.log(variances) + logs / max(count, 1), variances


class LagResponse(NamedTuple):
    """A first-order lag, exact: x˙ = (u - x)/τ, with u held from each instant to the next."""

    at_s: Column
    """When each command begins to act, (M,) [s]."""
    held: Column
    """The commands u, (M, …)."""
    lag_s: float
    before: Column
    """x at those instants, (M, …)."""
    area: Column
    """∫x from the first to each of those instants, (M, …)."""

    def value(self, time_s: Column) -> Column:
        """X at ``time_s`` (…,) [s]."""
        index, _, left = self._since(time_s)
        value: Column = self.held[index] + (self.before[index] - self.held[index]) * left
        return value

    def integral(self, time_s: Column) -> Column:
        """∫x from the first command to ``time_s`` (…,) [s]."""
        index, since, left = self._since(time_s)
        held = self.held[index]
        area: Column = (
            self.area[index]
            + held * since
            + (self.before[index] - held) * (self.lag_s * (1.0 - left))
        )
        return area

    def _since(
        self, time_s: Column
    ) -> tuple["np.ndarray[tuple[int, ...], np.dtype[np.int64]]", Column, Column]:
        """Which command is held, for how long, and how much of the start is left then."""
        index = np.clip(np.searchsorted(self.at_s, time_s, side="right") - 1, 0, None)
        since = np.maximum(time_s - self.at_s[index], 0.0)
        left = np.exp(-since / self.lag_s) if self.lag_s > 0.0 else np.zeros_like(since)
        shape = since.shape + (1,) * (self.held.ndim - 1)
        return index, since.reshape(shape), left.reshape(shape)


def _follow(held: Column, left: Column, first: Column) -> Column:
    """Iterate x ← u + (x - u) ``left`` with each u of ``held`` (M, …) from ``first``.

    Return all x (M, …).
    """
    count, length = len(held), max(1, math.isqrt(len(held)))
    blocks = -(-count // length)
    spare = [(0, blocks * length - count)] + [(0, 0)] * (held.ndim - 1)
    u = np.pad(held, spare).reshape(blocks, length, *held.shape[1:])
    keep = np.pad(left, spare, constant_values=1.0).reshape(u.shape)
    # All blocks at once from 0, and how much is left of what each begins with.
    shares, found, value = np.cumprod(keep, axis=1), np.empty_like(u), np.zeros_like(u[:, 0])
    for k in range(length):
        value = u[:, k] + (value - u[:, k]) * keep[:, k]
        found[:, k] = value
    begun = first
    for k, share in enumerate(shares):
        found[k] += share * begun
        begun = found[k, -1]
    return found.reshape(-1, *held.shape[1:])[:count]


def respond_with_lag(sent_s: Column, held: Column, delay_s: float, lag_s: float) -> LagResponse:
    """The response to commands ``held`` (M, …) that left at ``sent_s`` (M,) [s], begun at rest on
    the first.
    """
    spans = np.diff(sent_s)
    left = np.exp(-spans / lag_s) if lag_s > 0.0 else np.zeros_like(spans)
    wide = (slice(None),) + (None,) * (held.ndim - 1)
    start = np.concatenate(
        [held[:1], _follow(held[:-1], np.broadcast_to(left[wide], held[:-1].shape), held[0])]
    )
    grown = held[:-1] * spans[wide] + (start[:-1] - held[:-1]) * (lag_s * (1.0 - left))[wide]
    area = np.concatenate([np.zeros_like(held[:1]), np.cumsum(grown, axis=0)])
    return LagResponse(sent_s + delay_s, held, lag_s, start, area)


GAP_POSES = 3.5
"""After so many missing poses the turns begin anew: a long turn is no sum of its parts."""
ABOUT = (0.1, 10.0, 0.0)
"""Where the search for the noises begins: white noise on body rates [1/s], and on their change
[1/s³]."""
DELAYS_S = (-0.01, 0.0, 0.015, 0.03, 0.06, 0.1, 0.15)
LAGS_S = (0.01, 0.03, 0.06, 0.1, 0.16)
"""Where the fits of rates and thrust may begin [s]."""
DELAY = Parameter(-0.05, 0.5, 2e-4)
"""Any delay [s]: beyond these bounds a fit has gone astray."""
LAG = Parameter(0.0, 1.0, 2e-4)
"""Any lag [s]: the same."""
TURN = {"delay": DELAY, "roll_lag": LAG, "pitch_lag": LAG, "yaw_delay": DELAY, "yaw_lag": LAG}
"""Parameters [s]; the first delay is of roll and pitch."""
TURN_NAMES = tuple(TURN)


class TurnFit(NamedTuple):
    """Fit of the vehicle's turns."""

    fit: Fit
    """Fit of :data:`TURN_NAMES`."""
    turns: Column
    """Measured turn from each pose to the next, (N-1, 3) [rad]."""
    modelled: Column
    """Modelled turns between poses [rad]."""

    @property
    def left(self) -> Column:
        """Sum up the residual turns, (N, 3) [rad]."""
        return np.concatenate([np.zeros((1, 3)), np.cumsum(self.turns - self.modelled, axis=0)])


def turns(attitude: Column) -> Column:
    """Rotation vector from each attitude (N, 4) to the next in the body's frame, (N-1, 3) [rad]."""
    before, after = components(attitude[:-1]), components(attitude[1:])
    return np.stack(so3.turn_between(before, after, arrays()), axis=1)


def angles(seen: FlightStretch, values: Column, time_s: Column) -> Column:
    """Integral of the modelled body rates from the first command to ``time_s``, (…, 3) [rad]."""
    delay, roll, pitch, yaw_delay, yaw = values.tolist()
    parts = [
        respond_with_lag(seen.sent_s, seen.rates_rad_s[:, axis], late, lag).integral(time_s)
        for axis, (late, lag) in enumerate(((delay, roll), (delay, pitch), (yaw_delay, yaw)))
    ]
    return np.stack(parts, axis=-1)


def fit_turns(seen: FlightStretch) -> TurnFit:
    """Fit delay and lags to the attitudes that were ``seen``."""
    measured = turns(seen.attitude)
    summed = np.concatenate([np.zeros((1, 3)), np.cumsum(measured, axis=0)])
    interval = float(np.median(np.diff(seen.at_s)))
    gap = GAP_POSES * interval

    def left(sets: Sequence[Column]) -> Column:
        """Compute the residual of each set of parameters, (N, 3, S)."""
        return np.stack([summed - angles(seen, values, seen.at_s) for values in sets], axis=-1)

    def whiten_by(filter_: InnovationFilter, variance: float) -> Whiten:
        def whiten(sets: Sequence[Column]) -> Column:
            rest = left(sets)
            news, _ = filter_.innovations(rest.reshape(len(rest), -1))
            shaped: Column = news.reshape(rest.shape) / math.sqrt(variance)
            return shaped

        return whiten

    first = np.array([0.0, 1.0, 1.0, 0.0, 1.0]) * seen.config.vehicle.rate_lag_s
    noise, filter_ = fit_noise(seen.at_s, left([first])[:, :, 0], ABOUT, gap)
    starts = [np.array([delay, lag, lag, delay, lag]) for delay in DELAYS_S for lag in LAGS_S]
    news = whiten_by(filter_, 1.0)(starts)
    level = starts[int((news[:, :2] ** 2).sum(axis=(0, 1)).argmin())]
    yaw = starts[int((news[:, 2] ** 2).sum(axis=0).argmin())]
    values = np.concatenate([level[:3], yaw[3:]])
    bounds = Bounds.of(TURN.values(), values, np.full(len(TURN), np.inf))
    fit = None
    for about, powers in ((ABOUT, (COARSE, FINE)), (None, (FINE,))):
        noise, filter_ = fit_noise(
            seen.at_s, left([values])[:, :, 0], about or noise.ratios, gap, powers
        )
        fit = minimize(whiten_by(filter_, noise.variance), values, bounds, interval)
        values = fit.values
    assert fit is not None, "fitted twice"
    fit = fit.widen(
        minimize(
            whiten_by(design_filter(seen.at_s, noise.reweigh(), gap), noise.variance),
            values,
            bounds,
            interval,
        )
    )
    return TurnFit(fit, measured, np.diff(angles(seen, values, seen.at_s), axis=0))


def thrust_n(config: Config, about: float, curve: float, signals: Column) -> Column:
    """Thrust at ``signals`` 0..1 on the curve with f = ``curve`` that agrees with ``config`` at the
    one ``about`` [N].

    The scale that multiplies it holds at the thrust about which the vehicle flew, on any curve.
    """
    told = config.full_thrust_n * thrust(about, config.thrust_curve)
    pushed: Column = (
        told / thrust(about, curve) * (curve * signals * signals + (1.0 - curve) * signals)
    )
    return pushed


def full_n(config: Config, about: float, scale: float, curve: float) -> float:
    """Thrust of the full signal [N]."""
    return scale * float(thrust_n(config, about, curve, np.array(1.0)))


def hover_signal(config: Config, about: float, scale: float, curve: float) -> float:
    """The signal 0..1 that carries the vehicle."""
    return signal(config.weight_n / full_n(config, about, scale, curve), curve)


def most_n(config: Config, about: float, scale: float, curve: float) -> float:
    """Compute the real thrust of the signal configured to give ``vehicle.thrust_max_n`` [N]."""
    most = signal(config.vehicle.thrust_max_n / config.full_thrust_n, config.thrust_curve)
    return scale * float(thrust_n(config, about, curve, np.array(most)))


STEPS = 5
"""Between two poses thrust and attitude are looked at so often."""
DRAGS = ("drag_x", "drag_y", "drag_z")
THRUST = {
    "delay": DELAY,
    "lag": LAG,
    "scale": Parameter(0.2, 4.0, 1e-3),
    "sag": Parameter(-0.5, 0.5, 1e-3),
    "curve": Parameter(-0.5, 1.5, 1e-2),
    **dict.fromkeys(DRAGS, Parameter(-2.0, 5.0, 1e-3)),
    "leak": Parameter(-1.0, 1.0, 1e-3),
    **dict.fromkeys(("c_x", "c_y", "c_z"), Parameter(-0.5, 0.5, 1e-3)),
}
"""Parameters: delay, lag [s], scale [-], sag [1/min], curve [-], drag along each axis of the body
[1/s], leak l [m/s² per rad/s], c [m, FRD]."""
THRUST_NAMES = tuple(THRUST)
DRAG, LEVER = THRUST_NAMES.index("drag_x"), THRUST_NAMES.index("c_x")
"""Drag and c are three each."""
SMOOTH_S = 0.06
"""Attitudes are smoothed over this time to either side [s]: their noise, which the controller
answers, would pass for thrust."""


Strength: TypeAlias = tuple[Noise, InnovationFilter]
"""Levels of noise and wind, and the filter for them."""


class ThrustModel:
    """Motion of the vehicle under the sent commands.

    Holds what is constant while thrust is fitted.
    """

    def __init__(self, seen: FlightStretch, turned: TurnFit) -> None:
        """Attitudes between the poses, from the fitted turns, pinned to the measured attitudes."""
        self.seen = seen
        self.mass = seen.config.vehicle.mass_kg
        full, told = seen.config.full_thrust_n, seen.config.thrust_curve
        self.signals = np.array(
            [signal(newtons / full, told) for newtons in seen.thrust_n.tolist()]
        )
        flown = (seen.sent_s > seen.at_s[0]) & (seen.sent_s < seen.at_s[-1])
        self.mean = float(self.signals[flown].mean())
        self.spans = np.diff(seen.at_s)
        share = (np.arange(STEPS) + 0.5) / STEPS
        self.times = seen.at_s[:-1, None] + self.spans[:, None] * share
        self.edges = seen.at_s[:-1, None] + self.spans[:, None] * np.arange(STEPS + 1) / STEPS
        self.middle_s = 0.5 * (seen.at_s[0] + seen.at_s[-1])
        values = turned.fit.values
        reach = max(1, round(SMOOTH_S / float(np.median(self.spans))))
        off = smooth(turned.left, reach) - turned.left
        since = angles(seen, values, self.times) - angles(seen, values, seen.at_s[:-1])[:, None]
        since = since + np.diff(turned.left + off, axis=0)[:, None] * share[:, None]
        attitude: Any = so3.rotate(components(seen.attitude), components(off))
        self.axes = np.moveaxis(np.array(so3.matrix(attitude)), -1, 0)
        started: Any = tuple(part[:-1, None] for part in attitude)
        turn: Any = tuple(np.moveaxis(since, -1, 0))
        down: Any = so3.third_column(so3.rotate(started, turn))
        self.down = np.stack(down, axis=-1)
        rates = turned.turns / self.spans[:, None]
        self.sideways = self.axes[:-1, :, 0] * rates[:, 1:2] - self.axes[:-1, :, 1] * rates[:, :1]
        self.velocity = np.diff(seen.position_ned, axis=0) / self.spans[:, None]

    def accelerations(self, values: Column) -> Column:
        """The model's, without wind and gravity, (N-1, STEPS, 3) [m/s²]."""
        delay, lag, scale, sag, curve, *drag, leak = values[:LEVER].tolist()
        fading = 1.0 - sag * (self.seen.sent_s - self.middle_s) / 60.0
        held = (
            scale / self.mass * fading * thrust_n(self.seen.config, self.mean, curve, self.signals)
        )
        # The mean over each step, exact however thrust jumps within it.
        areas = np.diff(
            respond_with_lag(self.seen.sent_s, held, delay, lag).integral(self.edges), axis=1
        )
        pushed = areas * STEPS / self.spans[:, None]
        along = np.einsum("nij,ni->nj", self.axes[:-1], self.velocity)  # in the body's axes
        rest = leak * self.sideways - np.einsum(
            "nij,nj->ni", self.axes[:-1], along * np.array(drag)
        )
        acceleration: Column = rest[:, None] - pushed[..., None] * self.down
        return acceleration

    def pushes(self, values: Column) -> Column:
        """Compute the model's additions to position and velocity before each pose, (N, 2, 3)."""
        acceleration = self.accelerations(values)
        h = self.spans / STEPS
        left = self.spans[:, None] * (1.0 - (np.arange(STEPS) + 0.5) / STEPS)
        fast = acceleration.sum(axis=1) * h[:, None]
        far = (acceleration * left[..., None]).sum(axis=1) * h[:, None]
        both = np.stack([far, fast], axis=1)
        return np.concatenate([np.zeros((1, 2, 3)), both])

    def position(self, values: Column) -> Column:
        """Measured position of the centre of mass, (N, 3) [m]."""
        position: Column = self.seen.position_ned - self.axes @ values[LEVER:]
        return position

    def fit_noises(
        self, values: Column, about: tuple[Ratios, Ratios], powers: Sequence[Column]
    ) -> tuple[Strength, Strength]:
        """The noises across and along the vertical that are left beside the model, searched
        ``about`` these ratios.
        """
        left, (level, upright) = self.remove_motion(values), about
        return (
            fit_noise(self.seen.at_s, left[:, :2], level, POSE_GAP_S, powers),
            fit_noise(self.seen.at_s, left[:, 2:], upright, POSE_GAP_S, powers),
        )

    def whiten_by(self, level: Strength, upright: Strength) -> Whiten:
        """Return what makes innovations of unit variance of sets of parameters."""

        def whiten(sets: Sequence[Column]) -> Column:
            pushes = np.stack([self.pushes(one) for one in sets], axis=-1)
            place = np.stack([self.position(one) for one in sets], axis=-1)
            news = []
            for axes, (noise, filter_) in ((slice(0, 2), level), (slice(2, 3), upright)):
                part = place[:, axes].reshape(len(place), -1)
                new, _ = filter_.innovations(part, pushes[:, :, axes].reshape(len(place), 2, -1))
                news.append(new.reshape(len(place), -1, len(sets)) / np.sqrt(noise.variance))
            return np.concatenate(news, axis=1)

        return whiten

    def remove_motion(self, values: Column) -> Column:
        """Positions less what the model has moved the vehicle since the first pose, (N, 3) [m]."""
        far, fast = np.moveaxis(self.pushes(values), 1, 0)
        speed = np.cumsum(fast, axis=0)
        moved = far.copy()
        moved[1:] += self.spans[:, None] * speed[:-1]
        placed: Column = self.position(values) - np.cumsum(moved, axis=0)
        return placed


def smooth(values: Column, reach: int) -> Column:
    """Means of ``values`` (N, k) over ``reach`` samples to either side, fewer near the ends."""
    at = np.arange(len(values))
    near = np.minimum(np.minimum(at, at[::-1]), reach)
    sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    means: Column = (sums[at + near + 1] - sums[at - near]) / (2 * near + 1)[:, None]
    return means


ABOUT_POSES = (1.0, 1e2, 1e5)
"""Where the search for the noises of a source begins: its wander [1/s], and the next two, over its
variance."""
ABOUT_THRUST = (0.0, 1e2, 1e5)
"""Where the search for the noises begins: white noise on acceleration [1/s³], and on the wind's
change [1/s⁵], over the positions' variance."""
SAG_PER_MIN = 0.1
"""A battery's thrust falls by about so much in a minute, one deviation [-]."""


class ThrustFit(NamedTuple):
    """Fit of the vehicle's thrust."""

    fit: Fit
    """Fit of :data:`THRUST_NAMES`."""
    about: float
    """The signal about which the scale holds, 0 to 1: the mean of the flight."""
    left: Column
    """Positions less what the model has moved the vehicle since the first pose, (N, 3) [m]."""


def fit_thrust(seen: FlightStretch, turned: TurnFit) -> ThrustFit:
    """Fit thrust and drag to the positions that were ``seen``.

    The search for delay begins about that of the turns.
    """
    scene = ThrustModel(seen, turned)
    vehicle = seen.config.vehicle
    delay = float(turned.fit.values[0])
    spread = np.full(len(THRUST_NAMES), np.inf)
    spread[THRUST_NAMES.index("sag")] = SAG_PER_MIN
    values = np.array(
        [
            delay,
            vehicle.thrust_lag_s,
            1.0,
            0.0,
            seen.config.thrust_curve,
            *[0.0] * (len(THRUST_NAMES) - 5),
        ]
    )
    bounds = Bounds.of(THRUST.values(), np.array([delay, *[0.0] * (len(THRUST) - 1)]), spread)
    interval = float(np.median(scene.spans))
    level, upright = scene.fit_noises(values, (ABOUT_THRUST, ABOUT_THRUST), (COARSE, FINE))
    starts = [
        np.array([late, lag, scale, *values[3:]])
        for late in sorted({0.0, 0.5 * delay, delay})
        for lag in LAGS_S
        for scale in (0.8, 0.9, 1.0, 1.1)
    ]
    news = scene.whiten_by(level, upright)(starts)
    values = starts[int((news**2).sum(axis=(0, 1)).argmin())]
    fit, about = None, (ABOUT_THRUST, ABOUT_THRUST)
    powers: tuple[Column, ...] = (COARSE, FINE)
    # Model and noise in turn: the better the model, the weaker the noise that is left.
    for _ in range(ROUNDS):
        level, upright = scene.fit_noises(values, about, powers)
        # By what was seen before: a velocity that knows the gust to come would take it for drag.
        _, halfway = level[1].innovations(scene.position(values), scene.pushes(values))
        scene.velocity = halfway[:-1]
        fit = minimize(scene.whiten_by(level, upright), values, bounds, interval)
        values = fit.values
        if (level[0].ratios, upright[0].ratios) == about:
            break
        about, powers = (level[0].ratios, upright[0].ratios), (FINE,)
    assert fit is not None, "fitted at least once"
    return ThrustFit(fit, scene.mean, scene.remove_motion(values))
