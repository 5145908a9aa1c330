"""Thrust to motor signal: thrust = f u² + (1 - f) u, both 0..1.

This is how PX4 (THR_MDL_FAC) and ArduPilot (MOT_THST_EXPO) define it.
An autopilot that has its own curve set takes thrust and inverts the curve itself: then f is 0 here.

How many newtons the full signal gives is known best from hovering: the signal that carries the vehicle stands in
the autopilot's log (PX4: MPC_THR_HOVER; ArduPilot: MOT_THST_HOVER), while data sheets tell of motors on a bench.
"""

import math


def signal(thrust: float, factor: float) -> float:
    """The signal u in 0..1 that gives ``thrust`` (clamped to 0..1) on the curve with f = ``factor`` (0..1)."""
    if thrust <= 0.0:
        return 0.0
    if thrust >= 1.0:
        return 1.0
    linear = 1.0 - factor
    # The root of f u² + (1 - f) u - thrust = 0 in the form that also holds for f = 0.
    return 2.0 * thrust / (linear + math.sqrt(linear * linear + 4.0 * factor * thrust))


def thrust(signal_: float, factor: float) -> float:
    """The thrust 0..1 that the signal ``signal_`` (0..1) gives: the inverse of :func:`signal`."""
    return factor * signal_ * signal_ + (1.0 - factor) * signal_


def full_thrust_n(weight_n: float, hover: float, factor: float) -> float:
    """Thrust of the full signal [N], where the signal ``hover`` (0..1, not 0) carries ``weight_n`` [N]."""
    return weight_n / thrust(hover, factor)
