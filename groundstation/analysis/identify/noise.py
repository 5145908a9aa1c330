"""How noisy poses are, by fourth differences of what the model leaves of them: all that is smooth cancels."""

from typing import NamedTuple

import numpy as np

from groundstation.analysis.identify.seen import Column

BLOCK = 50
"""Variances of so many samples in a row count as one: neighbours hang together."""
UNEVEN = 0.1
"""Poses whose intervals differ by more than this share are left out."""


class Level(NamedTuple):
    """Standard deviation per axis, and one deviation of that figure."""

    value: float
    deviation: float


def level(at_s: Column, left: Column) -> Level:
    """Of the noise in ``left`` (N, k), sampled at ``at_s`` (N,) [s]; infinite deviation where there is too little."""
    spans = np.diff(at_s)
    usual = float(np.median(spans))
    even = np.abs(spans - usual) < UNEVEN * usual
    runs = even[:-3] & even[1:-2] & even[2:-1] & even[3:]
    # Independent noise has 1 + 16 + 36 + 16 + 1 times its variance in these; see control/observer.py.
    squares = (np.diff(left, 4, axis=0)[runs] ** 2).mean(axis=1) / 70.0
    blocks = len(squares) // BLOCK
    if blocks < 3:
        return Level(0.0, np.inf)
    means = squares[: blocks * BLOCK].reshape(blocks, BLOCK).mean(axis=1)
    value = float(np.sqrt(means.mean()))
    deviation = float(means.std(ddof=1) / np.sqrt(blocks)) / max(2.0 * value, 1e-12)
    return Level(value, deviation)
