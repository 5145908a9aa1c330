"""Descent on the model alone, after the poses have failed: simulated at once, played open loop.

Sans-IO.

From the model's present motion the descent is simulated: the vehicle levels, brakes its horizontal
speed, sinks, and brakes before the floor. The commands of that simulation are the bring-down.
Unlike bring_down.py, which is planned with every command, this is planned once, from any state, and
with little thrust, as the state may be wrong: thrust above hover only brakes the plan's own sink
rate.
"""

import math

from groundstation.core.control.attitude import clamp_command, length, push, sine_error
from groundstation.core.control.bring_down import OFF, SETTLE_S, SINK_S
from groundstation.core.geometry import FLOATS, Vec3, third_column
from groundstation.core.vehicle import Motion, Vehicle, integrate, lead
from links.core import Segment

STEP_S = 0.05
"""Length of one part [s]."""
LASTS_S = SINK_S + SETTLE_S
"""Longest descent [s]: as long as a bring-down, which the link plays in its place."""
MOST = 1.15
"""Largest thrust, as a share of the hover thrust [-]."""
BRAKE_S = 0.35
"""Longest time in all with more than the hover thrust [s]."""
LEAST = 0.4
"""Least thrust before the floor, as a share of the hover thrust [-]: with less, rates are hard to
hold."""
LEANS = math.cos(math.radians(12.0))
"""Cosine of a tilt from which thrust is reduced where it would accelerate the vehicle [-]."""
HIGH_M = 1.0
"""Height from which half of the least thrust is used for that [m]: the vehicle sinks meanwhile."""
BIAS = 0.97
"""Factor on the thrust [-]: to meet the floor early is better than to stop above it."""
BRAKES_M_S2 = 1.3
"""Planned deceleration before the floor [m/s²]."""
TOUCHDOWN_M_S = 0.6
"""Sink rate at the floor [m/s]."""
FASTEST_M_S = 1.6
"""Largest sink rate [m/s]."""
FLOOR_M = 0.05
"""Height below which the motors stop [m]."""
LEAST_M = 0.2
"""Least height of the plan [m]: dead reckoning is no more accurate, and a fall is worse."""
SINK_GAIN = 4.0
"""Acceleration per error of the sink rate [1/s]."""
SPEED_GAIN = 2.0
"""Acceleration per error of the horizontal speed [1/s]."""
ATTITUDE_GAIN = 6.0
"""Body rate per sine of the tilt's error [1/s]."""
LEAN = math.radians(20.0)
"""Largest commanded tilt [rad]."""


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
        disturbance: mean wind [m/s², NED].
        height_m: above the floor [m].
    """
    hover = mass_kg * min(max(gravity + disturbance[2], 0.7 * gravity), 1.3 * gravity)
    thrust_lead = lead(FLOATS, STEP_S, vehicle.thrust_lag_s)
    rate_lead = min(lead(FLOATS, STEP_S, vehicle.rate_lag_s) / STEP_S, 2.0)
    floor, braked = motion.position[2] + max(height_m, LEAST_M), 0.0
    parts: list[Segment] = []
    for _ in range(round(LASTS_S / STEP_S)):
        height, (north, east, sinking) = floor - motion.position[2], motion.velocity
        if height < FLOOR_M:
            break
        fastest = min(
            math.sqrt(TOUCHDOWN_M_S**2 + 2.0 * BRAKES_M_S2 * max(height - FLOOR_M, 0.0)),
            FASTEST_M_S,
        )
        wanted = (-SPEED_GAIN * north, -SPEED_GAIN * east, SINK_GAIN * (fastest - sinking))
        along, _ = push(wanted, disturbance, gravity, LEAN)
        roll, pitch = sine_error(motion.attitude, along)
        # Only the plan's own sink rate is braked, and nothing where the vehicle may be on the
        # floor.
        may_brake = height_m >= LEAST_M and sinking > TOUCHDOWN_M_S and braked < BRAKE_S - 1e-9
        most = MOST * hover if may_brake else hover
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
    thrust = wanted / max(upright, 0.7) if upright > 0.3 else 0.0
    led = motion.thrust + thrust_lead * (thrust - motion.thrust) / STEP_S
    thrust = BIAS * min(led, MOST * hover)
    least = LEAST * hover if upright > 0.3 else 0.0
    if upright < LEANS and lean_x * motion.velocity[0] + lean_y * motion.velocity[1] < 0.0:
        # The vehicle leans along its velocity: thrust would accelerate it.
        thrust, least = 0.0, least if height < HIGH_M else 0.5 * least
    return max(min(thrust, most), least)
