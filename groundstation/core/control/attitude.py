"""Attitude control: from a wanted acceleration to thrust and body rates, and to a decision within
the vehicle's limits.

It serves every controller that does not backstep through the attitude. The specific thrust is F =
(T/m) R e3 [m/s², NED], along the body's z axis; the rotors accelerate the vehicle by -F. With the
disturbance d, acceleration = g e3 + d - F, so F = g e3 + d - a_wanted, T = m |F|, and R e3 along F.
Floats only.
"""

import math

from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.geometry import (
    FLOATS,
    ZERO,
    Quat,
    Vec3,
    add_scaled,
    subtract,
    third_column,
    to_body,
)
from groundstation.core.messages import Decision, Diagnostics, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle

TILT_LIMIT_RAD = math.radians(45.0)
"""Largest tilt of F where the caller names none [rad]: enough to hold and brake against a
disturbance of 8 m/s²."""
LEAST_DOWN_M_S2 = 1.0
"""Least downward part of F [m/s²]: the vehicle stays upright, and falls by g - 1 m/s² at most.
Chosen."""
LEAST_HALF_ANGLE = 1e-6
"""Least 2 cos² of half the error angle that is divided by [-]: within 0.1 degrees of upside down.
Rounding."""


def specific_thrust(
    wanted: Vec3, disturbance: Vec3, gravity: float, tilt_limit: float = TILT_LIMIT_RAD
) -> tuple[Vec3, bool]:
    """Return F for a ``wanted`` acceleration, and whether it was limited.

    Args:
        wanted: acceleration [m/s², NED].
        disturbance: acceleration by all but thrust and weight [m/s², NED].
        gravity: g [m/s²].
        tilt_limit: largest angle between F and down [rad].
    """
    x, y = disturbance[0] - wanted[0], disturbance[1] - wanted[1]
    z = gravity + disturbance[2] - wanted[2]
    down = max(z, LEAST_DOWN_M_S2)
    sideways, most = math.hypot(x, y), math.tan(tilt_limit) * down
    if sideways > most:
        x, y = x * most / sideways, y * most / sideways
    return (x, y, down), sideways > most or down != z


def length(v: Vec3) -> float:
    """|v|."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def acceleration(
    motion: Motion, disturbance: Vec3, mass: float, gravity: float, drag: float = 0.0
) -> Vec3:
    """Return the present acceleration by the model [m/s², NED], ``disturbance`` and linear ``drag``
    [1/s] included.
    """
    x, y, z = disturbance
    pushed = add_scaled((x, y, gravity + z), -motion.thrust / mass, third_column(motion.attitude))
    return add_scaled(pushed, -drag, motion.velocity)


def sine_error(attitude: Quat, along: Vec3) -> tuple[float, float]:
    """Turn about body x and y that brings the body's z axis to ``along``: sin of the angle, along
    the axis [-].

    The attitude error of T. Lee, M. Leok, N. H. McClamroch, CDC 2010, without its heading: largest
    at 90°, 0 at 180°.
    """
    x, y, _ = to_body(attitude, along)
    n = 1.0 / length(along)
    return (-y * n, x * n)


def half_angle_error(attitude: Quat, along: Vec3) -> tuple[float, float]:
    """As :func:`sine_error`, but 2 sin of half the angle [-]: the shortest quaternion's, as in PX4.

    It grows to 180°; upside down to within 0.1 degrees it has no direction, and falls to 0.
    """
    x, y, z = to_body(attitude, along)
    n = 1.0 / length(along)
    k = n * math.sqrt(2.0 / max(1.0 + z * n, LEAST_HALF_ANGLE))
    return (-y * k, x * k)


def turning(attitude: Quat, along: Vec3, along_dot: Vec3) -> tuple[float, float]:
    """Body rates about x and y [rad/s] at which ``along`` turns, that changes by ``along_dot``.

    Exact where the body's z axis is along it, so for small attitude errors.
    """
    x, y, _ = to_body(attitude, _direction_dot(along, along_dot))
    return (-y, x)


def _direction_dot(along: Vec3, dot: Vec3) -> Vec3:
    """The derivative of along/|along|."""
    n = 1.0 / length(along)
    a, b, c = along[0] * n, along[1] * n, along[2] * n
    inner = a * dot[0] + b * dot[1] + c * dot[2]
    return (n * (dot[0] - inner * a), n * (dot[1] - inner * b), n * (dot[2] - inner * c))


def clamp_command(
    vehicle: Vehicle, thrust_n: float, rates_rad_s: Vec3
) -> tuple[ActuatorCommand, bool]:
    """The command within the vehicle's limits, and whether any of the four had to be clamped."""
    return DemandLimits(FLOATS, vehicle).clamp(thrust_n, rates_rad_s)


def make_decision(
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
        vehicle: as configured; its limits apply.
        estimate: input of the controller.
        reference: the followed reference.
        thrust_n: wanted thrust [N].
        rates_rad_s: wanted body rates [rad/s, FRD].
        wanted: acceleration that thrust and rates were computed for [m/s², NED], for records.
        disturbance: the disturbance the controller works with [m/s², NED]; without it, the
            observer's.
    """
    drive, saturated = clamp_command(vehicle, thrust_n, rates_rad_s)
    motion = estimate.motion
    return Decision(
        drive,
        saturated,
        Diagnostics(
            z1=subtract(motion.position, reference.position_ned),
            z2=subtract(motion.velocity, reference.velocity_ned),
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
