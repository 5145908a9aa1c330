"""A first-order lag driven by commands that are held, exact: its value and its integral at any instant."""

from typing import NamedTuple

import numpy as np

from groundstation.analysis.identify.seen import Column

LEAST_LAG_S = 1e-5
"""A shorter lag is none [s]."""


class Lagged(NamedTuple):
    """x˙ = (u - x)/τ, with u held from each instant to the next."""

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
        area: Column = self.area[index] + held * since + (self.before[index] - held) * (self.lag_s * (1.0 - left))
        return area

    def _since(self, time_s: Column) -> tuple["np.ndarray[tuple[int, ...], np.dtype[np.int64]]", Column, Column]:
        """Which command is held, for how long, and how much of the start is left then."""
        index = np.clip(np.searchsorted(self.at_s, time_s, side="right") - 1, 0, None)
        since = np.maximum(time_s - self.at_s[index], 0.0)
        left = np.exp(-since / self.lag_s) if self.lag_s > LEAST_LAG_S else np.zeros_like(since)
        shape = since.shape + (1,) * (self.held.ndim - 1)
        return index, since.reshape(shape), left.reshape(shape)


def lagged(sent_s: Column, held: Column, delay_s: float, lag_s: float) -> Lagged:
    """The response to commands ``held`` (M, …) that left at ``sent_s`` (M,) [s], begun at rest on the first."""
    spans = np.diff(sent_s)
    left = np.exp(-spans / lag_s) if lag_s > LEAST_LAG_S else np.zeros_like(spans)
    before, value = [held[0]], held[0]
    for u, keep in zip(held[:-1], left.tolist(), strict=True):
        value = u + (value - u) * keep
        before.append(value)
    start = np.array(before)
    wide = (slice(None),) + (None,) * (held.ndim - 1)
    grown = held[:-1] * spans[wide] + (start[:-1] - held[:-1]) * (lag_s * (1.0 - left))[wide]
    area = np.concatenate([np.zeros_like(held[:1]), np.cumsum(grown, axis=0)])
    return Lagged(sent_s + delay_s, held, lag_s, start, area)
