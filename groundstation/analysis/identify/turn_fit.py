"""Turn fit: lags and delays of body rates, from how attitude follows the commanded body rates.

The turn between two poses, in the body's frame, is the integral of the body rates. Summed up, the measured turns and
those of the commands through lag and delay differ by the attitude's noise and by whatever else turned the vehicle.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from groundstation.analysis.identify.fit import (
    COARSE,
    FINE,
    Bounds,
    Fit,
    InnovationFilter,
    Whiten,
    design_filter,
    fit_noise,
    minimize,
)
from groundstation.analysis.identify.stretch import Column, FlightStretch, components
from groundstation.core.geometry import arrays, so3

LEAST_LAG_S = 1e-5
"""A shorter lag is none [s]."""


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
        area: Column = self.area[index] + held * since + (self.before[index] - held) * (self.lag_s * (1.0 - left))
        return area

    def _since(self, time_s: Column) -> tuple["np.ndarray[tuple[int, ...], np.dtype[np.int64]]", Column, Column]:
        """Which command is held, for how long, and how much of the start is left then."""
        index = np.clip(np.searchsorted(self.at_s, time_s, side="right") - 1, 0, None)
        since = np.maximum(time_s - self.at_s[index], 0.0)
        left = np.exp(-since / self.lag_s) if self.lag_s > LEAST_LAG_S else np.zeros_like(since)
        shape = since.shape + (1,) * (self.held.ndim - 1)
        return index, since.reshape(shape), left.reshape(shape)


def _follow(held: Column, left: Column, first: Column) -> Column:
    """What x becomes by x ← u + (x - u) ``left`` with each u of ``held`` (M, …), from ``first`` on, (M, …)."""
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
    """The response to commands ``held`` (M, …) that left at ``sent_s`` (M,) [s], begun at rest on the first."""
    spans = np.diff(sent_s)
    left = np.exp(-spans / lag_s) if lag_s > LEAST_LAG_S else np.zeros_like(spans)
    wide = (slice(None),) + (None,) * (held.ndim - 1)
    start = np.concatenate([held[:1], _follow(held[:-1], np.broadcast_to(left[wide], held[:-1].shape), held[0])])
    grown = held[:-1] * spans[wide] + (start[:-1] - held[:-1]) * (lag_s * (1.0 - left))[wide]
    area = np.concatenate([np.zeros_like(held[:1]), np.cumsum(grown, axis=0)])
    return LagResponse(sent_s + delay_s, held, lag_s, start, area)


GAP_POSES = 3.5
"""After so many missing poses the turns begin anew: a long turn is no sum of its parts."""
ABOUT = (0.1, 10.0, 0.0)
"""Where the search for the noises begins: white noise on body rates [1/s], and on their change [1/s³]."""
DELAYS_S = (-0.01, 0.0, 0.015, 0.03, 0.06, 0.1, 0.15)
LAGS_S = (0.01, 0.03, 0.06, 0.1, 0.16)
"""Where the fit may begin."""
NAMES = ("delay", "roll_lag", "pitch_lag", "yaw_delay", "yaw_lag")
"""Parameters [s]; the first delay is of roll and pitch."""
LEAST = np.array([-0.05, 0.0, 0.0, -0.05, 0.0])
MOST = np.array([0.5, 1.0, 1.0, 0.5, 1.0])


class TurnFit(NamedTuple):
    """How the vehicle turns."""

    fit: Fit
    """Of :data:`groundstation.analysis.identify.turn_fit.NAMES`."""
    turns: Column
    """Measured turn from each pose to the next, (N-1, 3) [rad]."""
    modelled: Column
    """The same of the model [rad]."""

    @property
    def left(self) -> Column:
        """What the model leaves of the measured turns, summed up, (N, 3) [rad]."""
        return np.concatenate([np.zeros((1, 3)), np.cumsum(self.turns - self.modelled, axis=0)])


def turns(attitude: Column) -> Column:
    """Rotation vector from each of the attitudes (N, 4) to the next, in the body's frame, (N-1, 3) [rad]."""
    before, after = components(attitude[:-1]), components(attitude[1:])
    return np.stack(so3.rotation_vector(so3.multiply(so3.conjugate(before), after), arrays()), axis=1)


def angles(seen: FlightStretch, values: Column, time_s: Column) -> Column:
    """Integral of each body rate of the model from the first command to ``time_s`` (…,), (…, 3) [rad]."""
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
        """What each set of parameters leaves, (N, 3, S)."""
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
    bounds = Bounds(LEAST, MOST, np.full(5, 2e-4), values, np.full(5, np.inf))
    fit = None
    for about, powers in ((ABOUT, (COARSE, FINE)), (None, (FINE,))):
        noise, filter_ = fit_noise(seen.at_s, left([values])[:, :, 0], about or noise.ratios, gap, powers)
        fit = minimize(whiten_by(filter_, noise.variance), values, bounds, interval)
        values = fit.values
    assert fit is not None, "fitted twice"
    fit = fit.widen(
        minimize(whiten_by(design_filter(seen.at_s, noise.reweigh(), gap), noise.variance), values, bounds, interval)
    )
    return TurnFit(fit, measured, np.diff(angles(seen, values, seen.at_s), axis=0))
