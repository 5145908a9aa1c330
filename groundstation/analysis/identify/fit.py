"""Least squares on innovations: Gauss and Newton, and how far the result may be off."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from groundstation.analysis.identify.seen import Column

ROUNDS = 15
CLOSE = 0.01
"""It has converged once a step is shorter than this share of each deviation."""
MEMORY_S = 1.0
"""Innovations may hang together over this time [s]; the deviations count that in."""
FALLS = 8
"""A step that makes it worse is halved so often."""
NOTHING = 1e-9
"""Information of what is not seen, per step squared."""
Whitened = Callable[[Sequence[Column]], Column]
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

    def given(self, index: int, value: float) -> Column:
        """The likeliest parameters where the one at ``index`` is known to be ``value``."""
        share = self.covariance[:, index] / self.covariance[index, index]
        likeliest: Column = self.values + share * (value - self.values[index])
        return likeliest


def solved(whitened: Whitened, start: Column, bounds: Bounds, interval_s: float) -> Fit:
    """The parameters of least innovations, from ``start``; samples are ``interval_s`` [s] apart.

    Intervals that rest on white innovations alone are too short where these hang together. So both are computed: the
    inverse information, and the same with the scores' own covariance over a second (Newey and West, Econometrica 55,
    1987); the larger deviation is kept.
    """
    values = np.clip(start, bounds.least, bounds.most)
    sure = 1.0 / bounds.spread**2
    information, slopes, news = _looked(whitened, values, bounds)
    for _ in range(ROUNDS):
        pull = np.einsum("nap,na->p", slopes, news) + sure * (values - bounds.expected)
        step = -np.linalg.solve(information, pull)
        deviations = np.sqrt(np.diag(np.linalg.inv(information)))
        before = values
        values, news = _down(whitened, values, step, news, bounds)
        information, slopes, news = _looked(whitened, values, bounds)
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


def _looked(whitened: Whitened, values: Column, bounds: Bounds) -> tuple[Column, Column, Column]:
    """Information (P, P), how innovations move with each parameter (N, k, P), and the innovations (N, k)."""
    moved = [values + step for step in np.diag(bounds.steps)]
    news = whitened([values, *moved])
    slopes = (news[:, :, 1:] - news[:, :, :1]) / bounds.steps
    information = np.einsum("nap,naq->pq", slopes, slopes) + np.diag(1.0 / bounds.spread**2)
    # What nothing shows has no information at all: it then stays where it is, and its deviation says so.
    information[np.diag_indices(len(values))] += NOTHING / bounds.steps**2
    return information, slopes, news[:, :, 0]


def _down(whitened: Whitened, values: Column, step: Column, news: Column, bounds: Bounds) -> tuple[Column, Column]:
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
