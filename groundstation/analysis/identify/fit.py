"""Least squares on innovations: Gauss and Newton, and how far the result may be off.

Innovations are what a model left unexplained, made white by the Kalman filter of core/estimation/estimator.py. What is
measured is x0 + noise, where x0 is the integral of x1, and x1 that of x2; white noise drives each. An error that comes
in at a derivative (wind on an acceleration, a lost frame on a body rate) then counts as what it is, and a fit weighs
every frequency as it should: prediction errors (L. Ljung, System Identification, 2nd ed., chapter 7).
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from groundstation.analysis.identify.stretch import Column
from groundstation.core.estimation import Covariance, Densities, predict_covariance, update_covariance

ROUNDS = 15
CLOSE = 0.01
"""It has converged once a step is shorter than this share of each deviation."""
MEMORY_S = 1.0
"""Innovations may hang together over this time [s]; the deviations count that in."""
FALLS = 8
"""A step that makes it worse is halved so often."""
NOTHING = 1e-9
"""Information of what is not seen, per step squared."""
Whiten = Callable[[Sequence[Column]], Column]
"""Sets of P parameters, S of them → innovations of unit variance, (N, k, S)."""


class Bounds(NamedTuple):
    """What is known of each of P parameters before."""

    least: Column
    most: Column
    steps: Column
    """How far each is moved to see what it does."""
    expected: Column
    spread: Column
    """An independent estimate ``expected`` ± ``spread`` (one deviation) counts like a measurement; infinite: none."""


class Fit(NamedTuple):
    """The likeliest parameters."""

    values: Column
    """(P,)"""
    covariance: Column
    """(P, P): the larger, in each deviation, of what the noise model says and what the innovations show."""
    news: Column
    """Innovations that are left, (N, k)."""

    @property
    def deviations(self) -> Column:
        """One standard deviation of each, (P,)."""
        spread: Column = np.sqrt(np.diag(self.covariance))
        return spread

    def widen(self, other: "Fit") -> "Fit":
        """The same, less sure by what it differs from an ``other`` one, that weighs the same frequencies another way.

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

    Intervals that rest on white innovations alone are too short where these hang together. So both are computed: the
    inverse information, and the same with the scores' own covariance over a second (Newey and West, Econometrica 55,
    1987); the larger deviation is kept.
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
    """Information (P, P), how innovations move with each parameter (N, k, P), and the innovations (N, k)."""
    moved = [values + step for step in np.diag(bounds.steps)]
    news = whitened([values, *moved])
    slopes = (news[:, :, 1:] - news[:, :, :1]) / bounds.steps
    information = np.einsum("nap,naq->pq", slopes, slopes) + np.diag(1.0 / bounds.spread**2)
    # What nothing shows has no information at all: it then stays where it is, and its deviation says so.
    information[np.diag_indices(len(values))] += NOTHING / bounds.steps**2
    return information, slopes, news[:, :, 0]


def _down(whitened: Whiten, values: Column, step: Column, news: Column, bounds: Bounds) -> tuple[Column, Column]:
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
UNSURE = 3
"""So many innovations are left out while the filter knows nothing."""
LOOKS = 800
"""So many samples, in the middle of the flight, are enough to find how strong the noises are."""
COARSE = np.arange(-4.0, 4.1, 1.0)
"""Powers of ten that are tried first, about where the search begins; the next ones fill in between."""
FINE = np.arange(-0.75, 0.76, 0.25)


class Noise(NamedTuple):
    """How strong the noises are."""

    variance: float
    """Of each measurement."""
    ratios: Ratios

    def reweigh(self) -> Ratios:
        """Ratios that weigh frequencies another way: what is slow counts less."""
        a, b, c = self.ratios
        return OTHERWISE * a, OTHERWISE * b, OTHERWISE * c


OTHERWISE = 10.0**0.5
"""How much stronger the noises that drive it are taken where frequencies are weighed another way."""


class InnovationFilter(NamedTuple):
    """Gains over N samples: they do not depend on the data."""

    spans_s: Column
    """Time since the sample before, (N,); 0 at the first."""
    gains: Column
    """(N, 3)"""
    variances: Column
    """Of the innovations, in units of the measurement's, (N,); infinite while the filter knows nothing."""

    def innovations(self, measured: Column, pushes: Column | None = None) -> tuple[Column, Column]:
        """What is new in each sample of ``measured`` (N, k), over its deviation, and x1 halfway to the next (N, k).

        Both rest on the samples up to then only. ``pushes`` (N, 2, k) are known inputs: what is added to x0 and x1 over
        the span before each sample.
        """
        count, width = measured.shape
        # The filter is linear: all blocks of samples run at once from nothing, and beside them from each of its states.
        length = max(1, math.isqrt(count))
        blocks = -(-count // length)

        def lay(values: Column, more: int = 0) -> Column:
            """(N, …) as (length, blocks, …), with so many columns of zeros more."""
            spare = [(0, blocks * length - count)] + [(0, 0)] * (values.ndim - 1)
            spare[-1] = spare[-1] if values.ndim == 1 else (0, more)
            laid: Column = np.pad(values, spare).reshape(blocks, length, *values.shape[1:-1], -1).swapaxes(0, 1)
            return laid

        spans, gains, seen = lay(self.spans_s[:, None]), lay(self.gains), lay(measured, 3)
        pushed = None if pushes is None else lay(pushes, 3)
        states = np.zeros((3, blocks, width + 3))
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
        ends = np.stack([x0, x1, x2], axis=1)
        begins, state = np.zeros((blocks, 3, width)), np.zeros((3, width))
        for block, end in enumerate(ends):
            begins[block] = state
            state = end[:, :width] + end[:, width:] @ state

        def join(values: Column) -> Column:
            """What was found from nothing, and what each block began with."""
            whole = values[:, :, :width] + np.einsum("lbs,bsw->lbw", values[:, :, width:], begins)
            joined: Column = whole.swapaxes(0, 1).reshape(blocks * length, width)[:count]
            return joined

        return join(news) / np.sqrt(self.variances)[:, None], np.roll(join(halfway), -1, axis=0)


def design_filter(at_s: Column, ratios: Ratios, gap_s: float) -> InnovationFilter:
    """The filter for samples at ``at_s`` (N,) [s]; after a span longer than ``gap_s`` it begins anew."""
    spans = np.diff(at_s, prepend=at_s[0])
    gains, variances = np.zeros((len(at_s), 3)), np.full(len(at_s), np.inf)
    densities, cover, known = Densities(*ratios, 0.0), _unknown(ratios), -UNSURE
    for k, span in enumerate(spans.tolist()):
        if span > gap_s:
            cover, known = _unknown(ratios), -UNSURE
        cover = predict_covariance(cover, span, densities)
        total = cover.pp + 1.0
        gain, cover = update_covariance(cover, 1.0)
        gains[k] = gain[:3]
        known += 1
        if known > 0:
            variances[k] = total
    return InnovationFilter(spans, gains, variances)


def _unknown(ratios: tuple[Any, Any, Any]) -> Covariance:
    """x0 and x1 are; x2 is only where something drives it."""
    return Covariance(DIFFUSE, 0.0, 0.0, 0.0, DIFFUSE, 0.0, 0.0, DIFFUSE * (ratios[2] > 0.0), 0.0, 0.0)


def fit_noise(
    at_s: Column, left: Column, about: Ratios, gap_s: float, powers: Sequence[Column] = (COARSE, FINE)
) -> tuple[Noise, InnovationFilter]:
    """The likeliest noise of what a model has ``left`` unexplained (N, k), and its filter for all samples.

    The search goes from the ratios ``about`` by these ``powers`` of ten, in turn; a ratio of 0 stays so. The variance
    has a closed form.
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
        best, variance = (float(tried[0][i]), float(tried[1][i]), float(tried[2][i])), float(variances[i])
    return Noise(variance, best), design_filter(at_s, best, gap_s)


def _unlikely(at_s: Column, left: Column, ratios: tuple[Column, Column, Column], gap_s: float) -> tuple[Column, Column]:
    """Minus the mean log likelihood of ``left`` for each of G sets of ratios, and the measurement's variance, (G,)."""
    # Elementwise: what flies one vehicle in floats takes G of them in arrays.
    elements: tuple[Any, Any, Any] = ratios
    rates = Densities(*elements, 0.0)
    sets = len(ratios[0])
    x0, x1, x2 = (np.zeros((sets, left.shape[1])) for _ in range(3))
    squares, logs, count = np.zeros(sets), np.zeros(sets), 0
    cover, known = _unknown(ratios), -UNSURE
    for k, h in enumerate(np.diff(at_s, prepend=at_s[0]).tolist()):
        if h > gap_s:
            cover, known = _unknown(ratios), -UNSURE
        cover = predict_covariance(cover, h, rates)
        total = cover.pp + 1.0
        gain, cover = update_covariance(cover, 1.0)
        x0 = x0 + h * (x1 + (0.5 * h) * x2)
        x1 = x1 + h * x2
        new = left[k] - x0
        x0, x1, x2 = (x + np.asarray(g)[..., None] * new for x, g in zip((x0, x1, x2), gain, strict=False))
        known += 1
        if known > 0:
            squares = squares + (new * new).sum(axis=1) / total
            logs = logs + np.log(total)
            count += 1
    variances = squares / max(count * left.shape[1], 1)
    return np.log(variances) + logs / max(count, 1), variances
