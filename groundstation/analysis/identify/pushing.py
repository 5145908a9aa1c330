"""Thrust scale, curve and lag, and drag, from how position follows thrust along the measured attitude.

    p¨ = -(1 - s t) λ T/m · R e3 - k v + R (l ω2, -l ω1, 0) + g e3 + wind        measured: p + R c + noise

T is the told thrust through curve, delay and lag; λ its scale at mid-flight, s how it sags in time. The wind is white
noise's integral (whitening.py), so that only what is faster than it tells of thrust. Two things are found only so that
they pass for nothing else: c, how far the tracked point is from the centre of mass (2 cm pass for 8 % of thrust at
1 Hz), and l, which takes up rotors that are not centred and attitudes that are not of the positions' instant.
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from groundstation.analysis.identify.fit import (
    COARSE,
    FINE,
    Bounds,
    Filter,
    Fit,
    Noise,
    Ratios,
    Whitened,
    fitted,
    solved,
)
from groundstation.analysis.identify.scene import NAMES, Scene
from groundstation.analysis.identify.seen import Column, Seen
from groundstation.analysis.identify.turning import Turning

GAP_S = 0.3
"""After a longer gap between poses the positions begin anew [s]."""
ABOUT = (0.0, 1e2, 1e5)
"""Where the search for the noises begins: white noise on acceleration [1/s³], and on the wind's change [1/s⁵], over the
positions' variance."""
LAGS_S = (0.01, 0.03, 0.06, 0.1, 0.16)
"""Where the fit may begin."""
LEAST = np.array([-0.05, 0.0, 0.2, -0.5, -0.5, -2.0, -1.0, *[-0.5] * 3])
MOST = np.array([0.5, 1.0, 4.0, 0.5, 1.5, 5.0, 1.0, *[0.5] * 3])
MOVED = np.array([2e-4, 2e-4, 1e-3, 1e-3, 1e-2, 1e-3, 1e-3, *[1e-3] * 3])
ROUNDS = 6
"""Model and noise are fitted in turn, so often at most: the better the model, the weaker the noise that is left."""
SAG_PER_MIN = 0.1
"""A battery's thrust falls by about so much in a minute, one deviation [-]."""


Strength: TypeAlias = tuple[Noise, Filter]
"""Of noise and wind, and the filter for them."""


class Pushing(NamedTuple):
    """How the vehicle is pushed."""

    fit: Fit
    """Of :data:`groundstation.analysis.identify.scene.NAMES`."""
    about: float
    """The signal about which the scale holds, 0 to 1: the mean of the flight."""
    left: Column
    """Positions less what the model has moved the vehicle since the first pose, (N, 3) [m]."""


def pushing(seen: Seen, turned: Turning) -> Pushing:
    """Fit thrust and drag to the positions that were ``seen``; delay begins with that of the turns."""
    scene = Scene(seen, turned)
    vehicle = seen.config.vehicle
    delay = float(turned.fit.values[0])
    spread = np.full(len(NAMES), np.inf)
    spread[0], spread[3] = turned.fit.deviations[0], SAG_PER_MIN
    values = np.array([delay, vehicle.thrust_lag_s, 1.0, 0.0, seen.config.thrust_curve, *[0.0] * 5])
    bounds = Bounds(LEAST, MOST, MOVED, np.array([delay, *[0.0] * 9]), spread)
    interval = float(np.median(scene.spans))

    def noises(values: Column, level: Ratios, upright: Ratios, *powers: Column) -> tuple[Strength, Strength]:
        left = scene.placed(values)
        return (
            fitted(seen.at_s, left[:, :2], level, GAP_S, powers),
            fitted(seen.at_s, left[:, 2:], upright, GAP_S, powers),
        )

    def whitened_by(level: Strength, upright: Strength) -> Whitened:
        def whitened(sets: Sequence[Column]) -> Column:
            pushes = np.stack([scene.pushes(one) for one in sets], axis=-1)
            place = np.stack([scene.position(one) for one in sets], axis=-1)
            news = []
            for axes, (noise, filter_) in ((slice(0, 2), level), (slice(2, 3), upright)):
                part = place[:, axes].reshape(len(place), -1)
                new, _ = filter_.innovations(part, pushes[:, :, axes].reshape(len(place), 2, -1))
                news.append(new.reshape(len(place), -1, len(sets)) / np.sqrt(noise.variance))
            return np.concatenate(news, axis=1)

        return whitened

    level, upright = noises(values, ABOUT, ABOUT, COARSE, FINE)
    starts = [np.array([delay, lag, scale, *values[3:]]) for lag in LAGS_S for scale in (0.8, 0.9, 1.0, 1.1)]
    news = whitened_by(level, upright)(starts)
    values = starts[int((news**2).sum(axis=(0, 1)).argmin())]
    fit, about = None, (ABOUT, ABOUT)
    powers: tuple[Column, ...] = (COARSE, FINE)
    for _ in range(ROUNDS):
        level, upright = noises(values, *about, *powers)
        # By what was seen before: a velocity that knows the gust to come would take it for drag.
        _, halfway = level[1].innovations(scene.position(values), scene.pushes(values))
        scene.velocity = halfway[:-1]
        fit = solved(whitened_by(level, upright), values, bounds, interval)
        values = fit.values
        if (level[0].ratios, upright[0].ratios) == about:
            break
        about, powers = (level[0].ratios, upright[0].ratios), (FINE,)
    assert fit is not None, "fitted at least once"
    return Pushing(fit, scene.mean, scene.placed(values))
