"""The vehicle as the controller believes it: rolled forward in time under one held command.

(1), (2) of the paper with first-order lags on thrust and body rates. Elementwise: floats, or arrays (N,).
"""

from typing import NamedTuple

from groundstation.control.actuators import approach
from groundstation.ops import Ops, Quat, Real, Vec3
from groundstation.so3 import third_column, turned


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
    rate_rise = approach(ops, h, rate_lag)
    thrust_rise = rate_rise if thrust_lag == rate_lag else approach(ops, h, thrust_lag)
    (wx, wy, wz), (cx, cy, cz) = motion.rates, drive.rates
    dx, dy, dz = cx - wx, cy - wy, cz - wz
    # ∫ω = h ω_c - (h - ... ) : the lagged part has integral τ (1 - e^(-h/τ)).
    lagged = rate_lag * rate_rise
    ax, ay, az = h * cx - lagged * dx, h * cy - lagged * dy, h * cz - lagged * dz
    half_lagged = rate_lag * approach(ops, half, rate_lag)
    attitude = motion.attitude
    middle = turned(
        attitude, (half * cx - half_lagged * dx, half * cy - half_lagged * dy, half * cz - half_lagged * dz)
    )
    d_thrust = drive.thrust - motion.thrust
    mean_thrust = drive.thrust - d_thrust * (thrust_lag * thrust_rise / h)
    ux, uy, uz = third_column(middle)
    f = -mean_thrust / mass
    accel_x = f * ux + disturbance[0]
    accel_y = f * uy + disturbance[1]
    accel_z = f * uz + gravity + disturbance[2]
    (px, py, pz), (vx, vy, vz) = motion.position, motion.velocity
    k = half * h
    return Motion(
        (px + h * vx + k * accel_x, py + h * vy + k * accel_y, pz + h * vz + k * accel_z),
        (vx + h * accel_x, vy + h * accel_y, vz + h * accel_z),
        turned(attitude, (ax, ay, az)),
        motion.thrust + thrust_rise * d_thrust,
        (wx + rate_rise * dx, wy + rate_rise * dy, wz + rate_rise * dz),
    )
