"""A decision from any controller: its command brought within the vehicle's limits, and what screens show of it."""

import math

from groundstation.core.geometry import FLOATS, Vec3
from groundstation.core.messages import Decision, Diagnostics, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Drive, Vehicle

ZERO: Vec3 = (0.0, 0.0, 0.0)


def limited(vehicle: Vehicle, thrust_n: float, rates_rad_s: Vec3) -> tuple[Drive, bool]:
    """The command within the vehicle's limits, and whether any of the four had to be clamped."""
    clamp, (x, y, z) = FLOATS.clamp, rates_rad_s
    a, b, c = (math.radians(limit) for limit in vehicle.rate_limits_deg_s)
    thrust = clamp(thrust_n, vehicle.thrust_min_n, vehicle.thrust_max_n)
    rates = (clamp(x, -a, a), clamp(y, -b, b), clamp(z, -c, c))
    return Drive(thrust, rates), thrust != thrust_n or rates != rates_rad_s


def decided(
    vehicle: Vehicle,
    estimate: Estimate,
    reference: Reference,
    thrust_n: float,
    rates_rad_s: Vec3,
    *,
    wanted: Vec3 = ZERO,
    disturbance: Vec3 | None = None,
) -> Decision:
    """A decision for this command, which is brought within the vehicle's limits.

    Args:
        vehicle: the vehicle as told; its limits apply.
        estimate: what the controller went by.
        reference: what it followed.
        thrust_n: wanted thrust [N].
        rates_rad_s: wanted body rates [rad/s, FRD].
        wanted: the acceleration behind them [m/s², NED], for records.
        disturbance: the disturbance the controller works with [m/s², NED]; without it, the observer's.
    """
    drive, saturated = limited(vehicle, thrust_n, rates_rad_s)
    motion = estimate.motion
    return Decision(
        drive,
        saturated,
        Diagnostics(
            z1=_difference(motion.position, reference.position_ned),
            z2=_difference(motion.velocity, reference.velocity_ned),
            z3=ZERO,
            u_star=wanted,
            b_hat=estimate.disturbance if disturbance is None else disturbance,
            b_hat_dot=ZERO,
            disturbance=estimate.disturbance,
            v_terms=ZERO,
            w_terms=ZERO,
            v_known=0.0,
            w=0.0,
            certificate="none: this controller comes without a Lyapunov function",
            rates_wanted=rates_rad_s,
        ),
    )


def _difference(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
