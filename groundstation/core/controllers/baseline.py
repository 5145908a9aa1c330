"""What the baselines share: heading, limits, and how a wanted push and turn leave as a command.

They fly on the same estimate as our controller: position, velocity, attitude and modelled thrust at the instant the
command acts, and the observer's disturbance d̂. So a comparison with them is one of control laws.
"""

import math
from typing import Annotated

import msgspec

from groundstation.core.control import decided, length, yaw_rate
from groundstation.core.estimation import Estimation, NonNegative, Positive
from groundstation.core.geometry import FLOATS, Vec3
from groundstation.core.messages import Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle, lead


class Baseline(Estimation, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys that every baseline has."""

    k_yaw: NonNegative = 1.0
    """Heading gain [1/s], as ours."""
    tilt_limit_deg: Annotated[float, msgspec.Meta(gt=0.0, le=80.0)] = 45.0
    """Largest tilt to ask for [deg]; PX4's default."""
    actuator_compensation: bool = False
    """Invert the lags of thrust and body rates, as ours does; off, as the baselines are published.

    docs/decisions/0006-baselines.md says what happens with it, and has the gains for it."""
    k_omega: Positive = 14.0
    """With it: how fast an error of thrust or body rate shall decay [1/s], as ours."""
    rate_feedforward: NonNegative = 0.03
    """With it: time constant of the filter on the derivative of what is wanted [s], as ours."""


class Outlet:
    """Turns a wanted push and turn into a decision. State: what was wanted last, and its derivative."""

    def __init__(self, vehicle: Vehicle, gains: Baseline) -> None:
        """Take the vehicle as told, and the keys that all baselines share."""
        self._vehicle = vehicle
        self._gains = gains
        self._yaw_limit = math.radians(vehicle.rate_limits_deg_s[2])
        lags = (vehicle.thrust_lag_s, *(vehicle.rate_lag_s,) * 3)
        self._leads = [lead(FLOATS, vehicle.frame_period_s, lag) if lag > 0.0 else 0.0 for lag in lags]
        self._wanted: list[float] | None = None
        self._slopes = [0.0] * 4

    def decide(
        self,
        estimate: Estimate,
        reference: Reference,
        interval_s: float,
        *,
        push: Vec3,
        turn: tuple[float, float],
        disturbance: Vec3,
    ) -> Decision:
        """The decision that takes thrust to m |push| and the body rates about x and y to ``turn`` [rad/s]."""
        motion, gravity = estimate.motion, self._gains.gravity
        heading = yaw_rate(
            FLOATS,
            attitude=motion.attitude,
            yaw=reference.yaw_rad,
            yaw_dot=reference.yaw_rate_rad_s,
            rate_y=turn[1],
            k_yaw=self._gains.k_yaw,
            limit=self._yaw_limit,
        )
        wanted = [self._vehicle.mass_kg / estimate.effectiveness * length(push), *turn, heading]
        if self._gains.actuator_compensation:
            wanted = self._led([motion.thrust, *motion.rates], wanted, interval_s)
        thrust, x, y, z = wanted
        return decided(
            self._vehicle,
            estimate,
            reference,
            thrust,
            (x, y, z),
            wanted=(disturbance[0] - push[0], disturbance[1] - push[1], gravity + disturbance[2] - push[2]),
            disturbance=disturbance,
        )

    def _led(self, now: list[float], wanted: list[float], interval: float) -> list[float]:
        """Thrust and rates to command so that the true ones follow ``wanted`` through their lags (see actuators)."""
        gains, last = self._gains, self._wanted
        if last is not None and interval > 0.0:
            k = interval / (interval + gains.rate_feedforward)
            self._slopes = [
                slope + k * ((new - old) / interval - slope)
                for slope, new, old in zip(self._slopes, wanted, last, strict=True)
            ]
        self._wanted = wanted
        return [
            is_now + n * (gains.k_omega * (goal - is_now) + slope) if n > 0.0 else goal
            for is_now, goal, slope, n in zip(now, wanted, self._slopes, self._leads, strict=True)
        ]
