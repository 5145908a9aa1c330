"""Response fits: how the vehicle turns, and how it is lifted, after what was commanded.

The turn between two poses, in the body's frame, is the integral of the body rates. Summed up, the measured turns and
those of the commands through lag and delay differ by the attitude's noise and by whatever else turned the vehicle.

Thrust fit: scale, curve and lag of thrust, and drag, from how position follows thrust along the measured attitude.

    p¨ = -(1 - s t) λ T/m · R e3 - k v + R (l ω2, -l ω1, 0) + g e3 + wind        measured: p + R c + noise

T is the told thrust through curve, delay and lag; λ its scale at mid-flight, s how it sags in time. The wind is white
noise's integral (fit.py), so that only what is faster than it tells of thrust. Two things are found only so that
they pass for nothing else: c, how far the tracked point is from the centre of mass (2 cm pass for 8 % of thrust at
1 Hz), and l, which takes up rotors that are not centred and attitudes that are not of the positions' instant.

Thrust goes by its signal, where curve and scale are not as told. The curve is links/core/deadman.py's.
"""

import math
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
    design_filter,
    fit_noise,
    minimize,
)
from groundstation.analysis.identify.stretch import Column, FlightStretch, components
from groundstation.core.geometry import arrays, so3
from groundstation.settings import Config
from links.core import signal, thrust

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
TURN_NAMES = ("delay", "roll_lag", "pitch_lag", "yaw_delay", "yaw_lag")
"""Parameters [s]; the first delay is of roll and pitch."""
LEAST = np.array([-0.05, 0.0, 0.0, -0.05, 0.0])
MOST = np.array([0.5, 1.0, 1.0, 0.5, 1.0])


class TurnFit(NamedTuple):
    """How the vehicle turns."""

    fit: Fit
    """Of :data:`TURN_NAMES`."""
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
THRUST_NAMES = ("delay", "lag", "scale", "sag", "curve", *DRAGS, "leak", "c_x", "c_y", "c_z")
"""Parameters: delay, lag [s], scale [-], sag [1/min], curve [-], drag along each axis of the body [1/s], leak l
[m/s² per rad/s], c [m, FRD]."""
DRAG, LEVER = THRUST_NAMES.index("drag_x"), THRUST_NAMES.index("c_x")
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
ABOUT_THRUST = (0.0, 1e2, 1e5)
"""Where the search for the noises begins: white noise on acceleration [1/s³], and on the wind's change [1/s⁵], over the
positions' variance."""
THRUST_LAGS_S = (0.01, 0.03, 0.06, 0.1, 0.16)
"""Where the fit may begin."""
LEAST_THRUST = np.array([-0.05, 0.0, 0.2, -0.5, -0.5, *[-2.0] * 3, -1.0, *[-0.5] * 3])
MOST_THRUST = np.array([0.5, 1.0, 4.0, 0.5, 1.5, *[5.0] * 3, 1.0, *[0.5] * 3])
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
    """Of :data:`THRUST_NAMES`."""
    about: float
    """The signal about which the scale holds, 0 to 1: the mean of the flight."""
    left: Column
    """Positions less what the model has moved the vehicle since the first pose, (N, 3) [m]."""


def fit_thrust(seen: FlightStretch, turned: TurnFit) -> ThrustFit:
    """Fit thrust and drag to the positions that were ``seen``; the search for delay begins about that of the turns."""
    scene = ThrustModel(seen, turned)
    vehicle = seen.config.vehicle
    delay = float(turned.fit.values[0])
    spread = np.full(len(THRUST_NAMES), np.inf)
    spread[THRUST_NAMES.index("sag")] = SAG_PER_MIN
    values = np.array(
        [delay, vehicle.thrust_lag_s, 1.0, 0.0, seen.config.thrust_curve, *[0.0] * (len(THRUST_NAMES) - 5)]
    )
    bounds = Bounds(LEAST_THRUST, MOST_THRUST, MOVED, np.array([delay, *[0.0] * (len(THRUST_NAMES) - 1)]), spread)
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

    level, upright = noises(values, ABOUT_THRUST, ABOUT_THRUST, COARSE, FINE)
    starts = [
        np.array([late, lag, scale, *values[3:]])
        for late in sorted({0.0, 0.5 * delay, delay})
        for lag in THRUST_LAGS_S
        for scale in (0.8, 0.9, 1.0, 1.1)
    ]
    news = whiten_by(level, upright)(starts)
    values = starts[int((news**2).sum(axis=(0, 1)).argmin())]
    fit, about = None, (ABOUT_THRUST, ABOUT_THRUST)
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
