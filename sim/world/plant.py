"""The simulated vehicle as pure functions: one step of a rigid body on SO(3).

Equations (1)-(4) of the paper (docs/explanation/law.md):

    p¨ = -(T/m) R e3 + g e3 + b - k v,   R˙ = R S(ω),   T and ω follow their commands through
                                         first-order lags.

There are two plants. The controller's own model (groundstation/core/vehicle/vehicle.py) shares no
code with them.

:func:`integrate` is the plant of these equations. Its lags are exact, its attitude turns by the
exact integral of the rates, and its translation is by Simpson's rule (fourth order in the step). It
and the drag work elementwise, for many vehicles at once.

:func:`turn_rotors` is a quadrotor that turns by its four rotors. It has two parts, so that a real
autopilot can take the place of the first (:meth:`sim.world.quadrotor.Quadrotor.drive_rotors`):

- :func:`run_rate_loop`: commanded thrust and rates, and a gyro → four rotor signals: filters, PID,
  saturating mixer.
- :func:`integrate_rotors`: four rotor signals (0..1) → rotor speeds, thrust and torque of each, the
  rigid body.

Rotors in X: 0 front right and 1 rear left turn counter-clockwise seen from above, 2 front left and
3 rear right clockwise. A step is at most as long as the rate loop's period. A shorter one is as
good: no state counts steps, and every filter is exact for any step.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import msgspec

from groundstation.core.geometry import (
    FLOATS,
    ZERO,
    Ops,
    Quat,
    Real,
    Vec3,
    add,
    add_scaled,
    cross,
    multiply_each,
    rotate,
    scale,
    subtract,
    third_column,
    to_body,
    to_world,
)
from sim.world.world import World


class Body(msgspec.Struct, frozen=True, gc=False):
    """Position and velocity [m, m/s, NED], attitude, thrust [N] and body rates [rad/s, FRD]."""

    position: Vec3
    velocity: Vec3
    attitude: Quat
    thrust: Real
    rates: Vec3


class Physics(NamedTuple):
    """Constants of the vehicle and the air, as in :class:`sim.world.world.World`."""

    mass_kg: Real
    thrust_lag_s: Real
    rate_lag_s: Real
    drag_per_s: Real
    """k of the equation above [1/s]."""
    rate_leak: Real
    """Acceleration across the thrust per commanded body rate [m/s² per rad/s]."""
    gravity: float


class AirDrag(NamedTuple):
    """Drag along the body's axes.

    The fields of :class:`sim.world.world.World` of which they are made say more.
    """

    linear: Vec3
    """Deceleration per speed of the air, forward, right and down [1/s] (``drag_body_per_s``)."""
    within: Real
    """Growth of the first two per speed of the air in the rotors' plane [1/m]
    (``inflow_drag_per_m``)."""
    along: Real
    """Growth of the third per speed of the air in the rotors' plane [1/m]
    (``inflow_drag_per_m``)."""
    lift: Real
    """Acceleration upwards per squared speed of the air in the rotors' plane [1/m]
    (``inflow_lift_per_m``)."""
    air: Vec3
    """Velocity of the air [m/s, NED]."""


NO_LAG_S = 1e-12
"""Added to every lag [s], so that a lag of 0 divides by no zero: far below any step, so it changes
nothing."""
TINY = 1e-30
"""Added to a denominator that is 0 for a rotor at rest [-]."""
SATURATED_SHARE = 1e-9
"""Thrust that saturation takes, as a share of a rotor's full one, above which the integral pauses
[-]: above rounding."""


def compute_drag(ops: Ops, body: Body, drag: AirDrag) -> Vec3:
    """Return the acceleration of ``body`` by the air [m/s², NED]."""
    linear_x, linear_y, linear_z = drag.linear
    x, y, z = to_body(body.attitude, subtract(body.velocity, drag.air))
    inflow = ops.sqrt(x * x + y * y)
    within = drag.within * inflow
    down = -(linear_z + drag.along * inflow) * z - drag.lift * inflow * inflow
    return to_world(body.attitude, (-(linear_x + within) * x, -(linear_y + within) * y, down))


def _decay(ops: Ops, h: Real, lag_s: Real) -> Real:
    """Return the share of its value that a first-order lag keeps over ``h`` [s]; 0 without lag."""
    return ops.exp(-h / (lag_s + NO_LAG_S))


def _low_pass(old: Vec3, new: Vec3, rise: Real) -> Vec3:
    """Move ``old`` towards ``new`` by the share ``rise`` [-]."""
    return add_scaled(old, rise, subtract(new, old))


def _leak(attitude: Quat, rate_command: Vec3, leak: Real) -> Vec3:
    """Return the acceleration [m/s², NED] that commanded body rates leak into the translation."""
    return to_world(attitude, (leak * rate_command[1], -leak * rate_command[0], 0.0))


def integrate(
    ops: Ops,
    body: Body,
    thrust_command: Real,
    rate_command: Vec3,
    wind: Vec3,
    h: Real,
    physics: Physics,
) -> Body:
    """Return ``body`` after ``h`` [s] under held commands (thrust [N], rates [rad/s, FRD]) and a
    constant ``wind`` [m/s², NED].
    """
    half, rate_lag, thrust_lag = 0.5 * h, physics.rate_lag_s, physics.thrust_lag_s
    # Attitude in the middle and at the end: the exact integral of the rates.
    lead = subtract(body.rates, rate_command)
    rates_kept, rates_kept_half = _decay(ops, h, rate_lag), _decay(ops, half, rate_lag)
    middle = rotate(
        body.attitude,
        add_scaled(scale(half, rate_command), rate_lag * (1.0 - rates_kept_half), lead),
    )
    end = rotate(
        body.attitude, add_scaled(scale(h, rate_command), rate_lag * (1.0 - rates_kept), lead)
    )
    excess = body.thrust - thrust_command
    thrust_before = ops.where(thrust_lag > 0.0, body.thrust, thrust_command)
    thrust_middle = thrust_command + _decay(ops, half, thrust_lag) * excess
    thrust = thrust_command + _decay(ops, h, thrust_lag) * excess
    other = add(wind, _leak(middle, rate_command, physics.rate_leak))
    other = (other[0], other[1], other[2] + physics.gravity)

    def accelerate(attitude: Quat, thrust_n: Real, velocity: Vec3) -> Vec3:
        lifted = add_scaled(other, -thrust_n / physics.mass_kg, third_column(attitude))
        return add_scaled(lifted, -physics.drag_per_s, velocity)

    # Simpson's rule: velocity gains h/6 (a1 + 4 a2 + a3), position h v + h²/6 (a1 + 2 a2), a at
    # start, middle and end.
    velocity = body.velocity
    first = accelerate(body.attitude, thrust_before, velocity)
    second = accelerate(middle, thrust_middle, add_scaled(velocity, half, first))
    third = accelerate(end, thrust, add_scaled(velocity, h, second))
    two_terms = add_scaled(first, 2.0, second)
    position = add_scaled(add_scaled(body.position, h, velocity), h * h / 6.0, two_terms)
    all_terms = add(add_scaled(two_terms, 2.0, second), third)
    velocity = add_scaled(velocity, h / 6.0, all_terms)
    return Body(position, velocity, end, thrust, add_scaled(rate_command, rates_kept, lead))


FourRotors: TypeAlias = tuple[float, float, float, float]
"""One number per rotor."""


class RotorFrame(NamedTuple):
    """Constants of rotors and body, as in :class:`sim.world.world.RotorConstants` and ``World``."""

    mass_kg: float
    inertia: Vec3
    """Moments of inertia about roll, pitch and yaw [kg m²]."""
    lever_m: float
    """Lever arm of each rotor about roll and pitch [m]."""
    torque_m: float
    """Drag torque over thrust of a rotor [m]."""
    curve: float
    """f of thrust = f n² + (1 - f) n [-]."""
    spin_up_s: float
    spin_down_s: float
    drag_per_s: float
    rate_leak: float
    gravity: float


class RateLoopGains(NamedTuple):
    """Constants of the rate loop.

    The first four as in :class:`RotorFrame`, the rest as in ``RotorConstants``.
    """

    inertia: Vec3
    lever_m: float
    torque_m: float
    curve: float
    full_n: float
    """Largest thrust that the loop counts on from one rotor [N]."""
    p: Vec3
    i: Vec3
    d: Vec3
    gyro_filter_s: float
    d_filter_s: float
    rate_filter_s: float
    thrust_filter_s: float


class RateLoop(NamedTuple):
    """State of the rate loop."""

    thrust: float
    """Filtered thrust command [N]."""
    rates: Vec3
    """Filtered rate command [rad/s]."""
    gyro: Vec3
    """Filtered gyro [rad/s]."""
    slow: Vec3
    """Filtered gyro through the filter of D, too [rad/s]."""
    integral: Vec3
    """Integral of the rate error [rad]."""


class Actuators(NamedTuple):
    """State of rotors and rate loop."""

    speeds: FourRotors
    """Rotor speeds, as shares of the fastest, 0..1."""
    loop: RateLoop


def describe_rotors(world: World) -> tuple[RotorFrame, RateLoopGains]:
    """Return the constants of the rotors and of the rate loop of ``world``."""
    rotors = world.rotors
    lever_m = rotors.arm_m * math.sqrt(0.5)

    def per_axis(gain: float) -> Vec3:
        return gain, gain, gain * rotors.yaw_gain

    return RotorFrame(
        world.mass_kg,
        rotors.inertia_kg_m2,
        lever_m,
        rotors.torque_per_thrust_m,
        rotors.curve,
        rotors.spin_up_s,
        rotors.spin_down_s,
        world.drag_per_s,
        world.rate_leak,
        world.gravity,
    ), RateLoopGains(
        rotors.inertia_kg_m2,
        lever_m,
        rotors.torque_per_thrust_m,
        rotors.curve,
        0.25 * world.thrust_max_n,
        per_axis(rotors.p),
        per_axis(rotors.i),
        per_axis(rotors.d),
        1.0 / (2.0 * math.pi * rotors.gyro_filter_hz),
        1.0 / (2.0 * math.pi * rotors.d_filter_hz),
        rotors.rate_filter_s,
        rotors.thrust_filter_s,
    )


def begin_rotors(thrust: float, gains: RateLoopGains) -> Actuators:
    """Return rotors that give ``thrust`` [N] in all, and a rate loop without rates."""
    speed = _speed(0.25 * thrust / gains.full_n, gains.curve)
    return Actuators((speed, speed, speed, speed), RateLoop(thrust, ZERO, ZERO, ZERO, ZERO))


def _speed(share: float, curve: float) -> float:
    """Rotor speed n that gives ``share`` = f n² + (1 - f) n of the full thrust, f the ``curve``.

    Apart from :func:`links.core.signal`, which flights of this plant prove.
    """
    straight = 1.0 - curve
    return 2.0 * share / (straight + math.sqrt(straight * straight + 4.0 * curve * share) + TINY)


def run_rate_loop(
    loop: RateLoop, thrust: float, rates: Vec3, gyro: Vec3, h: float, gains: RateLoopGains
) -> tuple[RateLoop, FourRotors]:
    """Run the loop for ``h`` [s] on commanded ``thrust`` [N] and ``rates``.

    Return it and its rotor signals (0..1).

    torque = J (P e + I ∫e - D d/dt ω), e = commanded rates - filtered ``gyro`` [rad/s]. While a
    rotor is at its limit, the integral pauses.
    """
    rate_command = _low_pass(loop.rates, rates, 1.0 - _decay(FLOATS, h, gains.rate_filter_s))
    measured = _low_pass(loop.gyro, gyro, 1.0 - _decay(FLOATS, h, gains.gyro_filter_s))
    slow = _low_pass(loop.slow, measured, 1.0 - _decay(FLOATS, h, gains.d_filter_s))
    thrust_command = loop.thrust + (1.0 - _decay(FLOATS, h, gains.thrust_filter_s)) * (
        thrust - loop.thrust
    )
    error = subtract(rate_command, measured)
    # The output of a first-order filter changes by the distance to its input over its time
    # constant.
    derivative = scale(1.0 / gains.d_filter_s, subtract(measured, slow))
    demand = add(multiply_each(gains.p, error), multiply_each(gains.i, loop.integral))
    torque = multiply_each(gains.inertia, subtract(demand, multiply_each(gains.d, derivative)))
    level, full = 0.25 * thrust_command, gains.full_n
    # Thrust of each rotor for roll, pitch and yaw [N].
    a = 0.25 * torque[0] / gains.lever_m
    b = 0.25 * torque[1] / gains.lever_m
    c = 0.25 * torque[2] / gains.torque_m
    wanted = (level - a + b + c, level + a - b + c, level + a + b - c, level - a - b - c)
    given = [min(max(one / full, 0.0), 1.0) for one in wanted]
    over = [abs(one - full * share) for one, share in zip(wanted, given, strict=True)]
    integrated_s = h if over[0] + over[1] + over[2] + over[3] <= SATURATED_SHARE * full else 0.0
    front_right, rear_left, front_left, rear_right = (_speed(share, gains.curve) for share in given)
    integral = add_scaled(loop.integral, integrated_s, error)
    return RateLoop(thrust_command, rate_command, measured, slow, integral), (
        front_right,
        rear_left,
        front_left,
        rear_right,
    )


def _spin(speeds: FourRotors, signals: FourRotors, h: float, frame: RotorFrame) -> FourRotors:
    """Let rotor ``speeds`` follow ``signals`` for ``h`` [s]."""
    up, down = 1.0 - _decay(FLOATS, h, frame.spin_up_s), 1.0 - _decay(FLOATS, h, frame.spin_down_s)
    now = zip(speeds, signals, strict=True)
    n0, n1, n2, n3 = (
        speed + (up if signal > speed else down) * (signal - speed) for speed, signal in now
    )
    return n0, n1, n2, n3


def _gain_rates(
    body: Body,
    thrusts_before: Sequence[float],
    thrusts_after: Sequence[float],
    h: float,
    frame: RotorFrame,
) -> Vec3:
    """Change of the body rates over ``h`` [s] by the torque of the four thrusts, averaged over both
    ends.
    """
    front_right, rear_left, front_left, rear_right = (
        0.5 * (before + after) for before, after in zip(thrusts_before, thrusts_after, strict=True)
    )
    torque = (
        frame.lever_m * (front_left + rear_left - front_right - rear_right),
        frame.lever_m * (front_right + front_left - rear_left - rear_right),
        frame.torque_m * (front_right + rear_left - front_left - rear_right),
    )
    # Euler's equation: J ω˙ = torque - ω x J ω.
    left = subtract(torque, cross(body.rates, multiply_each(frame.inertia, body.rates)))
    jx, jy, jz = frame.inertia
    return h * left[0] / jx, h * left[1] / jy, h * left[2] / jz


def integrate_rotors(
    body: Body,
    speeds: FourRotors,
    signals: FourRotors,
    full_n: float,
    rate_command: Vec3,
    other: Vec3,
    h: float,
    frame: RotorFrame,
) -> tuple[Body, FourRotors]:
    """Integrate ``body`` and rotor ``speeds`` (0..1) for ``h`` [s] under held ``signals`` (0..1).

    The error is of second order in ``h``. ``full_n`` is the full thrust of one rotor now [N],
    ``other`` a constant acceleration, such as wind [m/s², NED], and ``rate_command`` the commanded
    rates [rad/s], for the leak alone.
    """
    after = _spin(speeds, signals, h, frame)
    straight = 1.0 - frame.curve
    thrusts_before, thrusts_after = (
        [full_n * speed * (straight + frame.curve * speed) for speed in some]
        for some in (speeds, after)
    )
    gained = _gain_rates(body, thrusts_before, thrusts_after, h, frame)
    attitude = rotate(body.attitude, scale(h, add_scaled(body.rates, 0.5, gained)))
    a, b, c, d = thrusts_before
    before = a + b + c + d
    a, b, c, d = thrusts_after
    thrust = a + b + c + d
    other = add(other, _leak(body.attitude, rate_command, frame.rate_leak))
    other = (other[0], other[1], other[2] + frame.gravity)

    def accelerate(attitude: Quat, thrust_n: float, velocity: Vec3) -> Vec3:
        lifted = add_scaled(other, -thrust_n / frame.mass_kg, third_column(attitude))
        return add_scaled(lifted, -frame.drag_per_s, velocity)

    velocity = body.velocity
    first = accelerate(body.attitude, before, velocity)
    last = accelerate(attitude, thrust, add_scaled(velocity, h, first))
    moved = add_scaled(
        add_scaled(body.position, h, velocity), h * h / 6.0, add_scaled(last, 2.0, first)
    )
    velocity = add_scaled(velocity, 0.5 * h, add(first, last))
    return Body(moved, velocity, attitude, thrust, add(body.rates, gained)), after


def turn_rotors(
    body: Body,
    actuators: Actuators,
    thrust: float,
    rates: Vec3,
    gyro_noise: Vec3,
    gain: float,
    other: Vec3,
    h: float,
    frame: RotorFrame,
    gains: RateLoopGains,
) -> tuple[Body, Actuators]:
    """Make one step of rate loop and rotors.

    Args:
        body: body at the step's start.
        actuators: rotors and rate loop at the step's start.
        thrust: commanded thrust times ``gain`` [N], the true thrust without lag; the rate loop's
            command is without it.
        rates: commanded rates [rad/s, FRD].
        gyro_noise: error of the gyro in this step [rad/s].
        gain: true thrust over nominal thrust of the rotors [-]; the rate loop does not know it.
        other: see :func:`integrate_rotors`.
        h: length of the step [s].
        frame: constants of rotors and body.
        gains: constants of the rate loop.
    """
    gyro = add(body.rates, gyro_noise)
    loop, signals = run_rate_loop(actuators.loop, thrust / gain, rates, gyro, h, gains)
    full = gain * gains.full_n
    body, speeds = integrate_rotors(body, actuators.speeds, signals, full, rates, other, h, frame)
    return body, Actuators(speeds, loop)
