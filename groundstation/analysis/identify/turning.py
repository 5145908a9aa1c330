"""Rate lags and transport delay, from how attitude follows the commanded body rates. And the attitude's noise.

The turn between two poses, in the body's frame, is the integral of the body rates. Summed up, the measured turns and
those of the commands through lag and delay differ by the attitude's noise and by whatever else turned the vehicle.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from groundstation.analysis.identify.fit import COARSE, FINE, Bounds, Filter, Fit, Whitened, fitted, solved
from groundstation.analysis.identify.lagged import lagged
from groundstation.analysis.identify.seen import Column, Seen
from groundstation.core.geometry import Quat, arrays, so3

GAP_POSES = 3.5
"""After so many missing poses the turns begin anew: a long turn is no sum of its parts."""
ABOUT = (0.1, 10.0, 0.0)
"""Where the search for the noises begins: white noise on body rates [1/s], and on their change [1/s³]."""
DELAYS_S = (-0.01, 0.0, 0.015, 0.03, 0.06, 0.1, 0.15)
LAGS_S = (0.01, 0.03, 0.06, 0.1, 0.16)
"""Where the fit may begin."""
LEAST = np.array([-0.05, 0.0, 0.0, 0.0])
MOST = np.array([0.5, 1.0, 1.0, 1.0])


class Turning(NamedTuple):
    """How the vehicle turns."""

    fit: Fit
    """Of delay, and lags of roll, pitch and yaw rate [s]."""
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
    before, after = _quat(attitude[:-1]), _quat(attitude[1:])
    return np.stack(so3.rotation_vector(so3.multiply(so3.conjugate(before), after), arrays()), axis=1)


def _quat(rows: Column) -> Quat:
    w, x, y, z = rows.T
    return (w, x, y, z)


def angles(seen: Seen, delay_s: float, lags_s: Sequence[float], time_s: Column) -> Column:
    """Integral of each body rate of the model from the first command to ``time_s`` (…,), (…, 3) [rad]."""
    parts = [
        lagged(seen.sent_s, seen.rates_rad_s[:, axis], delay_s, lag).integral(time_s) for axis, lag in enumerate(lags_s)
    ]
    return np.stack(parts, axis=-1)


def turning(seen: Seen) -> Turning:
    """Fit delay and lags to the attitudes that were ``seen``."""
    measured = turns(seen.attitude)
    summed = np.concatenate([np.zeros((1, 3)), np.cumsum(measured, axis=0)])
    interval = float(np.median(np.diff(seen.at_s)))
    gap = GAP_POSES * interval

    def left(sets: Sequence[Column]) -> Column:
        """What each set of parameters leaves, (N, 3, S)."""
        return np.stack([summed - _angles(seen, values) for values in sets], axis=-1)

    def whitened_by(filter_: Filter, variance: float) -> Whitened:
        def whitened(sets: Sequence[Column]) -> Column:
            rest = left(sets)
            news, _ = filter_.innovations(rest.reshape(len(rest), -1))
            shaped: Column = news.reshape(rest.shape) / math.sqrt(variance)
            return shaped

        return whitened

    first = np.array([0.0, *[seen.config.vehicle.rate_lag_s] * 3])
    noise, filter_ = fitted(seen.at_s, left([first])[:, :, 0], ABOUT, gap)
    starts = [np.array([delay, lag, lag, lag]) for delay in DELAYS_S for lag in LAGS_S]
    news = whitened_by(filter_, 1.0)(starts)
    values = starts[int((news**2).sum(axis=(0, 1)).argmin())]
    bounds = Bounds(LEAST, MOST, np.full(4, 2e-4), values, np.full(4, np.inf))
    fit = None
    for about, powers in ((ABOUT, (COARSE, FINE)), (None, (FINE,))):
        noise, filter_ = fitted(seen.at_s, left([values])[:, :, 0], about or noise.ratios, gap, powers)
        fit = solved(whitened_by(filter_, noise.variance), values, bounds, interval)
        values = fit.values
    assert fit is not None, "fitted twice"
    return Turning(fit, measured, np.diff(_angles(seen, values), axis=0))


def _angles(seen: Seen, values: Column) -> Column:
    delay, *lags = values.tolist()
    return angles(seen, delay, lags, seen.at_s)
