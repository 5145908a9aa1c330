"""Thrust by its signal, where curve and scale are not as told. The curve is links/core/thrust_curve.py's."""

import numpy as np

from groundstation.analysis.identify.seen import Column
from groundstation.settings.settings import Config
from links.core.thrust_curve import signal, thrust


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
