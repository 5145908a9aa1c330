"""A vehicle in calm air by the controller's own model, for tests of what rests on it."""

from groundstation.core.geometry import FLOATS, ZERO
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, integrate

GRAVITY = 9.81


def fly_on(vehicle: Vehicle, motion: Motion, drive: ActuatorCommand, duration_s: float) -> Motion:
    """Return the motion after ``duration_s`` [s] of one command."""
    return integrate(
        FLOATS, motion, drive, duration_s,
        mass=vehicle.mass_kg, gravity=GRAVITY, disturbance=ZERO, drag=vehicle.drag_per_s,
        thrust_lag=vehicle.thrust_lag_s, rate_lag=vehicle.rate_lag_s,
    )  # fmt: skip
