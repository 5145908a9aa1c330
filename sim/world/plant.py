"""The plant as a pure function: one step of a rigid body on SO(3). Equations (1)-(4) of the paper. Elementwise.

p¨ = -(T/m) R e3 + g e3 + b - k v,   R˙ = R S(ω),   T and ω follow their commands through first-order lags.

Lags are exact, attitude turns by the exact integral of the rates, translation is by Simpson's rule (fourth order
in the step). The controller's own model (groundstation/core/vehicle/vehicle.py) shares none of this.
"""

from typing import NamedTuple

from groundstation.core.geometry import FLOATS, Ops, Quat, Real, Vec3, rotate, to_body, to_world


class Body(NamedTuple):
    """Position and velocity [m, m/s, NED], attitude, thrust [N] and body rates [rad/s, FRD]."""

    position: Vec3
    velocity: Vec3
    attitude: Quat
    thrust: Real
    rates: Vec3


class Physics(NamedTuple):
    """What does not change in flight; see :class:`sim.world.world.World` for the units."""

    mass_kg: Real
    thrust_lag_s: Real
    rate_lag_s: Real
    drag_per_s: Real
    rate_leak: Real
    gravity: float


class AirDrag(NamedTuple):
    """Drag along the body's axes; see :class:`sim.world.world.World`. Elementwise."""

    linear: Vec3
    within: Real
    along: Real
    lift: Real
    air: Vec3


def compute_drag(ops: Ops, body: Body, drag: AirDrag) -> Vec3:
    """What the air accelerates ``body`` by [m/s², NED]."""
    (vx, vy, vz), (ax, ay, az), (lx, ly, lz) = body.velocity, drag.air, drag.linear
    x, y, z = to_body(body.attitude, (vx - ax, vy - ay, vz - az))
    inflow = ops.sqrt(x * x + y * y)
    within = drag.within * inflow
    down = -(lz + drag.along * inflow) * z - drag.lift * inflow * inflow
    return to_world(body.attitude, (-(lx + within) * x, -(ly + within) * y, down))


def integrate(
    ops: Ops, body: Body, thrust_command: Real, rate_command: Vec3, wind: Vec3, h: Real, physics: Physics
) -> Body:
    """``body`` after ``h`` [s] under held commands (thrust [N], rates [rad/s]) and a constant ``wind`` [m/s², NED]."""
    mass, thrust_lag, tau, drag, leak, gravity = physics
    half = 0.5 * h
    exp = ops.exp
    # Without lag the exponent is so large that nothing of the old value is kept.
    keep = exp(-h / (tau + 1e-12))
    mid_keep = exp(-half / (tau + 1e-12))
    if thrust_lag is tau:
        thrust_keep, mid_thrust_keep = keep, mid_keep
    else:
        thrust_keep, mid_thrust_keep = exp(-h / (thrust_lag + 1e-12)), exp(-half / (thrust_lag + 1e-12))
    (wx, wy, wz), (cx, cy, cz) = body.rates, rate_command
    dx, dy, dz = wx - cx, wy - cy, wz - cz
    m, f = tau * (1.0 - mid_keep), tau * (1.0 - keep)
    attitude = body.attitude
    q1 = rotate(attitude, (half * cx + m * dx, half * cy + m * dy, half * cz + m * dz))
    q2 = rotate(attitude, (h * cx + f * dx, h * cy + f * dy, h * cz + f * dz))
    over = body.thrust - thrust_command
    k0 = -ops.where(thrust_lag > 0.0, body.thrust, thrust_command) / mass
    k1 = -(thrust_command + mid_thrust_keep * over) / mass
    thrust = thrust_command + thrust_keep * over
    k2 = -thrust / mass
    bx, by, bz = wind
    if ops is not FLOATS or leak != 0.0:
        lx, ly, lz = to_world(q1, (leak * cy, -leak * cx, 0.0))
        bx, by, bz = bx + lx, by + ly, bz + lz
    bz = bz + gravity
    (px, py, pz), (vx, vy, vz) = body.position, body.velocity
    # third_column() of all three, written out: this runs four hundred times a second.
    w, x, y, z = attitude
    ax, ay, az = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    ax, ay, az = k0 * ax + bx - drag * vx, k0 * ay + by - drag * vy, k0 * az + bz - drag * vz
    w, x, y, z = q1
    mx, my, mz = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    mx = k1 * mx + bx - drag * (vx + half * ax)
    my = k1 * my + by - drag * (vy + half * ay)
    mz = k1 * mz + bz - drag * (vz + half * az)
    w, x, y, z = q2
    ex, ey, ez = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    ex = k2 * ex + bx - drag * (vx + h * mx)
    ey = k2 * ey + by - drag * (vy + h * my)
    ez = k2 * ez + bz - drag * (vz + h * mz)
    s, d = h / 6.0, h * h / 6.0
    after = (
        (px + h * vx + d * (ax + 2.0 * mx), py + h * vy + d * (ay + 2.0 * my), pz + h * vz + d * (az + 2.0 * mz)),
        (vx + s * (ax + 4.0 * mx + ex), vy + s * (ay + 4.0 * my + ey), vz + s * (az + 4.0 * mz + ez)),
        q2,
        thrust,
        (cx + keep * dx, cy + keep * dy, cz + keep * dz),
    )
    return tuple.__new__(Body, after)  # by its name it would take three times as long
