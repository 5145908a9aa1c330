"""Bring-down: the plan to level, sink, brake and stop the motors when no more commands arrive.

Sans-IO.

Every command carries a bring-down. It begins in the state that the vehicle will have when that
command must not be repeated any longer. The link plays it open loop, so it can't use poses. Four
ideas:

- A first-order lag τ turns a pulse of a body rate into an angle as large as the pulse's area, and
  the present rate ω into τ ω more. So the turn to level is a pulse whose area is the angle that
  remains after τ ω.
- Level means the attitude in which thrust cancels the estimated disturbance, leaning by
  ``LARGEST_LEAN`` at most.
- The lagged vehicle is a double integrator: with x down, acceleration A, τ A˙ + A = a, the
  variables w = v + τ A and ζ = x + τ v have ζ˙ = w, w˙ = a. It falls at a = +pull, sinks at
  constant speed, and brakes at a = -brake. Braking is weak and short, as no pose shows its effect.
  From a room's height the floor is met at ``TOUCHDOWN_M_S``. What the configured drag takes of an
  acceleration at the mean speed of each phase, the thrust gives back.
- An autopilot repeats its last command for 1 to 3 s after the link falls silent: so the last part
  is zero thrust.
"""

import math
from collections.abc import Iterable

import msgspec

from groundstation.core.geometry import ZERO, Vec3, rotate, third_column, to_body
from groundstation.core.vehicle import Motion, Vehicle
from links.core import BRING_DOWN_LIMIT_S, Segment

ON_FLOOR_M = 0.03
"""Height above the floor below which the motors just stop [m]."""
MARGIN_M = 0.15
"""Height above the floor at which braking shall be over [m]."""
SETTLE_S = 0.4
"""Time of further sinking after the braking, in case the floor is not reached yet [s].

This value and those down to ``HOVER_BIAS`` have the slowest worst touchdown of flights that were
cut short at 1 and 2 m: by a vehicle as modelled, one with other thrust, lags and gusts, and one
with strong drag (`groundstation-sim dev faults SCENARIO --fault dropout --set
link.bring_down=rates` flies them).
"""
SETTLE_SHARE = 0.93
"""Thrust in that time, as a share of the hover thrust [-]."""
OFF_S = 0.15
"""Duration of zero thrust at the end [s]: long enough to arrive on a link that loses frames."""
SINK_S = BRING_DOWN_LIMIT_S - (SETTLE_S + OFF_S)
"""Longest time for falling, sinking and braking together [s]: the rest of the longest bring-down
that a link plays."""
TOUCHDOWN_M_S = 0.8
"""Speed at the end of the braking [m/s]: not zero, as a vehicle that stops above the floor falls
the rest."""
LEAST_FALL_SHARE = 0.08
"""Smallest acceleration of the fall, as a share of gravity [-]."""
LARGEST_FALL_SHARE = 0.45
"""Largest acceleration of the fall, as a share of gravity [-]."""
LARGEST_BRAKING_SHARE = 0.22
"""Largest deceleration of the braking, as a share of gravity [-]: without poses, thrust stays
little above hover."""
LONGEST_BRAKING_S = 0.45
"""Longest braking [s], for the same reason."""
SHORTEST_TURN_S = 0.15
"""Shortest turn to level [s]."""
LARGEST_LEAN = 0.18
"""Tangent of the largest lean into the wind [-]: 10 degrees."""
HOVER_BIAS = 0.96
"""Share of the estimated hover thrust that is taken as hover thrust [-]: to meet the floor early
and a little fast is better than to stop above it."""
WEIGHT_RANGE = (0.5, 1.5)
"""Range of gravity and vertical disturbance together, as shares of gravity [-]. Chosen: beyond any
plausible estimate."""
LIFTING_COSINE = 0.3
"""Cosine of a tilt below which thrust is the least one [-]: it would push sideways. Chosen."""
SPARE_SHARE = 0.85
"""Share of the thrust above hover that braking may use [-]: the rest is reserve. Chosen."""
WEAK_VEHICLE_SHARE = 0.02
"""Acceleration of fall and braking of a vehicle without spare thrust, as a share of gravity [-].
Chosen."""
LEAST_SINE = 1e-9
"""Sine of the angle to level below which its axis is undefined [-]: the vehicle is level, or
exactly upside down."""
OFF = (Segment(OFF_S, 0.0, ZERO),)
"""Bring-down of a vehicle on the floor: motors off."""


class _SinkPhase(msgspec.Struct, frozen=True, gc=False):
    """Part of the vertical motion at one acceleration."""

    duration_s: float
    acceleration: float
    """Downwards [m/s²]."""
    speed: float
    """Mean sink rate [m/s], for the drag."""


def plan_bring_down(
    motion: Motion,
    vehicle: Vehicle,
    *,
    mass_kg: float,
    gravity: float,
    disturbance: Vec3,
    height_m: float,
) -> tuple[Segment, ...]:
    """Plan the bring-down from the state ``motion``, ``height_m`` above the floor.

    It takes about 5 µs.

    Args:
        motion: state at its beginning.
        vehicle: the configured vehicle.
        mass_kg: mass as thrust lifts it, m/λ̂.
        gravity: [m/s²].
        disturbance: estimated disturbance [m/s², NED].
        height_m: height above the floor [m].

    Returns:
        Its segments, ``SINK_S + SETTLE_S + OFF_S`` = 2 s at most; on the floor only ``OFF``.
    """
    if height_m < ON_FLOOR_M:
        return OFF
    # The vertical disturbance is treated as an error of the thrust scale, not as wind: it scales
    # all thrusts.
    least, most = WEIGHT_RANGE
    weight = min(max(gravity + disturbance[2], least * gravity), most * gravity)
    turn_s, rates, cosine = _turn(motion, vehicle, weight, disturbance)
    hover = mass_kg * weight * HOVER_BIAS

    def thrust_n(phase: _SinkPhase) -> float:
        pushed = phase.acceleration + vehicle.drag_per_s * phase.speed
        return max(hover * (1.0 - pushed / gravity), vehicle.thrust_min_n)

    phases = _plan_phases(motion, vehicle, mass_kg, gravity, weight, height_m)
    settle_n = SETTLE_SHARE * thrust_n(_SinkPhase(SETTLE_S, 0.0, TOUCHDOWN_M_S))
    thrusts = [(phase.duration_s, thrust_n(phase)) for phase in phases]
    thrusts.append((SETTLE_S, settle_n))
    return (*_turn_upright(thrusts, turn_s, rates, cosine, hover, vehicle), *OFF)


def _turn_upright(
    thrusts: Iterable[tuple[float, float]],
    turn_s: float,
    rates: Vec3,
    cosine: float,
    hover: float,
    vehicle: Vehicle,
) -> list[Segment]:
    """Return the segments of ``thrusts``, durations [s] and thrusts [N], with a turn at first.

    Args:
        thrusts: what an upright vehicle is given.
        turn_s: duration of the turn [s].
        rates: its body rates [rad/s].
        cosine: cosine of the mean tilt in it.
        hover: hover thrust [N].
        vehicle: its thrust limits.
    """
    top = vehicle.thrust_max_n
    segments: list[Segment] = []
    for duration_s, thrust in thrusts:
        turning_s = min(turn_s, duration_s)
        if turning_s > 0.0:
            # Thrust makes up for the tilt, but not above hover; far over it is the least one.
            lift = vehicle.thrust_min_n
            if cosine > LIFTING_COSINE:
                lift = min(thrust / cosine, max(thrust, hover), top)
            segments.append(Segment(turning_s, lift, rates))
            turn_s -= turning_s
        if duration_s > turning_s:
            segments.append(Segment(duration_s - turning_s, min(thrust, top), ZERO))
    return segments


def _turn(
    motion: Motion, vehicle: Vehicle, weight: float, disturbance: Vec3
) -> tuple[float, Vec3, float]:
    """Compute the pulse of body rates that ends level.

    Returns:
        Its duration [s], its rates [rad/s], and the cosine of the mean tilt; -1 for a vehicle
        upside down.
    """
    lag = vehicle.rate_lag_s
    a, b, c = motion.rates
    coasted = rotate(motion.attitude, (lag * a, lag * b, lag * c))
    x, y = disturbance[0] / weight, disturbance[1] / weight
    lean = math.sqrt(x * x + y * y)
    share = min(1.0, LARGEST_LEAN / lean) if lean > 0.0 else 0.0
    cos_lean = 1.0 / math.sqrt(1.0 + (share * lean) ** 2)
    # Wanted direction of the body's z axis, in the body's axes.
    u, v, w = to_body(coasted, (cos_lean * share * x, cos_lean * share * y, cos_lean))
    sine = math.sqrt(u * u + v * v)
    angle = math.atan2(sine, w)
    if sine > LEAST_SINE:
        turn_x, turn_y = -v * (angle / sine), u * (angle / sine)
    elif w > 0.0:  # level already: zeros with the signs of v and u
        turn_x, turn_y = -v * 0.0, u * 0.0
    else:
        turn_x, turn_y = -v * math.pi, math.pi
    limit_x, limit_y, _ = vehicle.rate_limits_deg_s
    duration = max(
        SHORTEST_TURN_S, abs(turn_x) / math.radians(limit_x), abs(turn_y) / math.radians(limit_y)
    )
    duration = min(duration, SINK_S)
    rates = (turn_x / duration, turn_y / duration, 0.0)
    cosine = math.cos(0.5 * angle) if third_column(coasted)[2] > 0.0 else -1.0
    return duration, rates, cosine


def _plan_phases(
    motion: Motion, vehicle: Vehicle, mass: float, gravity: float, weight: float, height: float
) -> tuple[_SinkPhase, ...]:
    """Plan the vertical motion: falling, sinking at constant speed, and braking."""
    lag = vehicle.thrust_lag_s
    speed = motion.velocity[2]
    lift = gravity * motion.thrust / (mass * weight)
    now = gravity - lift * max(third_column(motion.attitude)[2], 0.0) - vehicle.drag_per_s * speed
    spare = SPARE_SHARE * gravity * (vehicle.thrust_max_n / (mass * weight) - 1.0)
    hardest = max(min(LARGEST_FALL_SHARE * gravity, spare), WEAK_VEHICLE_SHARE * gravity)
    softest = min(LEAST_FALL_SHARE * gravity, hardest)
    # Half of the height at +a and half at -a takes the time √(4 height/a).
    pull = min(max(4.0 * height / SINK_S**2, softest), hardest)
    brake = min(pull, LARGEST_BRAKING_SHARE * gravity, spare) if spare > softest else hardest
    # w and ζ of the double integrator: w at the beginning and at the end, and the way of ζ between.
    w0, w1 = speed + lag * now, TOUCHDOWN_M_S - lag * brake
    way = max(height - MARGIN_M, 0.0) + lag * (TOUCHDOWN_M_S - speed)
    # Fall at +pull to the peak, brake at -brake to w1, and keep the peak speed over the rest of the
    # way. A vehicle that is too fast already begins at its peak, and only brakes.
    square = 2.0 * (way + 0.5 * w0 * w0 / pull + 0.5 * w1 * w1 / brake) / (1.0 / pull + 1.0 / brake)
    peak = max(min(math.sqrt(max(square, 0.0)), w1 + brake * LONGEST_BRAKING_S), w0, w1)
    fall_s, brake_s = (peak - w0) / pull, min((peak - w1) / brake, LONGEST_BRAKING_S)
    left = way - 0.5 * (peak * peak - w0 * w0) / pull - 0.5 * (peak * peak - w1 * w1) / brake
    fall_s = min(fall_s, SINK_S)
    hold_s = min(max(left, 0.0) / peak if peak > 0.0 else 0.0, max(SINK_S - fall_s - brake_s, 0.0))
    return (
        _SinkPhase(fall_s, pull, 0.5 * (speed + peak)),
        _SinkPhase(hold_s, 0.0, peak),
        _SinkPhase(min(brake_s, SINK_S - fall_s - hold_s), -brake, 0.5 * (peak + TOUCHDOWN_M_S)),
    )
