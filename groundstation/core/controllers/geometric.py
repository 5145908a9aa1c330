"""Baseline: geometric tracking control on SE(3) with integral action.

T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)", CDC 2010, with the integral
term of F. Goodarzi, D. Lee, T. Lee, "Geometric nonlinear PID control of a quadrotor UAV on SE(3)", ECC 2013, per unit
of mass. The vehicle takes body rates, not moments: of the attitude loop there remain the error e_R and the rate Ω_c at
which the wanted attitude turns, from exact derivatives as in the paper. Heading has its own loop, as in ours.
"""

import math

from groundstation.core.control import acceleration, push, sine_error, turning
from groundstation.core.controllers.baseline import Baseline, Outlet
from groundstation.core.estimation import NonNegative, Positive
from groundstation.core.geometry import FLOATS, Vec3
from groundstation.core.messages import Decision, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Vehicle


class Geometric(Baseline, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="geometric"):
    """Gains, found by a search: docs/decisions/0006-baselines.md."""

    k_position: Positive = 9.46
    """k_x / m [1/s²]."""
    k_velocity: Positive = 5.81
    """k_v / m [1/s]."""
    k_integral: NonNegative = 9.74
    """k_i / m [1/s²]."""
    coupling: Positive = 1.85
    """c1: share of the position error in the integral of e_v + c1 e_x [1/s]."""
    integral_bound: Positive = 5.0
    """σ: largest acceleration of the integral term, per axis [m/s²]; as b_bound of ours."""
    k_attitude: Positive = 16.1
    """k_R over k_Ω: body rate per attitude error [1/s]."""

    def build(self, vehicle: Vehicle) -> "GeometricController":
        """The controller."""
        return GeometricController(vehicle, self)


class GeometricController:
    """State: the integral e_i."""

    def __init__(self, vehicle: Vehicle, gains: Geometric) -> None:
        """Start with an empty integral."""
        self._vehicle = vehicle
        self._gains = gains
        self._outlet = Outlet(vehicle, gains)
        self._integral: Vec3 = (0.0, 0.0, 0.0)
        self._saturated = False

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command; see the port."""
        gains, motion = self._gains, estimate.motion
        kx, kv, ki, c1 = gains.k_position, gains.k_velocity, gains.k_integral, gains.coupling
        now = acceleration(motion, estimate.disturbance, self._vehicle.mass_kg / estimate.effectiveness, gains.gravity)
        # The integral stands still while the command is clamped, so that it does not wind up.
        dt = 0.0 if self._saturated else interval_s
        feedback: list[float] = []
        slope: list[float] = []
        learnt: list[float] = []
        for i in range(3):
            ex = motion.position[i] - reference.position_ned[i]
            ev = motion.velocity[i] - reference.velocity_ned[i]
            ea = now[i] - reference.acceleration_ned[i]
            bound = gains.integral_bound
            integral = FLOATS.clamp(self._integral[i] + dt * ki * (ev + c1 * ex), -bound, bound)
            learnt.append(integral)
            feedback.append(reference.acceleration_ned[i] - kx * ex - kv * ev - integral)
            slope.append(reference.jerk_ned[i] - kx * ev - kv * ea - ki * (ev + c1 * ex))
        self._integral = (learnt[0], learnt[1], learnt[2])
        nothing = (0.0, 0.0, 0.0)
        along, _ = push(
            (feedback[0], feedback[1], feedback[2]), nothing, gains.gravity, math.radians(gains.tilt_limit_deg)
        )
        ex, ey = sine_error(motion.attitude, along)
        wx, wy = turning(motion.attitude, along, (-slope[0], -slope[1], -slope[2]))
        decision = self._outlet.decide(
            estimate,
            reference,
            interval_s,
            push=along,
            turn=(wx + gains.k_attitude * ex, wy + gains.k_attitude * ey),
            disturbance=self._integral,
        )
        self._saturated = decision.saturated
        return decision
