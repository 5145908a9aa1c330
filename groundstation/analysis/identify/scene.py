"""Translation model of identification: how the vehicle moves under the commands that left; pushing.py fits it.

Thrust goes by its signal, where curve and scale are not as told. The curve is links/core/thrust_curve.py's.
"""

from typing import Any

import numpy as np

from groundstation.analysis.identify.lagged import lagged
from groundstation.analysis.identify.seen import Column, Seen
from groundstation.analysis.identify.turning import Turning, angles
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
NAMES = ("delay", "lag", "scale", "sag", "curve", "drag", "leak", "c_x", "c_y", "c_z")
"""Parameters: delay, lag [s], scale [-], sag [1/min], curve [-], drag [1/s], leak l [m/s² per rad/s], c [m, FRD]."""
LEVER = 7
"""c is the last three of them."""
SMOOTH_S = 0.06
"""Attitudes are smoothed over this time to either side [s]: their noise, which the controller answers, would pass for
thrust."""
UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Scene:
    """What does not change while thrust is fitted."""

    def __init__(self, seen: Seen, turned: Turning) -> None:
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
        delay, *lags = turned.fit.values.tolist()
        reach = max(1, round(SMOOTH_S / float(np.median(self.spans))))
        off = smoothed(turned.left, reach) - turned.left
        since = angles(seen, delay, lags, self.times) - angles(seen, delay, lags, seen.at_s[:-1])[:, None]
        since = since + np.diff(turned.left + off, axis=0)[:, None] * share[:, None]
        attitude: Any = so3.turned(_columns(seen.attitude), _columns(off))
        self.axes = np.stack([np.stack(so3.to_world(attitude, unit), axis=-1) for unit in UNITS], axis=-1)
        started: Any = tuple(part[:-1, None] for part in attitude)
        turn: Any = tuple(np.moveaxis(since, -1, 0))
        down: Any = so3.third_column(so3.turned(started, turn))
        self.down = np.stack(down, axis=-1)
        rates = turned.turns / self.spans[:, None]
        self.sideways = self.axes[:-1, :, 0] * rates[:, 1:2] - self.axes[:-1, :, 1] * rates[:, :1]
        self.velocity = np.diff(seen.position_ned, axis=0) / self.spans[:, None]

    def accelerations(self, values: Column) -> Column:
        """The model's, without wind and gravity, (N-1, STEPS, 3) [m/s²]."""
        delay, lag, scale, sag, curve, drag, leak = values[:LEVER].tolist()
        fading = 1.0 - sag * (self.seen.sent_s - self.middle_s) / 60.0
        held = scale / self.mass * fading * thrust_n(self.seen.config, self.mean, curve, self.signals)
        # The mean over each step, exact however thrust jumps within it.
        areas = np.diff(lagged(self.seen.sent_s, held, delay, lag).integral(self.edges), axis=1)
        pushed = areas * STEPS / self.spans[:, None]
        rest = leak * self.sideways - drag * self.velocity
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

    def placed(self, values: Column) -> Column:
        """Positions less what the model has moved the vehicle since the first pose, (N, 3) [m]."""
        far, fast = np.moveaxis(self.pushes(values), 1, 0)
        speed = np.cumsum(fast, axis=0)
        moved = far.copy()
        moved[1:] += self.spans[:, None] * speed[:-1]
        placed: Column = self.position(values) - np.cumsum(moved, axis=0)
        return placed


def smoothed(values: Column, reach: int) -> Column:
    """Means of ``values`` (N, k) over ``reach`` samples to either side, over fewer towards the ends."""
    at = np.arange(len(values))
    near = np.minimum(np.minimum(at, at[::-1]), reach)
    sums = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
    means: Column = (sums[at + near + 1] - sums[at - near]) / (2 * near + 1)[:, None]
    return means


def _columns(rows: Column) -> Any:
    return tuple(rows.T)
