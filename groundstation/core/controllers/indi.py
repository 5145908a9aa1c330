"""Baseline: incremental nonlinear dynamic inversion (INDI) of the acceleration.

E. Tal, S. Karaman, "Accurate tracking of aggressive quadrotor trajectories using incremental nonlinear dynamic
inversion and differential flatness", CDC 2018 / TCST 2021: the thrust vector is changed by as much as the acceleration
is off, both through the same low-pass filter; the attitude follows by proportional control, with the turn that the
reference's jerk asks for fed forward. There is no accelerometer here: the acceleration is the observer's.
"""

import math

from groundstation.core.control import acceleration, half_angle_error, push, turning
from groundstation.core.controllers.baseline import Baseline, Outlet
from groundstation.core.estimation import NonNegative, Positive
from groundstation.core.geometry import Vec3, third_column
from groundstation.core.messages import Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle


class Indi(Baseline, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="indi"):
    """Gains, found by a search: docs/decisions/0006-baselines.md."""

    k_position: Positive = 17.8
    """K_x [1/s²]."""
    k_velocity: Positive = 6.36
    """K_v [1/s]."""
    k_acceleration: NonNegative = 0.95
    """K_a [-]."""
    filter_s: NonNegative = 0.0041
    """Time constant of the low-pass filter on acceleration and thrust vector [s]."""
    k_attitude: Positive = 18.3
    """Body rate per attitude error [1/s]."""

    def build(self, vehicle: Vehicle) -> "IndiController":
        """The controller."""
        return IndiController(vehicle, self)


class IndiController:
    """State: the filtered acceleration and thrust vector."""

    def __init__(self, vehicle: Vehicle, gains: Indi) -> None:
        """Start with empty filters: they take the first values that come."""
        self._vehicle = vehicle
        self._gains = gains
        self._outlet = Outlet(vehicle, gains)
        self._acceleration: Vec3 | None = None
        self._push: Vec3 = (0.0, 0.0, 0.0)

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; see the port."""
        gains, motion = self._gains, estimate.motion
        seen, given = self._filtered(estimate, interval_s)
        kx, kv, ka, feed = gains.k_position, gains.k_velocity, gains.k_acceleration, reference.acceleration_ned
        wanted: list[float] = [
            feed[i]
            + kx * (reference.position_ned[i] - motion.position[i])
            + kv * (reference.velocity_ned[i] - motion.velocity[i])
            + ka * (feed[i] - seen[i])
            for i in range(3)
        ]
        # The increment: the push changes by what the acceleration still lacks. `push` keeps it upright.
        change = (wanted[0] - seen[0], wanted[1] - seen[1], wanted[2] - seen[2])
        base = (given[0], given[1], given[2] - gains.gravity)
        along, _ = push(change, base, gains.gravity, math.radians(gains.tilt_limit_deg))
        x, y = half_angle_error(motion.attitude, along)
        jerk = reference.jerk_ned
        wx, wy = turning(motion.attitude, along, (-jerk[0], -jerk[1], -jerk[2]))
        return self._outlet.decide(
            estimate,
            reference,
            interval_s,
            push=along,
            turn=(wx + gains.k_attitude * x, wy + gains.k_attitude * y),
            disturbance=estimate.disturbance,
        )

    def _filtered(self, estimate: Estimate, interval: float) -> tuple[Vec3, Vec3]:
        """Acceleration and push (T/m) R e3 [m/s², NED], both through the same first-order filter."""
        motion, mass = estimate.motion, self._vehicle.mass_kg / estimate.effectiveness
        now = acceleration(motion, estimate.disturbance, mass, self._gains.gravity)
        x, y, z = third_column(motion.attitude)
        f = motion.thrust / mass
        given: Vec3 = (f * x, f * y, f * z)
        before = self._acceleration
        if before is not None and self._gains.filter_s > 0.0:
            k = interval / (interval + self._gains.filter_s)
            now, given = _between(before, now, k), _between(self._push, given, k)
        self._acceleration, self._push = now, given
        return now, given


def _between(old: Vec3, new: Vec3, share: float) -> Vec3:
    """``share`` of the way from ``old`` to ``new``."""
    return (
        old[0] + share * (new[0] - old[0]),
        old[1] + share * (new[1] - old[1]),
        old[2] + share * (new[2] - old[2]),
    )
