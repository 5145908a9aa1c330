"""Limits on what the law demands, applied after it, vertical axis first: tilt, thrust, rates.

The law knows no limits of the vehicle. A demand beyond them is cut in this order:

1. Tilt. With c the cosine of the tilt, full thrust has the vertical part T_max c. It must suffice
   for the vertical axis, so c stays above c_min (:meth:`DemandLimits.find_least_cosine`). Rates
   change c by c˙ = r31 ω2 - r32 ω1. They are changed as little as possible so that c, predicted
   until the present rates have decayed, approaches c_min and does not pass it
   (:meth:`DemandLimits.limit_tilt`), no faster than rates follow commands that are held for a
   frame.
2. Thrust, clamped to the vehicle's limits. The law is evaluated a moment later with the rate at
   which thrust can still change (:meth:`DemandLimits.limit_thrust_rate`).
3. Body rates, clamped per axis; the yaw rate also changes slowly (:meth:`DemandLimits.limit_yaw`).

A demand inside the limits is unchanged, to the bit. Derivation: docs/explanation/law.md,
section 6.4. Elementwise: floats, or arrays of shape (N,). Sans-IO.
"""

import math
from typing import Any

from groundstation.core.geometry import Ops, Quat, Real, Vec3, third_column
from groundstation.core.vehicle import ActuatorCommand, Vehicle

RESERVE = 1.03
"""Vertical part of the full thrust at the tilt limit as a share of the hover thrust, at rest [-]:
less than 1.08, the weakest vehicle that is flown (rotors with 0.62 of the configured thrust)."""
LEAST_COSINE = math.cos(math.radians(80.0))
"""Cosine of the largest tilt of any vehicle [-]: beyond it the heading loop loses its axis."""
LEAST_SINE_SQUARED = 0.04
"""Squared sine of the tilt below which a rate changes c too little to divide by it [-]: near level,
where nothing is limited, and upside down, where the rate limits act."""
YAW_RAD_S2 = 2.5
"""Largest yaw acceleration [rad/s²]: on `rotors_quad1kg` that takes a fifth of the rotors' thrust
in hover. Rotors turn a vehicle about z by their drag, ten times weaker than by their arms."""


class DemandLimits:
    """Limits of one configured vehicle, or of N with the same configuration."""

    def __init__(self, ops: Ops, vehicle: Vehicle) -> None:
        self._ops, self._vehicle = ops, vehicle
        x, y, z = vehicle.rate_limits_deg_s
        self.rates: Vec3 = (math.radians(x), math.radians(y), math.radians(z))
        """Largest body rates [rad/s]."""

    def find_least_cosine(
        self, attitude: Quat, thrust: Real, effectiveness: Real, weight: Real, vertical: Real
    ) -> Real:
        """Return c_min, the cosine of the largest tilt at which thrust suffices for the vertical
        axis.

        Args:
            attitude: body to world.
            thrust: T, present thrust [N].
            effectiveness: λ̂, estimated thrust scale [-].
            weight: g + d̂_z, downward acceleration of everything but thrust [m/s²].
            vertical: further acceleration demanded downwards, p¨d + u* + c v [m/s²].
        """
        clamp, vehicle = self._ops.clamp, self._vehicle
        up = third_column(attitude)[2] * thrust / vehicle.mass_kg
        # λ̂ and d̂_z are not observable apart: missing thrust counts as weight.
        hover = RESERVE * (weight + (1.0 - effectiveness) * up)
        most = vehicle.thrust_max_n / vehicle.mass_kg
        level = clamp(hover / most, LEAST_COSINE, 1.0)
        # Climbing and falling move the limit by half of the range on either side.
        low, high = clamp(0.5 * level, LEAST_COSINE, 1.0), 0.5 * (level + 1.0)
        return clamp((hover - vertical) / most, low, high)

    def limit_tilt(
        self,
        attitude: Quat,
        rates: Vec3,
        wanted: tuple[Real, Real],
        least_cosine: Real,
        k_omega: float,
    ) -> tuple[Real, Real, Any]:
        """Return roll and pitch rate [rad/s] that keep c above ``least_cosine``, and whether they
        were limited.

        Args:
            attitude: body to world.
            rates: present body rates [rad/s].
            wanted: roll and pitch rate of the law [rad/s].
            least_cosine: c_min [-].
            k_omega: decay of an error of the rates [1/s].
        """
        ops, (w, x, y, z), (roll_rate, pitch_rate) = self._ops, attitude, wanted
        r31, r32 = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
        cosine = 1.0 - 2.0 * (x * x + y * y)
        stopped = cosine + (r31 * rates[1] - r32 * rates[0]) / k_omega
        approach = max(1.0 / self._vehicle.frame_period_s - k_omega, k_omega) * (
            stopped - least_cosine
        )
        spare = r31 * pitch_rate - r32 * roll_rate + approach
        limited = spare < 0.0
        k = spare / ops.clamp(r31 * r31 + r32 * r32, LEAST_SINE_SQUARED, 1.0)
        return (
            ops.where(limited, roll_rate + k * r32, roll_rate),
            ops.where(limited, pitch_rate - k * r31, pitch_rate),
            limited,
        )

    def limit_yaw(self, rate: Real, wanted: Real) -> Real:
        """Return the yaw rate [rad/s] nearest to ``wanted`` that the vehicle takes on from the
        present ``rate`` by ``YAW_RAD_S2``.

        At the rotors' limits, more would reduce the torque for roll and pitch.
        """
        reach = YAW_RAD_S2 * max(self._vehicle.rate_lag_s, self._vehicle.frame_period_s)
        return self._ops.clamp(wanted, rate - reach, rate + reach)

    def limit_thrust_rate(self, thrust: Real, thrust_rate: Real, lead_s: float) -> Real:
        """Return Ṫ [N/s] within the thrust limits, where T_cmd = T + ``lead_s`` Ṫ (law.md, 6.4)."""
        ops, vehicle = self._ops, self._vehicle
        wanted = thrust + lead_s * thrust_rate
        inside = ops.clamp(wanted, vehicle.thrust_min_n, vehicle.thrust_max_n)
        return ops.where(inside == wanted, thrust_rate, (inside - thrust) / lead_s)

    def clamp(self, thrust: Real, rates: Vec3) -> tuple[ActuatorCommand, Any]:
        """Return a command within the vehicle's limits, and whether any of the four was clamped."""
        vehicle, clamp, (x, y, z), (a, b, c) = self._vehicle, self._ops.clamp, rates, self.rates
        inside = clamp(thrust, vehicle.thrust_min_n, vehicle.thrust_max_n)
        p, q, r = clamp(x, -a, a), clamp(y, -b, b), clamp(z, -c, c)
        cut = (inside != thrust) | (p != x) | (q != y) | (r != z)
        return ActuatorCommand(inside, (p, q, r)), cut

    def is_at_limit(self, drive: ActuatorCommand) -> Any:
        """Whether any of the four is at one of the vehicle's limits."""
        vehicle, (x, y, z), (a, b, c) = self._vehicle, drive.rates, self.rates
        pinned = (drive.thrust <= vehicle.thrust_min_n) | (drive.thrust >= vehicle.thrust_max_n)
        return pinned | (abs(x) >= a) | (abs(y) >= b) | (abs(z) >= c)
