"""Limits on a command, applied one after the other behind the controller: each an object with one
reason. Sans-IO.

The vehicle follows false poses. So tilt and thrust are limited wherever a flight does not need
more. A profile lists the limits of its phases, in their order
(:mod:`groundstation.core.control.profiles`).

The constants were chosen. Each was also flown at half and at double its value, by
`groundstation-sim dev faults paper`. Of a share of the hover thrust, the difference from 1 was
halved and doubled; of a cosine, the angle. The cells, with the values below:

- *mirrored*, `--fault "mirrored: x" --state start`: 1.47 m aside, 2.65 m/s;
- *load*, `--fault "load dropped" --state take-off`: 0.12 m up;
- *late*, `--fault "late: 200 ms" --state landing`: meets the floor at 1.41 m/s;
- *gust*, `--fault gust --state landing`: 0.20 m aside;
- *answers*, `--fault "one way silent: answers"`: with `--state tracking` 0.90 m aside, with
  `--state hold` it meets the floor at 0.58 m/s.
"""

import math
from collections.abc import Sequence

import msgspec

from groundstation.core.control.adaptive import Gains
from groundstation.core.control.attitude import clamp_command
from groundstation.core.control.controllers import ControllerConfig
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.control.descent import level
from groundstation.core.geometry import FLOATS, Vec3, third_column
from groundstation.core.messages import Estimate
from groundstation.core.vehicle import ActuatorCommand, Vehicle

FIRST_CLIMB_SHARE = 1.2
"""Largest thrust of the first climb as a share of the hover thrust at lift-off [-], until the
height has responded. Half: mirrored 1.58 m; double: 1.54 m."""
FIRST_CLIMB_S = 1.0
"""Time after lift-off from which the tilt limit is that of transit [s]. Half: mirrored 2.80 m/s;
double: 2.47 m/s."""
FIRST_CLIMB_M = 0.25
"""Height above the place of lift-off at which the first climb is over [m]. Until then the health of
the poses (``ClimbMonitor``) compares the height with the thrust directly, as the state at lift-off
is known. Half: mirrored 1.86 m; double: 1.50 m."""
FIRST_CLIMB_COSINE = math.cos(math.radians(30.0))
"""Cosine of the largest tilt in the first second of a climb, whose response is not known yet [-]:
it holds against a disturbance of 5.7 m/s². Half: mirrored 1.11 m; double: 1.75 m."""
LEAST_THRUST_SHARE = 0.7
"""Least thrust in transit, climb and landing as a share of the hover thrust [-]: the vehicle falls
at .3 g at most, and thrust may still become low enough for touchdown.LOW_SHARE. Half: load 0.17 m,
late 0.46 m/s; double: load 0.10 m, late 0.94 m/s."""
TRANSIT_COSINE = math.cos(math.radians(40.0))
"""Cosine of the largest tilt in transit, climb and landing [-]: it holds against a disturbance of 8
m/s², and follows a mirrored position at .84 g at most. Half: gust 0.92 m; double: no change."""
RATE_GAIN_PER_S = Gains().k_omega
"""Decay of body rates that the tilt limit assumes under a controller of the user's own [1/s]: our
own k_ω."""
LEAST_SINE = 1e-3
"""Least divisor of the thrust limit [-], a sine of the tilt times a cosine: at a smaller tilt no
thrust reaches the limit."""
UPLINK_LOST_SHARE = 0.95
"""Largest thrust while the uplink is lost, as a share of the hover thrust [-]: the vehicle sinks at
``UPLINK_LOST_SINK_M_S`` after 0.8 s. Half: answers, hold 0.56 m/s; double: 0.63 m/s."""
UPLINK_LOST_M_S2 = 1.5
"""Largest vertical disturbance that is compensated while the uplink is lost [m/s²]: it may have
been learnt from commands that did not arrive. Half and double: no change."""
UPLINK_LOST_GAIN = 0.15
"""Factor on the law's rates while the uplink is lost [-]: a loop of 4 1/s that is 1.5 s late is
stable with it. Half: answers, tracking 1.74 m; double: 0.54 m."""
UPLINK_LOST_SINK_M_S = 0.4
"""Sink rate from which thrust is limited to the hover thrust instead, while the uplink is lost
[m/s]. Half: answers, hold 0.56 m/s; double: 0.88 m/s."""


class LimitInput(msgspec.Struct, frozen=True, gc=False):
    """State on which the limits of one command depend."""

    time_s: float
    """Instant at which the command is sent, on the event loop's clock [s]."""
    lifted_s: float
    """Instant of the lift-off [s]; -inf for a flight that begins in the air."""
    pose_down_m: float
    """Position of the newest pose [m, NED]."""
    estimate: Estimate
    """State at the instant at which the command acts."""
    mean_disturbance: Vec3
    """Mean disturbance of the last seconds [m/s², NED]."""
    is_uplink_lost: bool = False
    """Whether commands may not arrive."""
    may_have_contact: bool = False
    """Whether ground contact is possible."""

    @property
    def least_cosine(self) -> float:
        """Cosine of the largest tilt [-]."""
        return FIRST_CLIMB_COSINE if self.time_s - self.lifted_s < FIRST_CLIMB_S else TRANSIT_COSINE


class Limit:
    """One limit of a flight."""

    def __init__(self, vehicle: Vehicle, config: ControllerConfig) -> None:
        self._vehicle, self._gravity = vehicle, config.gravity

    def apply(self, drive: ActuatorCommand, now: LimitInput) -> ActuatorCommand:
        """Return ``drive`` within the limit."""
        raise NotImplementedError


class FirstClimbLimit(Limit):
    """Thrust in the first climb: little above hover until the height has responded.

    With the poses of another body, which does not rise, the law would raise the thrust further.
    """

    def __init__(self, vehicle: Vehicle, config: ControllerConfig) -> None:
        super().__init__(vehicle, config)
        self.lifted_s = -math.inf
        """Instant of the lift-off [s]; -inf for a flight that begins in the air."""
        self._climbed_s = -math.inf
        """End of the first climb [s]; inf before it, -inf for a flight without one."""
        self._hover_n = self._lifted_down_m = 0.0

    def lift_off(self, time_s: float, hover_n: float, down_m: float) -> None:
        """Begin the first climb at ``down_m`` [m, NED].

        ``hover_n`` is the estimated hover thrust [N].
        """
        self.lifted_s, self._climbed_s = time_s, math.inf
        self._hover_n, self._lifted_down_m = hover_n, down_m

    @property
    def has_lifted_off(self) -> bool:
        """Whether the flight began on the floor, and has left it."""
        return self.lifted_s > -math.inf

    def find_climbed_s(self, time_s: float) -> float:
        """Return the time since the end of the first climb [s]; -inf before it, and without one."""
        return time_s - self._climbed_s if self.has_lifted_off else -math.inf

    def apply(self, drive: ActuatorCommand, now: LimitInput) -> ActuatorCommand:
        """Return ``drive`` with no more thrust than the first climb allows; see :class:`Limit`."""
        if self._climbed_s < math.inf:
            return drive
        if self._lifted_down_m - now.pose_down_m > FIRST_CLIMB_M:
            self._climbed_s = now.time_s
            return drive
        return drive._replace(thrust=min(drive.thrust, FIRST_CLIMB_SHARE * self._hover_n))


class TiltLimit(Limit):
    """Tilt in transit: false poses accelerate the vehicle sideways no harder than a
    disturbance needs.
    """

    def __init__(self, vehicle: Vehicle, config: ControllerConfig) -> None:
        super().__init__(vehicle, config)
        self._limits = DemandLimits(FLOATS, vehicle)
        self._rate_gain = config.k_omega if isinstance(config, Gains) else RATE_GAIN_PER_S

    def apply(self, drive: ActuatorCommand, now: LimitInput) -> ActuatorCommand:
        """Return ``drive`` with rates that exceed no tilt; see :class:`Limit`."""
        motion, (thrust, (roll, pitch, yaw)) = now.estimate.motion, drive
        roll, pitch, _ = self._limits.limit_tilt(
            motion.attitude, motion.rates, (roll, pitch), now.least_cosine, self._rate_gain
        )
        return self._limits.clamp(thrust, (roll, pitch, yaw))[0]


class ThrustLimit(Limit):
    """Thrust in transit: the vehicle falls by no more than LEAST_THRUST_SHARE allows, and
    accelerates sideways by no more than at the tilt limit.
    """

    def apply(self, drive: ActuatorCommand, now: LimitInput) -> ActuatorCommand:
        """Return ``drive`` with thrust between both bounds; see :class:`Limit`."""
        down_m_s2, cosine = now.mean_disturbance[2], now.least_cosine
        newtons_per_m_s2 = self._vehicle.mass_kg / now.estimate.effectiveness
        # The least thrust follows the present disturbance: its mean is late where a hand lifts the
        # vehicle. Only an upward disturbance counts: a downward gust may be over by now, and more
        # thrust would hold the vehicle up.
        weight_m_s2 = self._gravity + min(now.estimate.disturbance[2], 0.0)
        least = min(LEAST_THRUST_SHARE * newtons_per_m_s2 * weight_m_s2, self._vehicle.thrust_max_n)
        # The horizontal part of thrust at this tilt, thrust * sin(tilt), is at most that of level
        # flight at the tilt limit, hover_n * sin(limit) / cos(limit).
        sine = math.hypot(*third_column(now.estimate.motion.attitude)[:2])
        hover_n = newtons_per_m_s2 * (self._gravity + down_m_s2)
        most = hover_n * math.sqrt(1.0 - cosine * cosine) / max(sine * cosine, LEAST_SINE)
        return drive._replace(thrust=max(min(drive.thrust, most), least))


class LevelNearGround(Limit):
    """Rates that only level while ground contact is possible: lateral control would tip a vehicle
    on the floor.
    """

    def apply(self, drive: ActuatorCommand, now: LimitInput) -> ActuatorCommand:
        """Return ``drive`` with rates towards level; see :class:`Limit`."""
        if not now.may_have_contact:
            return drive
        rates = level(now.estimate.motion.attitude, now.mean_disturbance, self._gravity)
        return clamp_command(self._vehicle, drive.thrust, rates)[0]


class UplinkLostLimit(Limit):
    """Gentle commands while the uplink is lost: each may arrive late, or not at all."""

    def find_hover_n(self, estimate: Estimate) -> float:
        """Return the hover thrust, with a limited disturbance [N]."""
        down = max(-UPLINK_LOST_M_S2, min(estimate.disturbance[2], UPLINK_LOST_M_S2))
        return self._vehicle.mass_kg / estimate.effectiveness * (self._gravity + down)

    def apply(self, drive: ActuatorCommand, now: LimitInput) -> ActuatorCommand:
        """Return ``drive`` with slightly less than hover thrust at most, and small rates; see
        :class:`Limit`.
        """
        if not now.is_uplink_lost:
            return drive
        thrust, (roll, pitch, yaw) = drive
        share = UPLINK_LOST_SHARE if now.estimate.motion.velocity[2] < UPLINK_LOST_SINK_M_S else 1.0
        most, k = share * self.find_hover_n(now.estimate), UPLINK_LOST_GAIN
        return ActuatorCommand(min(thrust, most), (k * roll, k * pitch, k * yaw))


class FlightLimits:
    """The limits of one flight, an object of each kind."""

    def __init__(self, vehicle: Vehicle, config: ControllerConfig) -> None:
        self.first_climb = FirstClimbLimit(vehicle, config)
        self.uplink = UplinkLostLimit(vehicle, config)
        transit = TiltLimit(vehicle, config), ThrustLimit(vehicle, config)
        limits: tuple[Limit, ...] = (
            self.first_climb,
            *transit,
            LevelNearGround(vehicle, config),
            self.uplink,
        )
        self._limits = {type(limit): limit for limit in limits}

    def apply(
        self, kinds: Sequence[type[Limit]], drive: ActuatorCommand, now: LimitInput
    ) -> ActuatorCommand:
        """Return ``drive`` within the limits of these ``kinds``, one after the other."""
        for kind in kinds:
            drive = self._limits[kind].apply(drive, now)
        return drive
