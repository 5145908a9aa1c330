"""Adaptive controller: the law, fed the modelled actuators, its output led through their lags and limits.

Its configuration is the section ``[controller]``: every gain and switch with unit, default and reason.
"""

import math
from typing import Any, Literal

from groundstation.core.control.backstepping import Law, LawOutput, LawState, backstep, turn_rates, within, yaw_rate
from groundstation.core.estimation import Composite, NonNegative, Positive
from groundstation.core.geometry import FLOATS, Ops, Quat, Real, Vec3, rotate, third_column
from groundstation.core.messages import Decision, Diagnostics, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Vehicle, lead, new


class Gains(Law, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="adaptive"):
    """The law's gains, and those of the blocks around it that make it fly with lag and delay."""

    actuator_compensation: bool = True
    """Feed the law the thrust the rotors give now (modelled), and invert the lags of thrust and rates."""
    composite: Composite = "provable"
    """Second witness of the disturbance, beside the tracking error: the observer's own d̂, through the projection
    (provable); the observer's innovations added to b̂, which then drives it (raw); or none, as the paper has it."""
    kappa: NonNegative = 28.0
    """κ: pull of b̂ towards d̂ [1/s per kb], provable form only. The proof needs kb² κ < 4 k3 (the smaller k3)."""
    k_omega: Positive = 14.0
    """How fast a body-rate error shall decay [1/s]."""


class Uncompensated(
    Gains, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="uncompensated"
):
    """The printed law: the same keys with the paper's gains, and every block around it off unless it is switched on."""

    k3: Positive = 4.0
    """See :class:`Law`."""
    k3_down: Positive = 4.0
    """See :class:`Law`."""
    kb: NonNegative = 1.0
    """See :class:`Law`."""
    sigma_slope: Positive = 3.0
    """See :class:`Law`."""
    rho_slope: Positive = 1.0
    """See :class:`Law`."""
    kappa: NonNegative = 7.0
    """See :class:`Gains`; with these gains the proof allows less than 16."""
    actuator_compensation: bool = False
    """See :class:`Gains`."""
    delay_prediction: bool = False
    """See :class:`Gains`."""
    observer: Literal["model", "backward_euler"] = "backward_euler"
    """See :class:`Gains`."""
    composite: Composite = "off"
    """See :class:`Gains`."""


AHEAD_S = 0.002
"""How far along the model the law is evaluated a second time, for the derivative of the rates that it wants [s]."""


class Adaptive:
    """Adaptive backstepping with actuator compensation. State: b̂, and what came before: d̂, the reference's jerk.

    With ``ARRAYS`` for ``ops`` one object flies N vehicles that are told the same: all numbers have shape (N,).
    """

    def __init__(self, vehicle: Vehicle, gains: Gains, ops: Ops = FLOATS) -> None:
        """Start with b̂ = 0, as the paper does."""
        self._ops = ops
        self._certificate = bound_decrease(gains)
        self._vehicle = vehicle
        self._gains = gains
        self._hold = vehicle.frame_period_s
        self._thrust_lead = lead(FLOATS, self._hold, vehicle.thrust_lag_s)
        self._rate_lead = lead(FLOATS, self._hold, vehicle.rate_lag_s)
        x, y, z = vehicle.rate_limits_deg_s
        self._limits: Vec3 = (math.radians(x), math.radians(y), math.radians(z))
        self.b_hat: Vec3 = (0.0, 0.0, 0.0)
        self._witnessed: Vec3 | None = None
        self._jerk: Vec3 | None = None
        self._slope: Vec3 = (0.0, 0.0, 0.0)
        self._thrust_sent: Real | None = None
        self._saturated = False

    @property
    def gains(self) -> Gains:
        """As they are now."""
        return self._gains

    def regain(self, gains: Gains) -> None:
        """Fly with other gains from now on; b̂ and all that it remembers stay."""
        self._gains = gains
        self._certificate = bound_decrease(gains)

    def begin(self, disturbance: Vec3) -> None:
        """Let b̂ begin at ``disturbance`` [m/s², NED]: what was found out before the first command."""
        self.b_hat = within(self._ops, disturbance, self._gains.b_bound)

    @property
    def memory(self) -> tuple[Any, ...]:
        """All that one command leaves for the next, as nested tuples; to be given back as it was taken."""
        return self.b_hat, self._witnessed, self._jerk, self._slope, self._thrust_sent, self._saturated

    @memory.setter
    def memory(self, memory: tuple[Any, ...]) -> None:
        self.b_hat, self._witnessed, self._jerk, self._slope, self._thrust_sent, self._saturated = memory

    def decide_apart(self, sooner: Estimate, later: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command where thrust and rates begin to act at two instants: each is the law's for its own.

        A state that is predicted beyond it has rates (or thrust) in it that are still to be decided: the law would
        take its own answer for the vehicle's, and swing. ``reference`` is that of the ``later`` instant; the other
        follows from its derivatives.
        """
        memory, vehicle = self.memory, self._vehicle
        before = move_back(reference, vehicle.sooner_s)
        first, early, _ = self.decide(sooner, before, interval_s)
        self.memory = memory
        last, late, seen = self.decide(later, reference, interval_s)
        thrust_first = vehicle.thrust_delay_s < vehicle.rate_delay_s
        drive = ActuatorCommand(first.thrust, last.rates) if thrust_first else ActuatorCommand(last.thrust, first.rates)
        return Decision(drive, early | late, seen)

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command for the instant of ``estimate``."""
        gains, vehicle = self._gains, self._vehicle
        motion = estimate.motion
        b_hat, witness = self._include_witness(estimate)
        compensate = gains.actuator_compensation
        thrust = motion.thrust if compensate or self._thrust_sent is None else self._thrust_sent
        p, v = reference.position_ned, reference.velocity_ned
        (px, py, pz), (vx, vy, vz) = motion.position, motion.velocity
        suspended = self._saturated
        mass, drag = vehicle.mass_kg / estimate.effectiveness, vehicle.drag_per_s
        z1, z1_dot = (px - p[0], py - p[1], pz - p[2]), (vx - v[0], vy - v[1], vz - v[2])
        feed, jerk = reference.acceleration_ned, reference.jerk_ned
        state = new(LawState, (z1, z1_dot, motion.velocity, motion.attitude, thrust, b_hat, feed, jerk))
        step = backstep(self._ops, gains, state, mass=mass, drag=drag, witness=witness, suspended=suspended)
        wanted = self._turn(motion.attitude, step.rate_x, step.rate_y, reference.yaw_rad, reference.yaw_rate_rad_s)
        if compensate:
            thrust_command = thrust + self._thrust_lead * step.thrust_rate
            rates = wanted
            if vehicle.rate_lag_s > 0.0:
                ahead = self._look_ahead(state, step, estimate, mass, interval_s)
                turned = self._turn(
                    ahead.attitude,
                    *turn_rates(self._ops, gains, ahead, mass=mass, drag=drag, suspended=suspended),
                    reference.yaw_rad + AHEAD_S * reference.yaw_rate_rad_s,
                    reference.yaw_rate_rad_s,
                )
                rates = self._lead(motion.rates, wanted, turned)
        else:
            thrust_command = thrust + self._hold * step.thrust_rate
            rates = wanted
        drive, self._saturated = self._clamp(thrust_command, rates)
        self._thrust_sent = drive.thrust
        dt, dot = interval_s, step.b_hat_dot
        self.b_hat = within(
            self._ops,
            (b_hat[0] + dt * dot[0], b_hat[1] + dt * dot[1], b_hat[2] + dt * dot[2]),
            gains.b_bound + gains.epsilon,
        )
        # In the order of the fields: by name it would take three times as long.
        seen = Diagnostics(
            step.z1,
            step.z2,
            step.z3,
            step.u_star,
            b_hat,
            dot,
            estimate.disturbance if gains.composite == "provable" else b_hat,
            step.v_terms,
            step.w_terms,
            step.v_known,
            step.w,
            _SUSPENDED if suspended is True else self._certificate,
            step.thrust_rate,
            wanted,
        )
        return new(Decision, (drive, self._saturated, seen))

    def _include_witness(self, estimate: Estimate) -> tuple[Vec3, Vec3 | None]:
        """b̂ with what the observer has learnt since the last command, and the witness κ (d̂ - b̂), if any.

        Provable form: b̂ moves along with d̂, ν = d̂˙ in docs/explanation/law.md. Raw form: innovations are added.
        With adaptation off b̂ stays; while it is suspended only ν moves b̂, as the clamped commands are modelled.
        """
        gains, b = self._gains, self.b_hat
        if gains.composite == "off" or gains.kb == 0.0:
            return b, None
        radius = gains.b_bound + gains.epsilon
        if gains.composite == "raw":
            step = estimate.disturbance_step
            return within(self._ops, (b[0] + step[0], b[1] + step[1], b[2] + step[2]), radius), None
        d, before = estimate.disturbance, self._witnessed
        self._witnessed = d
        if before is not None:
            b = within(self._ops, (b[0] + d[0] - before[0], b[1] + d[1] - before[1], b[2] + d[2] - before[2]), radius)
        k = gains.kappa
        return b, (k * (d[0] - b[0]), k * (d[1] - b[1]), k * (d[2] - b[2]))

    def _turn(self, attitude: Quat, rate_x: Real, rate_y: Real, yaw: Real, yaw_dot: Real) -> Vec3:
        """The rates to have [rad/s]: the law's, and the one that turns the heading."""
        return (
            rate_x,
            rate_y,
            yaw_rate(
                self._ops,
                attitude=attitude,
                yaw=yaw,
                yaw_dot=yaw_dot,
                rate_y=rate_y,
                k_yaw=self._gains.k_yaw,
                limit=self._limits[2],
            ),
        )

    def _look_ahead(
        self, state: LawState, step: LawOutput, estimate: Estimate, mass: Real, interval_s: float
    ) -> LawState:
        """The law's state ``AHEAD_S`` later: the vehicle along its model, the reference along its derivatives.

        So ω˙_d is the derivative of the law itself. A difference of successive ω_d would have each pose's innovation
        in it, and a filter on that lags.
        """
        e, half = AHEAD_S, 0.5 * AHEAD_S * AHEAD_S
        z1, z1_dot, velocity, attitude, thrust, b_hat, feed, jerk = state
        (dx, dy, dz), drag, f = estimate.disturbance, self._vehicle.drag_per_s, -thrust / mass
        rx, ry, rz = third_column(attitude)
        vx, vy, vz = velocity
        ax, ay, az = f * rx + dx - drag * vx, f * ry + dy - drag * vy, f * rz + dz - drag * vz + self._gains.gravity
        sx, sy, sz = self._find_snap(jerk, interval_s)
        ex, ey, ez = ax - feed[0], ay - feed[1], az - feed[2]
        wx, wy, wz = estimate.motion.rates
        moved = (
            (
                z1[0] + e * z1_dot[0] + half * ex,
                z1[1] + e * z1_dot[1] + half * ey,
                z1[2] + e * z1_dot[2] + half * ez,
            ),
            (
                z1_dot[0] + e * ex - half * jerk[0],
                z1_dot[1] + e * ey - half * jerk[1],
                z1_dot[2] + e * ez - half * jerk[2],
            ),
            (vx + e * ax, vy + e * ay, vz + e * az),
            rotate(attitude, (e * wx, e * wy, e * wz)),
            thrust + e * step.thrust_rate,
            _add(b_hat, e, step.b_hat_dot),
            _add(feed, e, jerk),
            (jerk[0] + e * sx, jerk[1] + e * sy, jerk[2] + e * sz),
        )
        return new(LawState, moved)

    def _find_snap(self, jerk: Vec3, interval_s: float) -> Vec3:
        """The reference's snap now [m/s⁴]: differences of its exact jerk, extrapolated by half an interval."""
        before, self._jerk = self._jerk, jerk
        if before is None or interval_s <= 0.0:
            return self._slope
        (a, b, c), k = self._slope, 1.0 / interval_s
        x, y, z = self._slope = (k * (jerk[0] - before[0]), k * (jerk[1] - before[1]), k * (jerk[2] - before[2]))
        return 1.5 * x - 0.5 * a, 1.5 * y - 0.5 * b, 1.5 * z - 0.5 * c

    def _lead(self, rates: Vec3, wanted: Vec3, ahead: Vec3) -> Vec3:
        """Rates to command so that the true ones follow ``wanted``: e = ω_d - ω̂ decays like e^(-k_ω t).

        ``ahead`` is what will be wanted ``AHEAD_S`` later.
        """
        n, k, d = self._rate_lead, self._gains.k_omega, 1.0 / AHEAD_S
        return (
            rates[0] + n * (k * (wanted[0] - rates[0]) + d * (ahead[0] - wanted[0])),
            rates[1] + n * (k * (wanted[1] - rates[1]) + d * (ahead[1] - wanted[1])),
            rates[2] + n * (k * (wanted[2] - rates[2]) + d * (ahead[2] - wanted[2])),
        )

    def _clamp(self, thrust: float, rates: Vec3) -> tuple[ActuatorCommand, bool]:
        """A command within the vehicle's limits, and whether any of the four had to be clamped."""
        vehicle, clamp = self._vehicle, self._ops.clamp
        (x, y, z), (a, b, c) = rates, self._limits
        inside = clamp(thrust, vehicle.thrust_min_n, vehicle.thrust_max_n)
        p, q, r = clamp(x, -a, a), clamp(y, -b, b), clamp(z, -c, c)
        return new(ActuatorCommand, (inside, (p, q, r))), (inside != thrust) | (p != x) | (q != y) | (r != z)


def move_back(reference: Reference, by_s: float) -> Reference:
    """``reference`` as it was ``by_s`` [s] before, by its derivatives."""
    p, v, a, j, yaw, yaw_rate = (getattr(reference, name) for name in reference.__struct_fields__)
    h, half, third = -by_s, 0.5 * by_s * by_s, -by_s * by_s * by_s / 6.0
    return Reference(
        _add(_add(_add(p, h, v), half, a), third, j),
        _add(_add(v, h, a), half, j),
        _add(a, h, j),
        j,
        yaw + h * yaw_rate,
        yaw_rate,
    )


def _add(a: Vec3, k: Real, b: Vec3) -> Vec3:
    return (a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2])


_SUSPENDED = "none: adaptation is suspended while a command is at its limit"


def bound_decrease(gains: Gains) -> str:
    """Which bound on V holds for these gains, for a constant wind and no lag (docs/explanation/law.md, section 5)."""
    if gains.kb == 0.0:
        return "none: adaptation is off (controller.kb = 0)"
    if gains.composite == "off":
        return "paper: V falls at least by W"
    if gains.composite == "raw":
        return "none: the raw form of composite adaptation has no proof"
    beyond = max(1.0, ((gains.b_bound + gains.epsilon) / gains.b_bound) ** 2 - 1.0)
    if gains.kb**2 * gains.kappa * beyond**2 >= 4.0 * min(gains.k3, gains.k3_down):
        return "none: the proof needs kb² κ < 4 k3"
    return "composite: V and the observer's error fall together, by a share of W at least"
