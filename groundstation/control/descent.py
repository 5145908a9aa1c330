"""Failsafe descent: level and down by attitude and speed alone. No position, no adaptation, no reference. Sans-IO.

The push that takes the velocity to (0, 0, sink), tilted a little at most; the attitude follows it by its sine error.
It holds no place: what is left of the wind's estimate, it drifts with. Blind, it asks the speed for nothing either: it
levels into the wind it knew and pushes a little less than what hovers.
"""

import math

from groundstation.control.attitude import length, push, sine_error
from groundstation.control.decision import decided
from groundstation.control.port import Decision, Estimate
from groundstation.ops import Vec3
from groundstation.so3 import third_column
from groundstation.trajectories.port import Reference
from groundstation.vehicle import Vehicle

SPEED_GAIN = 1.5
"""Acceleration per error of the speed [1/s]."""
ATTITUDE_GAIN = 4.0
"""Body rate per sine of the attitude error [1/s]; the rate lag of the smallest vehicle allows no more."""
LEAN = math.radians(15.0)
"""Largest tilt that it asks for [rad]."""
WIND_LIMIT_M_S2 = 4.0
"""Of an estimated disturbance no more is believed, on each axis."""
BLIND_PULL_M_S2 = 0.35
"""Downward acceleration that it asks for when blind: 1.2 m/s after 2 m."""


class Descent:
    """Implements :class:`groundstation.control.port.Controller`; of the reference only speed and heading count."""

    def __init__(self, vehicle: Vehicle, gravity: float) -> None:
        """Take the vehicle as told, and g [m/s²]."""
        self._vehicle = vehicle
        self._gravity = gravity
        self.blind = False
        """True where speed is not to be believed."""

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command."""
        motion, g = estimate.motion, self._gravity
        x, y, z = (max(-WIND_LIMIT_M_S2, min(WIND_LIMIT_M_S2, d)) for d in estimate.disturbance)
        wanted: Vec3 = (0.0, 0.0, BLIND_PULL_M_S2)
        if not self.blind:
            (a, b, c), (u, v, w) = motion.velocity, reference.velocity_ned
            k = SPEED_GAIN
            wanted = (k * (u - a), k * (v - b), max(-0.5 * g, min(0.3 * g, k * (w - c))))
        along, _ = push(wanted, (x, y, z), g, LEAN)
        roll, pitch = sine_error(motion.attitude, along)
        upright = third_column(motion.attitude)[2]
        if upright < 0.0:  # beyond 90° the sine falls again: turn as hard as at 90°
            n = 1.0 / max(math.hypot(roll, pitch), 1e-6)
            roll, pitch = (roll * n, pitch * n) if n < 1e6 else (1.0, 0.0)
        mass = self._vehicle.mass_kg / estimate.effectiveness
        # A leaning vehicle lifts less, one far over nothing that helps.
        lift = length(along) / max(upright, 0.7) if upright > 0.3 else 0.0
        return decided(
            self._vehicle,
            estimate,
            reference,
            mass * lift,
            (ATTITUDE_GAIN * roll, ATTITUDE_GAIN * pitch, 0.0),
            wanted=wanted,
        )
