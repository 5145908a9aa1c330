"""Baseline: cascaded PID, as the position and attitude control of PX4 (main branch of 2024).

Position P → velocity PID with anti-windup → thrust vector, tilt-limited → attitude P on the quaternion error → body
rates. Velocity and acceleration of the reference are fed forward; PX4 feeds no attitude rate forward, nor does this.
"""

import math

from groundstation.core.control import acceleration, half_angle_error, push
from groundstation.core.controllers.baseline import Baseline, Outlet
from groundstation.core.estimation import NonNegative, Positive
from groundstation.core.geometry import FLOATS, Vec3
from groundstation.core.messages import Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle


class Pid(Baseline, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="pid"):
    """Gains, found by a search: docs/decisions/0006-baselines.md. In brackets: PX4's name."""

    p_position: Positive = 2.32
    """Velocity per position error [1/s] (MPC_XY_P)."""
    p_velocity: Positive = 4.69
    """Acceleration per velocity error [1/s] (MPC_XY_VEL_P_ACC)."""
    i_velocity: NonNegative = 6.83
    """Acceleration per integral of the velocity error [1/s²] (MPC_XY_VEL_I_ACC)."""
    d_velocity: NonNegative = 0.0164
    """Acceleration against acceleration [-] (MPC_XY_VEL_D_ACC)."""
    speed_limit_m_s: Positive = 12.0
    """Largest speed to ask for [m/s] (MPC_XY_VEL_MAX)."""
    integral_bound: Positive = 5.0
    """Largest acceleration of the integral, per axis [m/s²]; PX4 has g, upwards only."""
    p_attitude: Positive = 20.0
    """Body rate per attitude error [1/s] (MC_ROLL_P, MC_PITCH_P)."""

    def build(self, vehicle: Vehicle) -> "PidController":
        """The controller."""
        return PidController(vehicle, self)


class PidController:
    """State: the integral of the velocity loop."""

    def __init__(self, vehicle: Vehicle, gains: Pid) -> None:
        """Start with an empty integral."""
        self._vehicle = vehicle
        self._gains = gains
        self._outlet = Outlet(vehicle, gains)
        self._integral: Vec3 = (0.0, 0.0, 0.0)
        self._saturated = False

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; see the port."""
        gains, motion = self._gains, estimate.motion
        now = acceleration(motion, estimate.disturbance, self._vehicle.mass_kg / estimate.effectiveness, gains.gravity)
        goal = self._velocity(motion.position, reference)
        error = (goal[0] - motion.velocity[0], goal[1] - motion.velocity[1], goal[2] - motion.velocity[2])
        feed, integral = reference.acceleration_ned, self._integral
        p, d = gains.p_velocity, gains.d_velocity
        wanted: Vec3 = (
            feed[0] + p * error[0] + integral[0] - d * now[0],
            feed[1] + p * error[1] + integral[1] - d * now[1],
            feed[2] + p * error[2] + integral[2] - d * now[2],
        )
        along, cut = push(wanted, (0.0, 0.0, 0.0), gains.gravity, math.radians(gains.tilt_limit_deg))
        if not (cut or self._saturated):  # else it would wind up
            k, bound = interval_s * gains.i_velocity, gains.integral_bound
            self._integral = (
                FLOATS.clamp(integral[0] + k * error[0], -bound, bound),
                FLOATS.clamp(integral[1] + k * error[1], -bound, bound),
                FLOATS.clamp(integral[2] + k * error[2], -bound, bound),
            )
        x, y = half_angle_error(motion.attitude, along)
        decision = self._outlet.decide(
            estimate,
            reference,
            interval_s,
            push=along,
            turn=(gains.p_attitude * x, gains.p_attitude * y),
            disturbance=(-integral[0], -integral[1], -integral[2]),
        )
        self._saturated = decision.saturated
        return decision

    def _velocity(self, position: Vec3, reference: Reference) -> Vec3:
        """The velocity to ask for [m/s, NED], no faster than the limit."""
        k, p, v = self._gains.p_position, reference.position_ned, reference.velocity_ned
        x = v[0] + k * (p[0] - position[0])
        y = v[1] + k * (p[1] - position[1])
        z = v[2] + k * (p[2] - position[2])
        slow = min(1.0, self._gains.speed_limit_m_s / (math.sqrt(x * x + y * y + z * z) + 1e-9))
        return (x * slow, y * slow, z * slow)
