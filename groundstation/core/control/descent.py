"""Failsafe descent: level and down by attitude and speed alone.

No position, no adaptation, no reference. Sans-IO.

The commanded acceleration takes the velocity to (0, 0, sink), with limited tilt; the attitude
follows it by its sine error. Position is not held: the vehicle drifts with the error of the
estimated disturbance. A wrong estimate must not make it climb: an integral of the sink rate's error
outweighs it. A blind descent takes the velocity from the model, leaning against the disturbance
known before; thrust is slightly less than hover thrust, and decreases with time.

Half and double of a constant were flown by `groundstation-sim dev faults paper --state descent`
with `--fault gust`, which as they are goes 1.18 m aside, `--fault "motors: 70 %"`, which meets the
floor at 0.57 m/s, and `--fault "position late" --link mavlink`, at 0.69 m/s. Blind: `--fault
"position frozen: north-west" --state moving`, 4.53 m aside; `--link dsm` with `--fault "position
frozen: x"`, 1.44 m/s, `--fault "mirrored: z"`, 1.79 m/s, and `--fault "position frozen" --state
take-off`, 1.18 m/s.
"""

import math
from operator import mul

from groundstation.core.control.attitude import make_decision, sine_error, specific_thrust
from groundstation.core.control.bring_down import LEAST_SINE
from groundstation.core.geometry import ZERO, Quat, Vec3, third_column
from groundstation.core.messages import Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle

SPEED_GAIN = 1.5
"""Acceleration per error of the speed [1/s]. Half: gust 1.49 m; double: 0.85 m."""
BLIND_SPEED_GAIN = 2.5
"""Acceleration per horizontal speed of the model, which has no noise [1/s]: 4 m/s are braked by g,
the most that ``attitude.TILT_LIMIT_RAD`` gives. Half: north-west 5.98 m; double: 3.69 m."""
ATTITUDE_GAIN = 4.0
"""Body rate per sine of the attitude error [1/s]; the rate lag of the smallest vehicle allows no
more. Half: gust 1.91 m; double: 0.82 m."""
BLIND_ATTITUDE_GAIN = 8.0
"""Body rate per sine of the attitude error in a blind descent, whose attitude is not late [1/s]: a
vehicle that leans along its velocity is turned within .4 s. Half: north-west 5.32 m; double:
5.05 m."""
DISTURBANCE_DOWN_LIMIT_M_S2 = 4.0
"""Largest vertical disturbance that is compensated, down or up [m/s²]: rotors at 0.7 of their
thrust have the effect of 4.2. Half: motors 1.66 m/s; double: 0.29 m/s. Also the limit of
``INTEGRAL_GAIN``'s integral, which so outweighs a wrong estimate. Half and double of that: no
change."""
LARGEST_RISE_SHARE = 0.24
"""Largest commanded upward acceleration, as a share of gravity [-]: late or false poses lead to
more. Half: motors 1.90 m/s; double: 0.53 m/s."""
LARGEST_FALL_SHARE = 0.3
"""Largest commanded downward acceleration by the error of the sink rate, as a share of gravity
[-]. Half: late 0.60 m/s; double: no change."""
INTEGRAL_GAIN = 1.0
"""Acceleration per integral of the sink rate's error [1/s²]. Half: motors 0.71 m/s; double:
0.23 m/s."""
THRUST_LIMIT_DOWN_M_S2 = 3.0
"""Largest downward disturbance that raises the limit of the thrust [m/s²]: that limit is 15.9 m/s²
then, and rotors at 0.7 of their thrust hover at 14.0. Half: motors 1.38 m/s; double: no change. A
blind descent compensates no larger vertical one, down or up: there half and double change
nothing."""
DISTURBANCE_MEAN_S = 0.3
"""Time constant of the mean horizontal disturbance [s]: late or false poses make the estimate
oscillate. Half: gust 0.90 m, late 1.46 m aside for 1.31 m; double: 1.58 m, late 1.18 m."""
DISTURBANCE_DOWN_MEAN_S = 1.0
"""Time constant of the mean vertical disturbance [s]; as above. Half: motors 0.53 m/s,
late 0.90 m/s; double: 1.27 m/s, late 0.56 m/s."""
DISTURBANCE_DROP_M_S2 = 1.5
"""Largest drop of the vertical disturbance below its mean that is compensated at once [m/s²]: a
frozen height makes a larger one. Half: late 0.52 m/s; double: 1.24 m/s."""
BLIND_PULL_M_S2 = 0.5
"""Downward acceleration of a blind descent [m/s²]: 1.4 m/s after 2 m. Half: x 0.97 m/s;
double: 1.97 m/s."""
BLIND_S = 3.0
"""Time after which a blind descent should be over [s]: then its downward acceleration grows.
Half: x 1.53 m/s; double: no change."""
BLIND_PULL_GROWTH_M_S3 = 0.3
"""Growth of that acceleration afterwards [m/s³]: the configured hover thrust is too large.
Half and double: no change."""
BLIND_SINK_GAIN = 4.0
"""Vertical acceleration per error of the model's sink rate: against a climb, and against a sink
rate beyond the planned one, as a large tilt costs height [1/s]. Half: take-off 1.23 m/s; double:
1.14 m/s."""
BLIND_LIFT_M_S = 0.7
"""Integral of its upward part over a blind descent [m/s]: the model has no floor and falls on.
Half: z 1.99 m/s; double: 1.13 m/s."""
BLIND_MEAN_SINK_M_S = 0.7
"""Mean sink rate of a blind descent [m/s]; it gives the time of its end: its height is not
measured."""
BLIND_HELD_S = 1.0
"""Time in addition to that [s]: what holds the vehicle may release it. `--kind honest --fault "hand
holds" --state landing --link dsm` meets the floor at 1.9 m/s; half: 3.4 m/s; double: 1.0 m/s, but
motors that turn on the floor as long as is allowed."""
BLIND_BRAKE_S = 0.5
"""Time in addition for a vehicle that climbs, which nothing holds [s]: braking takes longer than at
its limit. `rotors_mqx --seed 5 --fault "mirrored: z" --state hold --link dsm`: 4.5 m/s; half: 4.9;
double: 3.2, but motors that turn on the floor longer than is allowed."""


def blind_descent_limit_s(height_m: float, climb_m_s: float, gravity: float) -> float:
    """Return how long a blind descent may last [s], which begins with ``climb_m_s`` [m/s].

    It brakes that climb, and sinks from the top. ``height_m`` is the largest height above the floor
    that the vehicle may have at its beginning [m]; ``gravity`` is g [m/s²].
    """
    climb_m_s = max(0.0, climb_m_s)
    climb_s = climb_m_s / (LARGEST_FALL_SHARE * gravity)
    climb_m = 0.5 * climb_s * climb_m_s
    more_s = max(BLIND_HELD_S, climb_s + climb_m / BLIND_MEAN_SINK_M_S + BLIND_BRAKE_S)
    return height_m / BLIND_MEAN_SINK_M_S + more_s


def level(attitude: Quat, disturbance: Vec3, gravity: float) -> Vec3:
    """Return the body rates [rad/s] that level the vehicle, leaning against ``disturbance``
    [m/s², NED].

    ``gravity`` is g [m/s²].
    """
    along, _ = specific_thrust(ZERO, disturbance, gravity)
    return *_turn(attitude, along, ATTITUDE_GAIN), 0.0


def _limit(value: float, largest: float) -> float:
    """Return ``value`` within ±``largest``."""
    return max(-largest, min(value, largest))


def _turn(attitude: Quat, along: Vec3, gain: float) -> tuple[float, float]:
    """Return roll and pitch rate [rad/s] that turn the thrust ``along`` [m/s², NED].

    ``gain`` is the body rate per sine of the attitude error [1/s].
    """
    roll, pitch = sine_error(attitude, along)
    if third_column(attitude)[2] < 0.0:  # beyond 90° the sine decreases: turn as fast as at 90°
        sine = math.hypot(roll, pitch)
        if sine > LEAST_SINE:
            n = 1.0 / sine
            roll, pitch = roll * n, pitch * n
        else:
            roll, pitch = 1.0, 0.0
    return gain * roll, gain * pitch


class Descent:
    """Controller of a failsafe descent (:class:`groundstation.core.messages.Controller`).

    Only the velocity of the reference is used.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        gravity: float,
        disturbance: Vec3,
        effectiveness: float,
        commanded_sink_m_s: float = 0.0,
        present_sink_m_s: float = 0.0,
    ) -> None:
        """Begin the descent.

        Args:
            vehicle: as configured.
            gravity: g [m/s²].
            disturbance: its recent mean [m/s², NED].
            effectiveness: thrust scale before the poses were suspect [-].
            commanded_sink_m_s: commanded sink rate [m/s].
            present_sink_m_s: present sink rate by the model [m/s].
        """
        self._vehicle = vehicle
        self._gravity = gravity
        self._effectiveness = effectiveness
        self.mean_disturbance = disturbance
        """Mean disturbance [m/s², NED]; in a blind descent that at its beginning."""
        self.sink_m_s = commanded_sink_m_s
        """Commanded sink rate of a descent that is not blind [m/s]."""
        self.blind = False
        """Whether the velocity of the poses is not believed."""
        self._integral_m_s2 = 0.0
        self._blind_s = 0.0
        self._planned_m_s = max(0.0, min(present_sink_m_s, commanded_sink_m_s))
        """Planned sink rate of a blind descent [m/s]."""
        self._lift_left_m_s = BLIND_LIFT_M_S
        """Rest of ``BLIND_LIFT_M_S`` [m/s]."""

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Compute one command."""
        motion, vehicle, g = estimate.motion, self._vehicle, self._gravity
        if self.blind:
            down = _limit(self.mean_disturbance[2], THRUST_LIMIT_DOWN_M_S2)
            wanted = self._accelerate_blind(motion.velocity, interval_s)
            gain, effectiveness = BLIND_ATTITUDE_GAIN, self._effectiveness
        else:
            self._average_disturbance(estimate.disturbance, interval_s)
            down = max(self.mean_disturbance[2] - DISTURBANCE_DROP_M_S2, estimate.disturbance[2])
            down = _limit(down, DISTURBANCE_DOWN_LIMIT_M_S2)
            wanted = self._accelerate(motion.velocity, reference.velocity_ned, interval_s)
            gain, effectiveness = ATTITUDE_GAIN, estimate.effectiveness
        along, _ = specific_thrust(wanted, (*self.mean_disturbance[:2], down), g)
        roll, pitch = _turn(motion.attitude, along, gain)
        # The part of the acceleration along the body's axis: no thrust while the vehicle leans the
        # other way.
        lift = max(0.0, sum(map(mul, along, third_column(motion.attitude))))
        hover = g + _limit(self.mean_disturbance[2], THRUST_LIMIT_DOWN_M_S2)
        lift = min(lift, (1.0 + LARGEST_RISE_SHARE) * hover)
        thrust_n = vehicle.mass_kg / effectiveness * lift
        return make_decision(
            vehicle, estimate, reference, thrust_n, (roll, pitch, 0.0), wanted=wanted
        )

    def _average_disturbance(self, disturbance: Vec3, interval_s: float) -> None:
        """Take the estimated disturbance [m/s², NED] into its mean."""
        (north, east, down), (x, y, z) = self.mean_disturbance, disturbance
        aside = interval_s / (interval_s + DISTURBANCE_MEAN_S)
        vertical = interval_s / (interval_s + DISTURBANCE_DOWN_MEAN_S)
        self.mean_disturbance = (
            north + aside * (x - north),
            east + aside * (y - east),
            down + vertical * (z - down),
        )

    def _accelerate(self, velocity: Vec3, wanted: Vec3, interval_s: float) -> Vec3:
        """Return the acceleration [m/s², NED] from ``velocity`` towards ``wanted`` [m/s, NED]."""
        (x, y, z), (north, east, down) = velocity, wanted
        g, step = self._gravity, INTEGRAL_GAIN * (down - z) * interval_s
        self._integral_m_s2 = _limit(self._integral_m_s2 + step, DISTURBANCE_DOWN_LIMIT_M_S2)
        falls = min(LARGEST_FALL_SHARE * g, SPEED_GAIN * (down - z)) + self._integral_m_s2
        return (
            SPEED_GAIN * (north - x),
            SPEED_GAIN * (east - y),
            max(-LARGEST_RISE_SHARE * g, falls),
        )

    def _accelerate_blind(self, velocity: Vec3, interval_s: float) -> Vec3:
        """Return the acceleration [m/s², NED] of a blind descent, by the model's ``velocity``
        [m/s, NED].
        """
        self._blind_s += interval_s
        pull = BLIND_PULL_M_S2 + BLIND_PULL_GROWTH_M_S3 * max(self._blind_s - BLIND_S, 0.0)
        north, east, down = velocity
        self._planned_m_s += pull * interval_s
        pull += self._vehicle.drag_per_s * self._planned_m_s  # the air takes so much of it
        too_fast = max(0.0, min(down - self._planned_m_s, self._lift_left_m_s))
        lift = min(BLIND_SINK_GAIN * too_fast, LARGEST_RISE_SHARE * self._gravity)
        self._lift_left_m_s -= lift * interval_s
        brake = min(BLIND_SINK_GAIN * max(0.0, -down), LARGEST_FALL_SHARE * self._gravity)
        return -BLIND_SPEED_GAIN * north, -BLIND_SPEED_GAIN * east, pull + brake - lift
