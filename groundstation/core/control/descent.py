"""Failsafe descent: level and down by attitude and speed alone.

No position, no adaptation, no reference. Sans-IO.

The commanded acceleration takes the velocity to (0, 0, sink), with limited tilt; the attitude
follows it by its sine error. Position is not held: the vehicle drifts with the error of the wind
estimate. A wrong estimate must not make it climb: an integral of the sink rate's error outweighs
it. A blind descent takes the velocity from the model, leaning into the wind known before; thrust is
slightly less than hover thrust, and decreases with time.
"""

import math
from operator import mul

from groundstation.core.control.attitude import make_decision, push, sine_error
from groundstation.core.geometry import Quat, Vec3, third_column
from groundstation.core.messages import Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle

SPEED_GAIN = 1.5
"""Acceleration per error of the speed [1/s]."""
BLIND_SPEED_GAIN = 2.5
"""Acceleration per error of the model's speed, which has no noise [1/s]: 4 m/s are braked within
1 m."""
ATTITUDE_GAIN = 4.0
"""Body rate per sine of the attitude error [1/s]; the rate lag of the smallest vehicle allows no
more."""
BLIND_ATTITUDE_GAIN = 8.0
"""Body rate per sine of the attitude error in a blind descent, whose attitude is not late [1/s]: a
vehicle that leans along its velocity is turned within .4 s."""
LEAN = math.radians(45.0)
"""Largest commanded tilt [rad]: enough to hold and brake against a wind of 8 m/s²."""
WIND_LIMIT_M_S2 = 8.0
"""Largest horizontal disturbance that is compensated, on each axis [m/s²]: a gust front of 8."""
WIND_DOWN_M_S2 = 4.0
"""Largest downward disturbance that is compensated [m/s²]: rotors at 0.7 of their thrust have the
effect of 4.2."""
MOST = 0.24
"""Largest commanded upward acceleration, as a share of gravity [-]: late or false poses lead to
more."""
INTEGRAL_GAIN = 1.0
"""Acceleration per integral of the sink rate's error [1/s²]."""
INTEGRAL_LIMIT_M_S2 = 6.0
"""Largest acceleration of that integral [m/s²]: more than any disturbance that is compensated."""
HEAVIER_M_S2 = 3.0
"""Largest downward disturbance that is lifted against with valid poses [m/s²]: rotors at 0.7 of
their thrust have the effect of 4.2."""
WIND_S = 0.3
"""Time constant of the mean horizontal disturbance [s]: late or false poses make the estimate
oscillate."""
HEAVIER_S = 1.0
"""Time constant of the mean downward disturbance [s]; as above."""
LIGHTER_M_S2 = 1.5
"""Drop of the downward disturbance below its mean that is not compensated at once [m/s²]: a frozen
height makes one."""
BLIND_PULL_M_S2 = 0.5
"""Downward acceleration of a blind descent [m/s²]: 1.4 m/s after 2 m."""
BLIND_S = 3.0
"""Time after which a blind descent should be over [s]: then its downward acceleration grows."""
BLIND_MORE_M_S3 = 0.3
"""Growth of that acceleration afterwards [m/s³]: the configured hover thrust is too large."""
BLIND_BRAKE_GAIN = 2.0
"""Acceleration down per climb rate of the model [1/s]."""
BLIND_BRAKE_M_S2 = 2.0
"""Largest acceleration down that brakes a climb in a blind descent [m/s²]."""
BLIND_LIFT_GAIN = 4.0
"""Upward acceleration per sink rate of the model beyond the planned one [1/s]: a large tilt costs
height."""
BLIND_BRAKES_M_S = 0.7
"""Largest total braking of a blind descent [m/s]: the model has no floor and falls on."""
BLIND_LIFT_M_S2 = 1.8
"""Largest upward acceleration of that braking [m/s²]."""
BLIND_WIND_M_S2 = 1.5
"""Largest downward disturbance that is compensated in a blind descent [m/s²]."""


def level(attitude: Quat, wind: Vec3, gravity: float) -> Vec3:
    """Return the body rates [rad/s] that level the vehicle into ``wind`` [m/s², NED].

    ``gravity`` is g [m/s²].
    """
    return *_lean(attitude, push((0.0, 0.0, 0.0), wind, gravity, LEAN)[0]), 0.0


def _lean(attitude: Quat, along: Vec3, gain: float = ATTITUDE_GAIN) -> tuple[float, float]:
    """Return roll and pitch rate [rad/s] that turn the thrust ``along`` [m/s², NED]."""
    roll, pitch = sine_error(attitude, along)
    if third_column(attitude)[2] < 0.0:  # beyond 90° the sine decreases: turn as fast as at 90°
        n = 1.0 / max(math.hypot(roll, pitch), 1e-6)
        roll, pitch = (roll * n, pitch * n) if n < 1e6 else (1.0, 0.0)
    return gain * roll, gain * pitch


class Descent:
    """Controller of a failsafe descent (:class:`groundstation.core.messages.Controller`).

    Only velocity and heading of the reference are used.
    """

    def __init__(
        self, vehicle: Vehicle, gravity: float, wind: Vec3, effectiveness: float,
        sink_m_s: float = 0.0,
        sinks_m_s: float = 0.0,
    ) -> None:  # fmt: skip
        """Take the configured vehicle and g [m/s²].

        Args:
            vehicle: as configured.
            gravity: g [m/s²].
            wind: recent mean disturbance [m/s², NED].
            effectiveness: thrust scale before the poses were suspect [-].
            sink_m_s: commanded sink rate [m/s].
            sinks_m_s: present sink rate by the model [m/s].
        """
        self._vehicle = vehicle
        self._gravity = gravity
        self._effectiveness = effectiveness
        self.wind = wind
        """Mean disturbance [m/s², NED]; in a blind descent that at its beginning."""
        self.sink_m_s = sink_m_s
        """Commanded sink rate of a descent that is not blind [m/s]."""
        self.blind = False
        """Whether the velocity of the poses is not believed."""
        self._integral = self._blind_s = 0.0
        self._planned_m_s = max(0.0, min(sinks_m_s, sink_m_s))
        self._brakes_m_s = BLIND_BRAKES_M_S

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Compute one command."""
        motion, g = estimate.motion, self._gravity
        (a, b, c), k, m = (
            self.wind,
            interval_s / (interval_s + WIND_S),
            interval_s / (interval_s + HEAVIER_S),
        )
        x, y, z = estimate.disturbance
        if not self.blind:
            self.wind = a, b, c = a + k * (x - a), b + k * (y - b), c + m * (z - c)
        down = BLIND_WIND_M_S2 if self.blind else WIND_DOWN_M_S2
        x, y = (max(-WIND_LIMIT_M_S2, min(WIND_LIMIT_M_S2, d)) for d in (a, b))
        z = max(-down, min(c if self.blind else max(c - LIGHTER_M_S2, z), down))
        if self.blind:
            self._blind_s += interval_s
            pull = BLIND_PULL_M_S2 + BLIND_MORE_M_S3 * max(self._blind_s - BLIND_S, 0.0)
            u, v, w = motion.velocity  # the model's, which takes no position from the poses
            self._planned_m_s += pull * interval_s
            too_fast = max(0.0, min(w - self._planned_m_s, self._brakes_m_s))
            lift = min(BLIND_LIFT_GAIN * too_fast, BLIND_LIFT_M_S2)
            self._brakes_m_s -= lift * interval_s
            brake = min(-BLIND_BRAKE_GAIN * w, BLIND_BRAKE_M_S2) if w < 0.0 else -lift
            wanted: Vec3 = (-BLIND_SPEED_GAIN * u, -BLIND_SPEED_GAIN * v, pull + brake)
        else:
            (a, b, c), (u, v, w) = motion.velocity, reference.velocity_ned
            k, limit = SPEED_GAIN, INTEGRAL_LIMIT_M_S2
            self._integral = max(
                -limit, min(limit, self._integral + INTEGRAL_GAIN * (w - c) * interval_s)
            )
            down = max(-MOST * g, min(0.3 * g, k * (w - c)) + self._integral)
            wanted = (k * (u - a), k * (v - b), down)
        along, _ = push(wanted, (x, y, z), g, LEAN)
        roll, pitch = _lean(
            motion.attitude, along, BLIND_ATTITUDE_GAIN if self.blind else ATTITUDE_GAIN
        )
        mass = self._vehicle.mass_kg / (
            self._effectiveness if self.blind else estimate.effectiveness
        )
        limit = BLIND_WIND_M_S2 if self.blind else HEAVIER_M_S2
        heavier = max(-limit, min(self.wind[2], limit))
        # The part of the acceleration along the body's axis: no thrust while the vehicle leans the
        # other way.
        lift = max(0.0, sum(map(mul, along, third_column(motion.attitude))))
        lift = min(lift, (1.0 + MOST) * (g + heavier))
        return make_decision(
            self._vehicle, estimate, reference, mass * lift, (roll, pitch, 0.0), wanted=wanted
        )
