"""What the vehicle shall do when no command comes any more: level out, sink, brake, motors off. Sans-IO.

Computed with every command, for the state in which the vehicle will be when that command may not be repeated any
longer; the link plays it open loop, so it must do without poses. Four ideas:

- A first-order lag τ turns a pulse of a body rate into the pulse's area of angle, and the rate at its beginning into
  τ ω more. So the turn to level is a pulse whose area is the angle that is left after that.
- Level means upright in the wind: where the thrust cancels the estimated disturbance, within ``WIND_TILT``.
- With x down, τ A˙ + A = a, w = v + τ A and ζ = x + τ v obey ζ˙ = w, w˙ = a: the lagged vehicle is a plain double
  integrator. It falls at a = +a, sinks on as fast, and brakes at -b, softly and shortly, as nobody sees what it does;
  so it comes to the floor at ``TOUCHDOWN_M_S`` from a room's height.
- What an autopilot is told last it goes on doing for 1 to 3 s after we fall silent: the last part is zero thrust.
"""

import math

from groundstation.core.geometry import ZERO, Vec3, rotate, third_column, to_body
from groundstation.core.vehicle import Motion, Vehicle
from links.core import Segment

ON_FLOOR_M = 0.03
"""Below this height above the floor the motors only stop [m]."""
MARGIN_M = 0.15
"""So far above the floor is the braking to be over [m]."""
SINK_S = 1.45
"""Time for sinking and braking together, where the height does not ask for less [s].

This and the figures down to ``BIAS`` were chosen by `groundstation-sim dev bring-down` from 1 and 2 m: smallest worst
touchdown over a vehicle as modelled, one with other thrust, lags and gusts, and one with strong drag.
"""
SETTLE_S = 0.4
"""Time of sinking on after the braking, in case the floor is not reached yet [s]."""
SETTLE_SHARE = 0.93
"""Thrust meanwhile, as a share of the hover thrust [-]."""
OFF_S = 0.15
"""Then zero thrust, sent for this long, so that it arrives on a bad link too [s]."""
TOUCHDOWN_M_S = 0.8
"""Speed when the braking is over [m/s]: not zero, as a vehicle that stops above the floor falls the rest."""
SOFTEST = 0.08
"""Smallest acceleration of falling, as a share of gravity [-]."""
HARDEST = 0.45
"""Largest acceleration of falling, as a share of gravity [-]."""
BRAKES = 0.22
"""Largest braking, as a share of gravity [-]: what is played unseen pushes little above what hovers."""
BRAKE_S = 0.45
"""Longest braking [s]; as above."""
PULSE_S = 0.15
"""Shortest turn to level [s]."""
WIND_TILT = 0.18
"""Steepest leaning into the wind, as a tangent: 10 degrees."""
BIAS = 0.96
"""Of the hover thrust: to meet the floor early and a little fast is better than to stop above it."""
OFF = (Segment(OFF_S, 0.0, ZERO),)
"""All that is left to do on the floor."""


def plan_bring_down(
    motion: Motion, vehicle: Vehicle, *, mass_kg: float, gravity: float, disturbance: Vec3, height_m: float
) -> tuple[Segment, ...]:
    """The parts that begin at the state ``motion``, ``height_m`` above the floor; on the floor only ``OFF``.

    ``mass_kg`` is the mass that thrust seems to lift, m/λ̂, and ``disturbance`` the estimated one [m/s², NED], which
    holds what is left of errors of the thrust's scale. At most ``SINK_S + SETTLE_S + OFF_S`` = 2 s in all. About 5 µs.
    """
    if height_m < ON_FLOOR_M:
        return OFF
    weight = min(max(gravity + disturbance[2], 0.5 * gravity), 1.5 * gravity)
    turn_s, rates, cosine = _turn(motion, vehicle, weight, disturbance)
    fall_s, hold_s, brake_s, pull, brake = _descent(motion, vehicle, mass_kg, gravity, weight, height_m)
    top = vehicle.thrust_max_n
    hover = mass_kg * weight * BIAS
    # What is left along the vertical is rather an error of the thrust's scale not found yet than wind: it scales.
    fall_n, brake_n, settle_n = hover * (1.0 - pull / gravity), hover * (1.0 + brake / gravity), hover * SETTLE_SHARE
    parts: list[Segment] = []
    for duration, thrust in ((fall_s, fall_n), (hold_s, hover), (brake_s, brake_n), (SETTLE_S, settle_n)):
        left = duration
        if turn_s > 0.0 and left > 0.0:
            first = min(turn_s, left)
            # A leaning vehicle lifts less; one far over lifts nothing that helps.
            lift = min(thrust / cosine, max(thrust, hover), top) if cosine > 0.3 else vehicle.thrust_min_n
            parts.append(Segment(first, lift, rates))
            turn_s -= first
            left -= first
        if left > 0.0:
            parts.append(Segment(left, min(thrust, top), ZERO))
    return (*parts, *OFF)


def _turn(motion: Motion, vehicle: Vehicle, weight: float, disturbance: Vec3) -> tuple[float, Vec3, float]:
    """The pulse of body rates that ends upright: its length [s], its rates, and the cosine of the mean tilt."""
    lag = vehicle.rate_lag_s
    a, b, c = motion.rates
    coasted = rotate(motion.attitude, (lag * a, lag * b, lag * c))
    x, y = disturbance[0] / weight, disturbance[1] / weight
    lean = math.sqrt(x * x + y * y)
    shrink = min(1.0, WIND_TILT / lean) if lean > 0.0 else 0.0
    n = 1.0 / math.sqrt(1.0 + (shrink * lean) ** 2)
    # Where the body's z axis shall point, seen from the body.
    u, v, w = to_body(coasted, (n * shrink * x, n * shrink * y, n))
    sine = math.sqrt(u * u + v * v)
    angle = math.atan2(sine, w)
    scale = angle / sine if sine > 1e-9 else 0.0 if w > 0.0 else math.pi
    turn_x, turn_y = -v * scale, (u * scale if sine > 1e-9 or w > 0.0 else math.pi)
    limit_x, limit_y, _ = vehicle.rate_limits_deg_s
    duration = max(PULSE_S, abs(turn_x) / math.radians(limit_x), abs(turn_y) / math.radians(limit_y))
    duration = min(duration, SINK_S)
    rates = (turn_x / duration, turn_y / duration, 0.0)
    half = 0.5 * angle
    down = third_column(coasted)[2]
    cosine = math.cos(half) if down > 0.0 else -1.0
    return duration, rates, cosine


def _descent(
    motion: Motion, vehicle: Vehicle, mass: float, gravity: float, weight: float, height: float
) -> tuple[float, float, float, float, float]:
    """How long to fall, to sink as fast, and to brake [s]; how strongly it falls and brakes [m/s²]."""
    lag = vehicle.thrust_lag_s
    speed = motion.velocity[2]
    lift = gravity * motion.thrust / (mass * weight)
    now = gravity - lift * max(third_column(motion.attitude)[2], 0.0)
    strength = 0.85 * gravity * (vehicle.thrust_max_n / (mass * weight) - 1.0)
    hardest = max(min(HARDEST * gravity, strength), 0.02 * gravity)
    softest = min(SOFTEST * gravity, hardest)
    pull = min(max(4.0 * height / SINK_S**2, softest), hardest)
    brake = min(pull, BRAKES * gravity, strength) if strength > softest else hardest
    w0, w1 = speed + lag * now, TOUCHDOWN_M_S - lag * brake
    way = max(height - MARGIN_M, 0.0) + lag * (TOUCHDOWN_M_S - speed)
    if w0 > w1 and w0 * w0 - w1 * w1 >= 2.0 * brake * way:  # fast already: brake at once
        return 0.0, 0.0, min((w0 - w1) / brake, BRAKE_S), pull, brake
    # Fall at +pull to the peak, brake at -brake to w1, and hold the peak for what is left of the way.
    square = 2.0 * (way + 0.5 * w0 * w0 / pull + 0.5 * w1 * w1 / brake) / (1.0 / pull + 1.0 / brake)
    peak = max(min(math.sqrt(max(square, 0.0)), w1 + brake * BRAKE_S), w0, w1)
    fall, slow = (peak - w0) / pull, min((peak - w1) / brake, BRAKE_S)
    left = way - 0.5 * (peak * peak - w0 * w0) / pull - 0.5 * (peak * peak - w1 * w1) / brake
    fall = min(fall, SINK_S)
    hold = min(max(left, 0.0) / peak if peak > 0.0 else 0.0, max(SINK_S - fall - slow, 0.0))
    return fall, hold, min(slow, SINK_S - fall - hold), pull, brake
