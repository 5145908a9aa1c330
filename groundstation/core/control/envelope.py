"""Envelope: limits of the commands while the response of the poses is not known. Sans-IO.

The vehicle follows false poses. So tilt and thrust are limited where a flight does not need more: in the first climb,
in a transit, and in a landing.
"""

import math

from groundstation.core.control.adaptive import Gains
from groundstation.core.control.controllers import ControllerConfig
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.geometry import FLOATS, third_column
from groundstation.core.messages import Decision, Estimate
from groundstation.core.vehicle import ActuatorCommand, Vehicle

FIRST_CLIMB_SHARE = 1.2
"""Largest thrust of the first climb as a share of the hover thrust at lift-off [-], until the height has responded."""
FIRST_CLIMB_S = 1.0
"""Time after which that limit begins to grow [s]."""
FIRST_CLIMB_GROWS = 0.5
"""Growth of that limit [1/s]."""
FIRST_CLIMB_M = 0.25
"""Height at which the first climb is over [m]."""
FIRST_CLIMB_COSINE = math.cos(math.radians(30.0))
"""Cosine of the largest tilt in the first second of a climb, whose response is not known yet [-]: it holds against a
wind of 5.7 m/s²."""
LOW_SHARE = 0.7
"""Least thrust in transit, climb and landing as a share of the hover thrust [-]: the vehicle falls at .3 g at most, and
touchdown.LOW_SHARE still detects the floor."""
TRANSIT_COSINE = math.cos(math.radians(40.0))
"""Cosine of the largest tilt in transit, climb and landing [-]: it holds against a wind of 8 m/s², and follows a
mirrored position at .84 g at most."""
RATE_GAIN_PER_S = 14.0
"""Decay of body rates under another controller than ours [1/s]: our own k_ω."""

SMALL = 1e-3
"""Least sine of a tilt that divides [-]."""


class Envelope:
    """Envelope of one flight. Times are on the event loop's clock [s]."""

    def __init__(self, vehicle: Vehicle, config: ControllerConfig) -> None:
        self._vehicle, self._gravity = vehicle, config.gravity
        self._limits = DemandLimits(FLOATS, vehicle)
        self._rate_gain = config.k_omega if isinstance(config, Gains) else RATE_GAIN_PER_S
        self._lifted_s = self._climbed_s = -math.inf
        self._hover_n = self._lifted_down_m = 0.0

    def lift_off(self, time_s: float, hover_n: float, down_m: float) -> None:
        """Begin the first climb at ``down_m`` [m, NED]; ``hover_n`` is the estimated hover thrust [N]."""
        self._lifted_s, self._climbed_s = time_s, math.inf
        self._hover_n, self._lifted_down_m = hover_n, down_m

    @property
    def has_lifted_off(self) -> bool:
        """Whether the flight began on the floor."""
        return self._lifted_s > -math.inf

    def has_climbed_for(self, time_s: float) -> float:
        """Return the time since the end of the first climb at ``time_s`` [s]; below 0 before it."""
        return time_s - self._climbed_s if self.has_lifted_off else -math.inf

    def limit_first_climb(self, time_s: float, down_m: float, decision: Decision) -> Decision:
        """Return ``decision`` with no more thrust than the first climb allows; ``down_m`` is the newest pose's [m]."""
        if self._climbed_s < math.inf:
            return decision
        if self._lifted_down_m - down_m > FIRST_CLIMB_M:
            self._climbed_s = time_s
            return decision
        thrust, rates = decision.drive
        grows = FIRST_CLIMB_GROWS * max(time_s - self._lifted_s - FIRST_CLIMB_S, 0.0)
        most = self._hover_n * (FIRST_CLIMB_SHARE + grows)
        return decision._replace(drive=ActuatorCommand(min(thrust, most), rates))

    def limit_transit(self, time_s: float, decision: Decision, estimate: Estimate, wind_down_m_s2: float) -> Decision:
        """Return ``decision`` with limited tilt and least thrust, whatever the poses are."""
        motion, vehicle = estimate.motion, self._vehicle
        per_m_s2 = vehicle.mass_kg / estimate.effectiveness
        hover_n = per_m_s2 * (self._gravity + wind_down_m_s2)
        thrust, (roll, pitch, yaw) = decision.drive
        # A downward gust may be over by now: its mean would hold the vehicle up.
        least = min(LOW_SHARE * per_m_s2 * (self._gravity + min(wind_down_m_s2, 0.0)), vehicle.thrust_max_n)
        cosine = FIRST_CLIMB_COSINE if time_s - self._lifted_s < FIRST_CLIMB_S else TRANSIT_COSINE
        roll, pitch, _ = self._limits.limit_tilt(motion.attitude, motion.rates, (roll, pitch), cosine, self._rate_gain)
        # The horizontal acceleration is no larger than at that tilt in level flight.
        across = math.hypot(*third_column(motion.attitude)[:2]) * cosine
        most = hover_n * math.sqrt(1.0 - cosine * cosine) / max(across, SMALL)
        return decision._replace(drive=self._limits.clamp(max(min(thrust, most), least), (roll, pitch, yaw))[0])
