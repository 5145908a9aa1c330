"""The vehicle as the controller believes it: rolled forward in time under one held command.

(1), (2) of the paper with first-order lags on thrust and body rates. Elementwise: floats, or arrays (N,).
"""

from typing import NamedTuple

from groundstation.ops import Ops, Quat, Real, Vec3
from groundstation.so3 import turned

new = tuple.__new__
"""Makes a named tuple in a third to a half of the time that its own name takes; this runs some five times a command."""


class Motion(NamedTuple):
    """Position and velocity [m, m/s, NED], attitude, thrust [N] and body rates [rad/s, FRD]."""

    position: Vec3
    velocity: Vec3
    attitude: Quat
    thrust: Real
    rates: Vec3


class Drive(NamedTuple):
    """A command as the actuators take it: thrust [N] and body rates [rad/s, FRD]."""

    thrust: Real
    rates: Vec3


def rolled(
    ops: Ops,
    motion: Motion,
    drive: Drive,
    duration: Real,
    *,
    mass: Real,
    gravity: float,
    disturbance: Vec3,
    thrust_lag: float,
    rate_lag: float,
) -> Motion:
    """``motion`` after ``duration`` [s] of ``drive`` and a constant ``disturbance`` [m/s², NED].

    The lags are exact; attitude turns by the exact integral of the rates; translation uses the mean thrust
    along the attitude at mid-step, so the error is of third order in ``duration`` (keep it below 25 ms).
    """
    h = duration
    half = 0.5 * h
    # approach() of actuators.py, written out like third_column() below: this runs four times a command.
    exp = ops.exp
    rate_rise = 1.0 - exp(-h / rate_lag) if rate_lag > 0.0 else 1.0
    half_rise = 1.0 - exp(-half / rate_lag) if rate_lag > 0.0 else 1.0
    thrust_rise = rate_rise
    if thrust_lag != rate_lag:
        thrust_rise = 1.0 - exp(-h / thrust_lag) if thrust_lag > 0.0 else 1.0
    (wx, wy, wz), (cx, cy, cz) = motion.rates, drive.rates
    dx, dy, dz = cx - wx, cy - wy, cz - wz
    # ∫ω = h ω_c - (h - ... ) : the lagged part has integral τ (1 - e^(-h/τ)).
    lagged = rate_lag * rate_rise
    ax, ay, az = h * cx - lagged * dx, h * cy - lagged * dy, h * cz - lagged * dz
    half_lagged = rate_lag * half_rise
    attitude = motion.attitude
    w, x, y, z = turned(
        attitude, (half * cx - half_lagged * dx, half * cy - half_lagged * dy, half * cz - half_lagged * dz)
    )
    d_thrust = drive.thrust - motion.thrust
    mean_thrust = drive.thrust - d_thrust * (thrust_lag * thrust_rise / h)
    f = -mean_thrust / mass
    accel_x = f * (2.0 * (x * z + w * y)) + disturbance[0]
    accel_y = f * (2.0 * (y * z - w * x)) + disturbance[1]
    accel_z = f * (1.0 - 2.0 * (x * x + y * y)) + gravity + disturbance[2]
    (px, py, pz), (vx, vy, vz) = motion.position, motion.velocity
    k = half * h
    after = (
        (px + h * vx + k * accel_x, py + h * vy + k * accel_y, pz + h * vz + k * accel_z),
        (vx + h * accel_x, vy + h * accel_y, vz + h * accel_z),
        turned(attitude, (ax, ay, az)),
        motion.thrust + thrust_rise * d_thrust,
        (wx + rate_rise * dx, wy + rate_rise * dy, wz + rate_rise * dz),
    )
    return new(Motion, after)
