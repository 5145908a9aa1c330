"""The plant as a pure function: one step of a rigid body on SO(3). Equations (1)-(4) of the paper. Elementwise.

p¨ = -(T/m) R e3 + g e3 + b - k v,   R˙ = R S(ω),   T and ω follow their commands through first-order lags.

Lags are exact, attitude turns by the exact integral of the rates, translation is by Simpson's rule (fourth order
in the step). The controller's own model (groundstation/core/vehicle/vehicle.py) shares none of this.

With rotors: a quadrotor that turns by its four rotors, and the rate loop on board that drives them. Two pieces, so that
the second may be another one's (a real autopilot's, see :meth:`Quadrotor.drive_rotors`):

- :func:`integrate_rotors`: four rotor signals (0..1) → rotor speeds, thrust and torque of each, the rigid body.
- :func:`run_rate_loop`: told thrust and rates, and a gyro → four rotor signals: filters, PID, mixer that saturates.

Rotors in X: 0 front right and 1 rear left turn counter-clockwise seen from above, 2 front left and 3 rear right
clockwise. A step is as long as the rate loop's period. All states are continuous ones, whose filters are exact for any
step: so one that is cut short does no harm.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from groundstation.core.geometry import FLOATS, Ops, Quat, Real, Vec3, rotate, third_column, to_body, to_world
from sim.world.world import RotorConstants, World


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


class Decay(NamedTuple):
    """What the lags keep of an old value over a step, and over its first half [-]. Elementwise."""

    rates: Real
    rates_half: Real
    thrust: Real
    thrust_half: Real


def compute_decay(ops: Ops, h: Real, physics: Physics) -> Decay:
    """That of a step of ``h`` [s]."""
    exp, half, thrust_lag, tau = ops.exp, 0.5 * h, physics.thrust_lag_s, physics.rate_lag_s
    # Without lag the exponent is so large that nothing of the old value is kept.
    rates, rates_half = exp(-h / (tau + 1e-12)), exp(-half / (tau + 1e-12))
    if thrust_lag is tau:
        return Decay(rates, rates_half, rates, rates_half)
    return Decay(rates, rates_half, exp(-h / (thrust_lag + 1e-12)), exp(-half / (thrust_lag + 1e-12)))


def integrate(
    ops: Ops,
    body: Body,
    thrust_command: Real,
    rate_command: Vec3,
    wind: Vec3,
    h: Real,
    physics: Physics,
    decay: Decay | None = None,
) -> Body:
    """``body`` after ``h`` [s] under held commands (thrust [N], rates [rad/s]) and a constant ``wind`` [m/s², NED].

    ``decay`` is that of such a step, where it is known.
    """
    mass, thrust_lag, tau, drag, leak, gravity = physics
    (px, py, pz), (vx, vy, vz), attitude, before, (wx, wy, wz) = body
    half = 0.5 * h
    keep, mid_keep, thrust_keep, mid_thrust_keep = compute_decay(ops, h, physics) if decay is None else decay
    cx, cy, cz = rate_command
    dx, dy, dz = wx - cx, wy - cy, wz - cz
    m, f = tau * (1.0 - mid_keep), tau * (1.0 - keep)
    q1 = rotate(attitude, (half * cx + m * dx, half * cy + m * dy, half * cz + m * dz))
    q2 = rotate(attitude, (h * cx + f * dx, h * cy + f * dy, h * cz + f * dz))
    over = before - thrust_command
    k0 = -ops.where(thrust_lag > 0.0, before, thrust_command) / mass
    k1 = -(thrust_command + mid_thrust_keep * over) / mass
    thrust = thrust_command + thrust_keep * over
    k2 = -thrust / mass
    bx, by, bz = wind
    if ops is not FLOATS or leak != 0.0:
        lx, ly, lz = to_world(q1, (leak * cy, -leak * cx, 0.0))
        bx, by, bz = bx + lx, by + ly, bz + lz
    bz = bz + gravity
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


FourRotors: TypeAlias = tuple[Real, Real, Real, Real]
"""One number a rotor."""


class RotorFrame(NamedTuple):
    """What does not change in flight of rotors and body; see :class:`sim.world.world.RotorConstants`."""

    mass_kg: Real
    inertia: Vec3
    lever_m: Real
    """Of each rotor, about roll and pitch [m]."""
    torque_m: Real
    curve: Real
    spin_up_s: Real
    spin_down_s: Real
    drag_per_s: Real
    rate_leak: Real
    gravity: float


class RateLoopGains(NamedTuple):
    """The same of the rate loop."""

    inertia: Vec3
    lever_m: Real
    torque_m: Real
    curve: Real
    full_n: Real
    """What it takes one rotor to give at its fullest [N]."""
    p: Vec3
    i: Vec3
    d: Vec3
    gyro_filter_s: Real
    d_filter_s: Real
    rate_filter_s: Real
    thrust_filter_s: Real


class RateLoop(NamedTuple):
    """The rate loop's state."""

    thrust: Real
    """As told, filtered [N]."""
    rates: Vec3
    """The same of the rates [rad/s]."""
    gyro: Vec3
    """Filtered gyro [rad/s]."""
    slow: Vec3
    """That once more, by the filter of D [rad/s]."""
    integral: Vec3
    """∫ e dt [rad]."""


class Actuators(NamedTuple):
    """State of rotors and rate loop."""

    speeds: FourRotors
    """Of the rotors, 0..1."""
    loop: RateLoop


Of: TypeAlias = Callable[[Callable[[World], float]], Real]
"""``of(get)`` is what ``get`` has of one world, or an array of what it has of many."""


def describe_air(of: Of) -> AirDrag:
    """Drag in air of one world, or of many."""
    return AirDrag(
        _vector(of, lambda w: w.drag_body_per_s),
        of(lambda w: w.inflow_drag_per_m[0]),
        of(lambda w: w.inflow_drag_per_m[1]),
        of(lambda w: w.inflow_lift_per_m),
        _vector(of, lambda w: w.air_velocity),
    )


def _vector(of: Of, get: Callable[[World], Vec3]) -> Vec3:
    return of(lambda w: get(w)[0]), of(lambda w: get(w)[1]), of(lambda w: get(w)[2])


def describe_rotors(of: Of, gravity: float) -> tuple[RotorFrame, RateLoopGains]:
    """Rotors and rate loop of one world, or of many."""
    inertia = _vector(of, lambda w: w.rotors.inertia_kg_m2)
    lever, torque = of(lambda w: w.rotors.arm_m * math.sqrt(0.5)), of(lambda w: w.rotors.torque_per_thrust_m)
    curve = of(lambda w: w.rotors.curve)

    def gains(get: Callable[[RotorConstants], float]) -> Vec3:
        level = of(lambda w: get(w.rotors))
        return level, level, of(lambda w: get(w.rotors) * w.rotors.yaw_gain)

    return RotorFrame(
        of(lambda w: w.mass_kg),
        inertia,
        lever,
        torque,
        curve,
        of(lambda w: w.rotors.spin_up_s),
        of(lambda w: w.rotors.spin_down_s),
        of(lambda w: w.drag_per_s),
        of(lambda w: w.rate_leak),
        gravity,
    ), RateLoopGains(
        inertia,
        lever,
        torque,
        curve,
        of(lambda w: 0.25 * w.thrust_max_n),
        gains(lambda r: r.p),
        gains(lambda r: r.i),
        gains(lambda r: r.d),
        of(lambda w: 1.0 / (2.0 * math.pi * w.rotors.gyro_filter_hz)),
        of(lambda w: 1.0 / (2.0 * math.pi * w.rotors.d_filter_hz)),
        of(lambda w: w.rotors.rate_filter_s),
        of(lambda w: w.rotors.thrust_filter_s),
    )


def begin_rotors(ops: Ops, thrust: Real, gains: RateLoopGains) -> Actuators:
    """Rotors and rate loop at rest under a total ``thrust`` [N]."""
    speed = _speed(ops, 0.25 * thrust / gains.full_n, gains.curve)
    nought = 0.0 * thrust
    still = (nought, nought, nought)
    return Actuators((speed, speed, speed, speed), RateLoop(thrust, still, still, still, still))


def _speed(ops: Ops, share: Real, curve: Real) -> Real:
    """The inverse of thrust = f n² + (1 - f) n."""
    straight = 1.0 - curve
    return 2.0 * share / (straight + ops.sqrt(straight * straight + 4.0 * curve * share) + 1e-30)


def run_rate_loop(
    ops: Ops, loop: RateLoop, thrust: Real, rates: Vec3, gyro: Vec3, h: Real, gains: RateLoopGains
) -> tuple[RateLoop, FourRotors]:
    """The loop after ``h`` [s], and the rotor signals it gives for them: ``thrust`` [N] and ``rates`` are as told.

    torque = J (P e + I ∫e - D d/dt ω), e = told rates - filtered ``gyro`` [rad/s]. Where a rotor is at its limit, the
    integral rests.
    """
    inertia, lever, torque_m, curve, full, p, i, d, gyro_s, d_s, rate_s, thrust_s = gains
    exp = ops.exp
    rate_rise, thrust_rise = 1.0 - exp(-h / (rate_s + 1e-12)), 1.0 - exp(-h / (thrust_s + 1e-12))
    gyro_rise, d_rise = 1.0 - exp(-h / gyro_s), 1.0 - exp(-h / d_s)
    (ax, ay, az), (bx, by, bz), (gx, gy, gz), (sx, sy, sz) = loop.rates, rates, loop.gyro, loop.slow
    ax, ay, az = ax + rate_rise * (bx - ax), ay + rate_rise * (by - ay), az + rate_rise * (bz - az)
    gx, gy, gz = gx + gyro_rise * (gyro[0] - gx), gy + gyro_rise * (gyro[1] - gy), gz + gyro_rise * (gyro[2] - gz)
    sx, sy, sz = sx + d_rise * (gx - sx), sy + d_rise * (gy - sy), sz + d_rise * (gz - sz)
    ex, ey, ez = ax - gx, ay - gy, az - gz
    ix, iy, iz = loop.integral
    # The filtered derivative is what the filter lags behind by, over its time constant.
    roll = inertia[0] * (p[0] * ex + i[0] * ix - d[0] * (gx - sx) / d_s)
    pitch = inertia[1] * (p[1] * ey + i[1] * iy - d[1] * (gy - sy) / d_s)
    yaw = inertia[2] * (p[2] * ez + i[2] * iz - d[2] * (gz - sz) / d_s)
    told = loop.thrust + thrust_rise * (thrust - loop.thrust)
    level, a, b, c = 0.25 * told, 0.25 * roll / lever, 0.25 * pitch / lever, 0.25 * yaw / torque_m
    wanted = (level - a + b + c, level + a - b + c, level + a + b - c, level - a - b - c)
    given = (
        ops.clamp(wanted[0] / full, 0.0, 1.0),
        ops.clamp(wanted[1] / full, 0.0, 1.0),
        ops.clamp(wanted[2] / full, 0.0, 1.0),
        ops.clamp(wanted[3] / full, 0.0, 1.0),
    )
    over = abs(wanted[0] - full * given[0]) + abs(wanted[1] - full * given[1])
    over = over + abs(wanted[2] - full * given[2]) + abs(wanted[3] - full * given[3])
    going = ops.where(over <= 1e-9 * full, h, 0.0)
    signals = (
        _speed(ops, given[0], curve),
        _speed(ops, given[1], curve),
        _speed(ops, given[2], curve),
        _speed(ops, given[3], curve),
    )
    integral = (ix + going * ex, iy + going * ey, iz + going * ez)
    return RateLoop(told, (ax, ay, az), (gx, gy, gz), (sx, sy, sz), integral), signals


def integrate_rotors(
    ops: Ops,
    body: Body,
    speeds: FourRotors,
    signals: FourRotors,
    full_n: Real,
    told: Vec3,
    other: Vec3,
    h: Real,
    frame: RotorFrame,
) -> tuple[Body, FourRotors]:
    """``body`` and rotor ``speeds`` (0..1) after ``h`` [s] under held ``signals`` (0..1), of second order in ``h``.

    ``full_n`` is what one rotor gives at its fullest now [N]; ``other`` is a constant acceleration, such as wind
    [m/s², NED]; ``told`` are the told rates [rad/s], for the leak alone.
    """
    mass, (jx, jy, jz), lever, torque_m, curve, up_s, down_s, drag, leak, gravity = frame
    up, down = 1.0 - ops.exp(-h / (up_s + 1e-12)), 1.0 - ops.exp(-h / (down_s + 1e-12))
    straight, where = 1.0 - curve, ops.where
    n0, n1, n2, n3 = speeds
    u0, u1, u2, u3 = signals
    m0 = n0 + where(u0 > n0, up, down) * (u0 - n0)
    m1 = n1 + where(u1 > n1, up, down) * (u1 - n1)
    m2 = n2 + where(u2 > n2, up, down) * (u2 - n2)
    m3 = n3 + where(u3 > n3, up, down) * (u3 - n3)
    f0, f1 = full_n * n0 * (straight + curve * n0), full_n * n1 * (straight + curve * n1)
    f2, f3 = full_n * n2 * (straight + curve * n2), full_n * n3 * (straight + curve * n3)
    g0, g1 = full_n * m0 * (straight + curve * m0), full_n * m1 * (straight + curve * m1)
    g2, g3 = full_n * m2 * (straight + curve * m2), full_n * m3 * (straight + curve * m3)
    # Thrust and torque of the step: the means of both ends.
    front_right, rear_left, front_left, rear_right = 0.5 * (f0 + g0), 0.5 * (f1 + g1), 0.5 * (f2 + g2), 0.5 * (f3 + g3)
    p, q, r = body.rates
    roll = lever * (front_left + rear_left - front_right - rear_right) - (jz - jy) * q * r
    pitch = lever * (front_right + front_left - rear_left - rear_right) - (jx - jz) * p * r
    yaw = torque_m * (front_right + rear_left - front_left - rear_right) - (jy - jx) * p * q
    a, b, c = h * roll / jx, h * pitch / jy, h * yaw / jz
    attitude = rotate(body.attitude, (h * (p + 0.5 * a), h * (q + 0.5 * b), h * (r + 0.5 * c)))
    thrust = g0 + g1 + g2 + g3
    before, after = -(f0 + f1 + f2 + f3) / mass, -thrust / mass
    bx, by, bz = other
    lx, ly, lz = to_world(body.attitude, (leak * told[1], -leak * told[0], 0.0))
    bx, by, bz = bx + lx, by + ly, bz + lz + gravity
    (vx, vy, vz), (px, py, pz) = body.velocity, body.position
    x, y, z = third_column(body.attitude)
    ax, ay, az = before * x + bx - drag * vx, before * y + by - drag * vy, before * z + bz - drag * vz
    x, y, z = third_column(attitude)
    ex = after * x + bx - drag * (vx + h * ax)
    ey = after * y + by - drag * (vy + h * ay)
    ez = after * z + bz - drag * (vz + h * az)
    half, sixth = 0.5 * h, h * h / 6.0
    return Body(
        (
            px + h * vx + sixth * (2.0 * ax + ex),
            py + h * vy + sixth * (2.0 * ay + ey),
            pz + h * vz + sixth * (2.0 * az + ez),
        ),
        (vx + half * (ax + ex), vy + half * (ay + ey), vz + half * (az + ez)),
        attitude,
        thrust,
        (p + a, q + b, r + c),
    ), (m0, m1, m2, m3)


def turn_rotors(
    ops: Ops,
    body: Body,
    actuators: Actuators,
    thrust: Real,
    rates: Vec3,
    gyro_noise: Vec3,
    gain: Real,
    other: Vec3,
    h: Real,
    frame: RotorFrame,
    gains: RateLoopGains,
) -> tuple[Body, Actuators]:
    """One step of rate loop and rotors.

    Args:
        ops: see :class:`groundstation.core.geometry.so3.Ops`.
        body: at the step's start.
        actuators: the same.
        thrust: that would come of what is told without lag [N]; the rate loop is told it without the ``gain``.
        rates: told [rad/s, FRD].
        gyro_noise: what the gyro is off by in this step [rad/s].
        gain: true thrust over what the rotors are taken to give [-]; the rate loop knows nothing of it.
        other: see :func:`integrate_rotors`.
        h: length of the step [s].
        frame: what does not change.
        gains: the same of the rate loop.
    """
    (p, q, r), (a, b, c) = body.rates, gyro_noise
    loop, signals = run_rate_loop(ops, actuators.loop, thrust / gain, rates, (p + a, q + b, r + c), h, gains)
    full = gain * gains.full_n
    body, speeds = integrate_rotors(ops, body, actuators.speeds, signals, full, rates, other, h, frame)
    return body, Actuators(speeds, loop)
