"""Thrust fit: scale, curve and lag of thrust, and drag, from how position follows thrust along the measured attitude.

    p¨ = -(1 - s t) λ T/m · R e3 - k v + R (l ω2, -l ω1, 0) + g e3 + wind        measured: p + R c + noise

T is the told thrust through curve, delay and lag; λ its scale at mid-flight, s how it sags in time. The wind is white
noise's integral (fit.py), so that only what is faster than it tells of thrust. Two things are found only so that
they pass for nothing else: c, how far the tracked point is from the centre of mass (2 cm pass for 8 % of thrust at
1 Hz), and l, which takes up rotors that are not centred and attitudes that are not of the positions' instant.

Thrust goes by its signal, where curve and scale are not as told. The curve is links/core/deadman.py's.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from groundstation.analysis.identify.fit import (
    COARSE,
    FINE,
    Bounds,
    Fit,
    InnovationFilter,
    Noise,
    Ratios,
    Whiten,
    fit_noise,
    minimize,
)
from groundstation.analysis.identify.stretch import Column, FlightStretch, components
from groundstation.analysis.identify.turn_fit import TurnFit, angles, respond_with_lag
from groundstation.core.geometry import so3
from groundstation.settings import Config
from links.core import signal, thrust


def thrust_n(config: Config, about: float, curve: float, signals: Column) -> Column:
    """Thrust at ``signals`` 0..1 on the curve with f = ``curve`` that agrees with ``config`` at the one ``about`` [N].

    So the scale, which multiplies it, is of the thrust about which the vehicle flew, whatever the curve.
    """
    told = config.full_thrust_n * thrust(about, config.thrust_curve)
    pushed: Column = told / thrust(about, curve) * (curve * signals * signals + (1.0 - curve) * signals)
    return pushed


def full_n(config: Config, about: float, scale: float, curve: float) -> float:
    """Thrust of the full signal [N]."""
    return scale * float(thrust_n(config, about, curve, np.array(1.0)))


def hover_signal(config: Config, about: float, scale: float, curve: float) -> float:
    """The signal 0..1 that carries the vehicle."""
    return signal(config.weight_n / full_n(config, about, scale, curve), curve)


def most_n(config: Config, about: float, scale: float, curve: float) -> float:
    """What the signal really gives that was told to give ``vehicle.thrust_max_n`` [N]."""
    most = signal(config.vehicle.thrust_max_n / config.full_thrust_n, config.thrust_curve)
    return scale * float(thrust_n(config, about, curve, np.array(most)))


STEPS = 5
"""Between two poses thrust and attitude are looked at so often."""
DRAGS = ("drag_x", "drag_y", "drag_z")
NAMES = ("delay", "lag", "scale", "sag", "curve", *DRAGS, "leak", "c_x", "c_y", "c_z")
"""Parameters: delay, lag [s], scale [-], sag [1/min], curve [-], drag along each axis of the body [1/s], leak l
[m/s² per rad/s], c [m, FRD]."""
DRAG, LEVER = NAMES.index("drag_x"), NAMES.index("c_x")
"""Drag and c are three each."""
SMOOTH_S = 0.06
"""Attitudes are smoothed over this time to either side [s]: their noise, which the controller answers, would pass for
thrust."""
UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class ThrustModel:
    """How the vehicle moves under the commands that left; holds what does not change while thrust is fitted."""

    def __init__(self, seen: FlightStretch, turned: TurnFit) -> None:
        """Attitudes between the poses, from the fitted turns pinned to the measured ones at both ends."""
        self.seen = seen
        self.mass = seen.config.vehicle.mass_kg
        full, told = seen.config.full_thrust_n, seen.config.thrust_curve
        self.signals = np.array([signal(newtons / full, told) for newtons in seen.thrust_n.tolist()])
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
        self.axes = np.stack([np.stack(so3.to_world(attitude, unit), axis=-1) for unit in UNITS], axis=-1)
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
        held = scale / self.mass * fading * thrust_n(self.seen.config, self.mean, curve, self.signals)
        # The mean over each step, exact however thrust jumps within it.
        areas = np.diff(respond_with_lag(self.seen.sent_s, held, delay, lag).integral(self.edges), axis=1)
        pushed = areas * STEPS / self.spans[:, None]
        along = np.einsum("nij,ni->nj", self.axes[:-1], self.velocity)  # in the body's axes
        rest = leak * self.sideways - np.einsum("nij,nj->ni", self.axes[:-1], along * np.array(drag))
        acceleration: Column = rest[:, None] - pushed[..., None] * self.down
        return acceleration

    def pushes(self, values: Column) -> Column:
        """What the model adds to position and velocity before each pose, (N, 2, 3)."""
        acceleration = self.accelerations(values)
        h = self.spans / STEPS
        left = self.spans[:, None] * (1.0 - (np.arange(STEPS) + 0.5) / STEPS)
        fast = acceleration.sum(axis=1) * h[:, None]
        far = (acceleration * left[..., None]).sum(axis=1) * h[:, None]
        both = np.stack([far, fast], axis=1)
        return np.concatenate([np.zeros((1, 2, 3)), both])

    def position(self, values: Column) -> Column:
        """Of the centre of mass, as measured, (N, 3) [m]."""
        position: Column = self.seen.position_ned - self.axes @ values[LEVER:]
        return position

    def remove_motion(self, values: Column) -> Column:
        """Positions less what the model has moved the vehicle since the first pose, (N, 3) [m]."""
        far, fast = np.moveaxis(self.pushes(values), 1, 0)
        speed = np.cumsum(fast, axis=0)
        moved = far.copy()
        moved[1:] += self.spans[:, None] * speed[:-1]
        placed: Column = self.position(values) - np.cumsum(moved, axis=0)
        return placed


def smooth(values: Column, reach: int) -> Column:
    """Means of ``values`` (N, k) over ``reach`` samples to either side, over fewer towards the ends."""
    at = np.arange(len(values))
    near = np.minimum(np.minimum(at, at[::-1]), reach)
    sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    means: Column = (sums[at + near + 1] - sums[at - near]) / (2 * near + 1)[:, None]
    return means


GAP_S = 0.3
"""After a longer gap between poses the positions begin anew [s]."""
ABOUT = (0.0, 1e2, 1e5)
"""Where the search for the noises begins: white noise on acceleration [1/s³], and on the wind's change [1/s⁵], over the
positions' variance."""
LAGS_S = (0.01, 0.03, 0.06, 0.1, 0.16)
"""Where the fit may begin."""
LEAST = np.array([-0.05, 0.0, 0.2, -0.5, -0.5, *[-2.0] * 3, -1.0, *[-0.5] * 3])
MOST = np.array([0.5, 1.0, 4.0, 0.5, 1.5, *[5.0] * 3, 1.0, *[0.5] * 3])
MOVED = np.array([2e-4, 2e-4, 1e-3, 1e-3, 1e-2, *[1e-3] * 3, 1e-3, *[1e-3] * 3])
ROUNDS = 6
"""Model and noise are fitted in turn, so often at most: the better the model, the weaker the noise that is left."""
SAG_PER_MIN = 0.1
"""A battery's thrust falls by about so much in a minute, one deviation [-]."""


Strength: TypeAlias = tuple[Noise, InnovationFilter]
"""Of noise and wind, and the filter for them."""


class ThrustFit(NamedTuple):
    """How the vehicle is pushed."""

    fit: Fit
    """Of :data:`groundstation.analysis.identify.thrust_fit.NAMES`."""
    about: float
    """The signal about which the scale holds, 0 to 1: the mean of the flight."""
    left: Column
    """Positions less what the model has moved the vehicle since the first pose, (N, 3) [m]."""


def fit_thrust(seen: FlightStretch, turned: TurnFit) -> ThrustFit:
    """Fit thrust and drag to the positions that were ``seen``; the search for delay begins about that of the turns."""
    scene = ThrustModel(seen, turned)
    vehicle = seen.config.vehicle
    delay = float(turned.fit.values[0])
    spread = np.full(len(NAMES), np.inf)
    spread[NAMES.index("sag")] = SAG_PER_MIN
    values = np.array([delay, vehicle.thrust_lag_s, 1.0, 0.0, seen.config.thrust_curve, *[0.0] * (len(NAMES) - 5)])
    bounds = Bounds(LEAST, MOST, MOVED, np.array([delay, *[0.0] * (len(NAMES) - 1)]), spread)
    interval = float(np.median(scene.spans))

    def noises(values: Column, level: Ratios, upright: Ratios, *powers: Column) -> tuple[Strength, Strength]:
        left = scene.remove_motion(values)
        return (
            fit_noise(seen.at_s, left[:, :2], level, GAP_S, powers),
            fit_noise(seen.at_s, left[:, 2:], upright, GAP_S, powers),
        )

    def whiten_by(level: Strength, upright: Strength) -> Whiten:
        def whiten(sets: Sequence[Column]) -> Column:
            pushes = np.stack([scene.pushes(one) for one in sets], axis=-1)
            place = np.stack([scene.position(one) for one in sets], axis=-1)
            news = []
            for axes, (noise, filter_) in ((slice(0, 2), level), (slice(2, 3), upright)):
                part = place[:, axes].reshape(len(place), -1)
                new, _ = filter_.innovations(part, pushes[:, :, axes].reshape(len(place), 2, -1))
                news.append(new.reshape(len(place), -1, len(sets)) / np.sqrt(noise.variance))
            return np.concatenate(news, axis=1)

        return whiten

    level, upright = noises(values, ABOUT, ABOUT, COARSE, FINE)
    starts = [
        np.array([late, lag, scale, *values[3:]])
        for late in sorted({0.0, 0.5 * delay, delay})
        for lag in LAGS_S
        for scale in (0.8, 0.9, 1.0, 1.1)
    ]
    news = whiten_by(level, upright)(starts)
    values = starts[int((news**2).sum(axis=(0, 1)).argmin())]
    fit, about = None, (ABOUT, ABOUT)
    powers: tuple[Column, ...] = (COARSE, FINE)
    for _ in range(ROUNDS):
        level, upright = noises(values, *about, *powers)
        # By what was seen before: a velocity that knows the gust to come would take it for drag.
        _, halfway = level[1].innovations(scene.position(values), scene.pushes(values))
        scene.velocity = halfway[:-1]
        fit = minimize(whiten_by(level, upright), values, bounds, interval)
        values = fit.values
        if (level[0].ratios, upright[0].ratios) == about:
            break
        about, powers = (level[0].ratios, upright[0].ratios), (FINE,)
    assert fit is not None, "fitted at least once"
    return ThrustFit(fit, scene.mean, scene.remove_motion(values))
