"""Corrections that one pose makes to the modelled state. Pure and elementwise, per axis.

The observer is p̂, v̂ (and d̂, for composite adaptation) driven by the model's acceleration and corrected by
the innovation i = p_measured - p̂ of each pose: p̂ += L1 i, v̂ += (L2/dt) i, d̂ += (L3/dt²) i.
"""

from groundstation.control.ops import Ops, Quat, Real, Vec3
from groundstation.so3 import conjugate, multiply, rotation_vector, turned


def innovation(measured: Vec3, predicted: Vec3) -> Vec3:
    """i = measured - predicted [m]."""
    return (measured[0] - predicted[0], measured[1] - predicted[1], measured[2] - predicted[2])


def corrected(value: Vec3, gain: Real, step: Vec3) -> Vec3:
    """``value`` moved by ``gain`` times the innovation."""
    return (value[0] + gain * step[0], value[1] + gain * step[1], value[2] + gain * step[2])


def corrected_attitude(ops: Ops, predicted: Quat, measured: Quat, gain: float) -> Quat:
    """The predicted attitude turned by ``gain`` (0..1) of the way to the measured one; 1 takes the measurement."""
    if gain >= 1.0:
        return measured
    x, y, z = rotation_vector(multiply(conjugate(predicted), measured), ops)
    return turned(predicted, (gain * x, gain * y, gain * z), ops)
