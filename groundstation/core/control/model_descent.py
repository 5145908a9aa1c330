"""Descent on the model alone, after the poses have failed: simulated at once, played open loop.

Sans-IO.

From the model's present motion the descent is simulated: the vehicle levels, brakes its horizontal
speed, sinks, and brakes before the floor. The commands of that simulation are the bring-down.
Unlike bring_down.py, which is planned with every command, this is planned once, from any state, and
with little thrust, as the state may be wrong: thrust above hover only brakes the plan's own sink
rate.

Half and double of a constant were flown by `groundstation-sim dev faults paper --fault "attitude
frozen" --state moving --link dsm`; as they are, the vehicle meets the floor at 1.31 m/s, 0.39 m
aside.
"""

import math

from groundstation.core.control.attitude import clamp_command, length, sine_error, specific_thrust
from groundstation.core.control.bring_down import (
    LIFTING_COSINE,
    OFF,
    SETTLE_S,
    SINK_S,
    WEIGHT_RANGE,
)
from groundstation.core.geometry import FLOATS, Vec3, third_column
from groundstation.core.messages import ROUNDING_S
from groundstation.core.vehicle import Motion, Vehicle, integrate, lead
from links.core import Segment

STEP_S = 0.05
"""Duration of one segment of the plan [s]."""
LONGEST_S = SINK_S + SETTLE_S
"""Longest descent [s]: as long as a bring-down, which the link plays in its place. Half: 1.88 m/s,
as it falls the rest."""
LARGEST_THRUST_SHARE = 1.15
"""Largest thrust before ``THRUST_BIAS``, as a share of the hover thrust [-]. Half: 3.28 m/s;
double: 1.30 m/s."""
LONGEST_BRAKING_S = 0.35
"""Longest time in all with more than the hover thrust [s]. Half: 1.47 m/s; double: 1.23 m/s."""
LEAST_THRUST_SHARE = 0.4
"""Least thrust before the floor, as a share of the hover thrust [-]: with less, rates are hard to
hold. Half: 1.35 m/s; double: 1.23 m/s, 0.47 m aside."""
LEANING_COSINE = math.cos(math.radians(12.0))
"""Cosine of the tilt from which thrust is the least one while it would accelerate the vehicle
further [-]. Chosen: upright but for small corrections."""
HIGH_M = 1.0
"""Height above which that thrust is half of the least one [m]: the vehicle sinks meanwhile.
Chosen."""
THRUST_BIAS = 0.97
"""Factor on the thrust [-]: to meet the floor early is better than to stop above it. Less by 7 %:
1.55 m/s; more by 7 %: 1.24 m/s."""
BRAKING_M_S2 = 1.3
"""Planned deceleration before the floor [m/s²]: ``LARGEST_THRUST_SHARE`` gives 1.5, and 1.1 with
``THRUST_BIAS``. Half: 1.14 m/s; double: 1.54 m/s."""
TOUCHDOWN_M_S = 0.6
"""Planned sink rate at the floor [m/s]. Half: 1.29 m/s; double: 1.59 m/s."""
LARGEST_SINK_M_S = 1.6
"""Largest planned sink rate [m/s]: 1.1 m/s² for ``LONGEST_BRAKING_S`` leave 1.2 m/s at the floor.
Half: 0.90 m/s, 0.54 m aside; double: 1.40 m/s."""
FLOOR_M = 0.05
"""Height below which the motors stop [m]. Half and double: 1.34 m/s."""
LEAST_HEIGHT_M = 0.2
"""Least height of the plan [m]: dead reckoning is no more accurate, and a fall is worse."""
SINK_GAIN = 4.0
"""Acceleration per error of the sink rate [1/s]. Half: 1.29 m/s; double: 1.50 m/s."""
SPEED_GAIN = 2.0
"""Acceleration per error of the horizontal speed [1/s]. Half: 0.43 m aside; double: 0.38 m."""
ATTITUDE_GAIN = 6.0
"""Body rate per sine of the attitude error [1/s]. Half: 0.50 m aside; double: 0.53 m."""
LARGEST_TILT_RAD = math.radians(20.0)
"""Largest commanded tilt [rad]. Chosen: half of that of transit, as the state may be wrong."""
LARGEST_RATE_LEAD = 2.0
"""Largest lead of a body rate over its lag [-]: a lag above 0.07 s is not wholly inverted."""
LEAST_LIFT_COSINE = 0.7
"""Least cosine of the tilt by which thrust is divided to keep its vertical part [-]: 45°.
Chosen."""


def plan_model_descent(
    motion: Motion,
    vehicle: Vehicle,
    *,
    mass_kg: float,
    gravity: float,
    disturbance: Vec3,
    height_m: float,
) -> tuple[Segment, ...]:
    """Plan the descent from ``motion``, ``height_m`` above the floor; takes about 0.5 ms.

    Args:
        motion: motion by the model; its height above the floor is ``height_m``.
        vehicle: as configured; its limits and lags apply.
        mass_kg: effective mass m/λ̂ [kg].
        gravity: g [m/s²].
        disturbance: its mean before [m/s², NED].
        height_m: above the floor [m].
    """
    lightest, heaviest = WEIGHT_RANGE
    hover = mass_kg * min(max(gravity + disturbance[2], lightest * gravity), heaviest * gravity)
    thrust_lead = lead(FLOATS, STEP_S, vehicle.thrust_lag_s)
    rate_lead = min(lead(FLOATS, STEP_S, vehicle.rate_lag_s) / STEP_S, LARGEST_RATE_LEAD)
    floor, braked = motion.position[2] + max(height_m, LEAST_HEIGHT_M), 0.0
    parts: list[Segment] = []
    for _ in range(round(LONGEST_S / STEP_S)):
        height, (north, east, sinking) = floor - motion.position[2], motion.velocity
        if height < FLOOR_M:
            break
        fastest = min(
            math.sqrt(TOUCHDOWN_M_S**2 + 2.0 * BRAKING_M_S2 * max(height - FLOOR_M, 0.0)),
            LARGEST_SINK_M_S,
        )
        wanted = (-SPEED_GAIN * north, -SPEED_GAIN * east, SINK_GAIN * (fastest - sinking))
        along, _ = specific_thrust(wanted, disturbance, gravity, LARGEST_TILT_RAD)
        roll, pitch = sine_error(motion.attitude, along)
        # Only the plan's own sink rate is braked, and nothing where the vehicle may be on the
        # floor.
        has_braking_left = braked < LONGEST_BRAKING_S - ROUNDING_S
        may_brake = height_m >= LEAST_HEIGHT_M and sinking > TOUCHDOWN_M_S and has_braking_left
        most = LARGEST_THRUST_SHARE * hover if may_brake else hover
        thrust = _choose_thrust(motion, mass_kg * length(along), thrust_lead, hover, most, height)
        braked += STEP_S if thrust > hover else 0.0
        p, q, r = (
            rate + rate_lead * (ATTITUDE_GAIN * error - rate)
            for rate, error in zip(motion.rates, (roll, pitch, 0.0), strict=True)
        )
        drive, _ = clamp_command(vehicle, thrust, (p, q, r))
        parts.append(Segment(STEP_S, drive.thrust, drive.rates))
        motion = integrate(
            FLOATS,
            motion,
            drive,
            STEP_S,
            mass=mass_kg,
            gravity=gravity,
            disturbance=disturbance,
            thrust_lag=vehicle.thrust_lag_s,
            rate_lag=vehicle.rate_lag_s,
            drag=vehicle.drag_per_s,
        )
    return (*parts, *OFF)


def _choose_thrust(
    motion: Motion, wanted: float, thrust_lead: float, hover: float, most: float, height: float
) -> float:
    """Return the thrust of one step [N].

    Args:
        motion: motion by the model.
        wanted: thrust that is wanted along the vehicle's axis, were it upright [N].
        thrust_lead: lead over the lag of thrust [s].
        hover: hover thrust [N].
        most: limit [N].
        height: height above the floor [m].
    """
    lean_x, lean_y, upright = third_column(motion.attitude)
    # At a large tilt, thrust does not lift.
    thrust = wanted / max(upright, LEAST_LIFT_COSINE) if upright > LIFTING_COSINE else 0.0
    led = motion.thrust + thrust_lead * (thrust - motion.thrust) / STEP_S
    thrust = THRUST_BIAS * min(led, LARGEST_THRUST_SHARE * hover)
    least = LEAST_THRUST_SHARE * hover if upright > LIFTING_COSINE else 0.0
    if upright < LEANING_COSINE and lean_x * motion.velocity[0] + lean_y * motion.velocity[1] < 0.0:
        # The vehicle leans along its velocity: thrust would accelerate it.
        thrust, least = 0.0, least if height < HIGH_M else 0.5 * least
    return max(min(thrust, most), least)
