"""Adaptive controller: the law, fed the modelled actuators, its output led through their lags and
limits. Sans-IO.

Its configuration is the section ``[controller]``: every gain and switch with unit, default and
reason.
"""

from enum import Enum
from typing import Annotated, Any, Literal, NamedTuple

import msgspec

from groundstation.core.control.backstepping import (
    Law,
    LawOutput,
    LawState,
    backstep,
    clamp_length,
    compute_turn_rates,
    compute_yaw_rate,
)
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.estimation import Composite, Gain, GainOrOff, Ratio, SpeedBound, WitnessGain
from groundstation.core.geometry import FLOATS, Ops, Real, Vec3, add_scaled, rotate, third_column
from groundstation.core.messages import Decision, Diagnostics, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Vehicle, lead


class Gains(
    Law, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="adaptive"
):
    """The law's gains, and those of the blocks around it that make it fly with lag and delay."""

    actuator_compensation: Annotated[
        bool,
        msgspec.Meta(
            description="Feed the law the thrust the rotors give now (modelled), and invert the "
            "lags of thrust and rates."
        ),
    ] = True
    composite: Annotated[
        Composite,
        msgspec.Meta(
            description="Second witness of the disturbance, beside the tracking error: the "
            "observer's own d̂, through the projection (provable); the observer's "
            "innovations added to b̂, which then drives it (raw); or none, as the paper "
            "has it."
        ),
    ] = "provable"
    kappa: Annotated[
        WitnessGain,
        msgspec.Meta(
            description="κ: pull of b̂ towards d̂ [1/s per kb], provable form only. The proof "
            "needs kb² κ < 4 k3 (the smaller k3)."
        ),
    ] = 28.0
    k_omega: Annotated[
        Gain,
        msgspec.Meta(
            description="Decay rate of a body-rate error [1/s]. By default it is the vehicle's own "
            "rate response, delay included, where that is faster."
        ),
    ] = 14.0


class Uncompensated(
    Gains,
    frozen=True,
    kw_only=True,
    forbid_unknown_fields=True,
    tag_field="kind",
    tag="uncompensated",
):
    """The printed law: the same keys with the paper's gains, and every block around it off unless
    it is switched on.
    """

    k3: Gain = 4.0
    k3_down: Gain = 4.0
    kb: GainOrOff = 1.0
    sigma_bound: SpeedBound = 1.5
    sigma_slope: Gain = 3.0
    rho_bound: Ratio = 1.0
    rho_slope: Ratio = 1.0
    kappa: Annotated[
        WitnessGain,
        msgspec.Meta(
            description="κ, provable form: pull of b̂ towards d̂ [1/s per kb]; here the proof "
            "allows less than 16."
        ),
    ] = 7.0
    actuator_compensation: bool = False
    delay_prediction: bool = False
    observer: Literal["model", "backward_euler"] = "backward_euler"
    composite: Composite = "off"


CALM = {
    "k2": 1.75,
    "k3_down": 6.0,
    "sigma_slope": 3.0,
    "rho_slope": 1.0,
    "sigma_bound": 3.0,
    "rho_bound": 2.0,
}
"""Largest gains in climb and landing, and in a hold while poses are suspect: more is not needed
there, and the effect of false or late poses grows with them."""
HOLD = {"k3_down": 10.0, "rho_slope": 2.0, "sigma_bound": 3.0, "rho_bound": 2.0}
"""Largest gains in a hold: with those of the trajectory, poses that become later and later move it
far before they are suspect (`groundstation-sim dev faults --state hold`), and with the calm
ones gusts move it farther (`groundstation-sim dev upsets`)."""


def calm_gains(gains: Gains) -> Gains:
    """Limit ``gains`` to those that climb and land."""
    return _limit(gains, CALM)


def hold_gains(gains: Gains) -> Gains:
    """Limit ``gains`` to those that hold a place."""
    return _limit(gains, HOLD)


def _limit(gains: Gains, most: dict[str, float]) -> Gains:
    return msgspec.structs.replace(
        gains, **{name: min(value, getattr(gains, name)) for name, value in most.items()}
    )


AHEAD_S = 0.002
"""Time along the model after which the law is evaluated again, for the derivative of its rates
[s]."""


class Adaptive:
    """Adaptive backstepping with actuator compensation.

    State: b̂, and what came before: d̂, the reference's jerk.

    With ``arrays()`` for ``ops`` one object flies N vehicles of one configuration: all numbers have
    shape (N,).
    """

    def __init__(self, vehicle: Vehicle, gains: Gains, ops: Ops = FLOATS) -> None:
        """Start with b̂ = 0, as the paper does."""
        self._ops = ops
        self._certificate = str(bound_decrease(gains))
        self._vehicle = vehicle
        self._gains = gains
        self._hold = vehicle.frame_period_s
        self._thrust_lead = lead(FLOATS, self._hold, vehicle.thrust_lag_s)
        self._rate_lead = lead(FLOATS, self._hold, vehicle.rate_lag_s)
        self._limits = DemandLimits(ops, vehicle)
        self.b_hat: Vec3 = (0.0, 0.0, 0.0)
        self._observed: Vec3 | None = None
        self._jerk: Vec3 | None = None
        self._slope: Vec3 = (0.0, 0.0, 0.0)
        self._thrust_sent: Real | None = None
        """Thrust of the last command [N]: without compensation it is taken for the present one."""
        self._saturated: Any = False
        self._tilt_limited: Any = False

    @property
    def gains(self) -> Gains:
        """As they are now."""
        return self._gains

    def set_gains(self, gains: Gains) -> None:
        """Use other gains from now on; b̂ and the memory stay."""
        self._gains = gains
        self._certificate = str(bound_decrease(gains))

    def begin(self, disturbance: Vec3) -> None:
        """Let b̂ begin at ``disturbance`` [m/s², NED], estimated before the first command."""
        self.b_hat = clamp_length(self._ops, disturbance, self._gains.b_bound)

    @property
    def memory(self) -> tuple[Any, ...]:
        """State from one command to the next, as nested tuples; to be set as it was read."""
        return (
            self.b_hat,
            self._observed,
            self._jerk,
            self._slope,
            self._thrust_sent,
            self._saturated,
        )

    @memory.setter
    def memory(self, memory: tuple[Any, ...]) -> None:
        self.b_hat, self._observed, self._jerk, self._slope, self._thrust_sent, self._saturated = (
            memory
        )

    def decide_apart(
        self, sooner: Estimate, later: Estimate, reference: Reference, interval_s: float
    ) -> Decision:
        """Compute one command where thrust and rates begin to act at two instants: each by the law
        at its own.

        A state predicted beyond that instant contains rates (or thrust) that are still to be
        computed: the law would take its own output for the vehicle's, and oscillate. ``reference``
        is that of the ``later`` instant; the other follows from its derivatives.
        """
        memory, vehicle = self.memory, self._vehicle
        before = move_back(reference, vehicle.sooner_s)
        first = self.decide(sooner, before, interval_s).drive
        tilt_limited = self._tilt_limited
        self.memory = memory
        last, _, diagnostics = self.decide(later, reference, interval_s)
        if vehicle.thrust_delay_s < vehicle.rate_delay_s:
            drive, tilt_limited = ActuatorCommand(first.thrust, last.rates), self._tilt_limited
        else:
            drive = ActuatorCommand(last.thrust, first.rates)
        # The two unsent halves oscillate: neither their clamping nor their thrust counts.
        self._thrust_sent = drive.thrust
        self._saturated = self._limits.is_at_limit(drive) | tilt_limited
        return Decision(drive, self._saturated, diagnostics)

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """Compute one command for the instant of ``estimate``."""
        ops, gains, vehicle, limits = self._ops, self._gains, self._vehicle, self._limits
        motion = estimate.motion
        b_hat, composite_term = self._follow_observer(estimate)
        compensate = gains.actuator_compensation
        thrust = motion.thrust if compensate or self._thrust_sent is None else self._thrust_sent
        velocity, attitude = motion.velocity, motion.attitude
        (px, py, pz), (vx, vy, vz) = motion.position, velocity
        (a, b, c), (d, e, f) = reference.position_ned, reference.velocity_ned
        suspended = self._saturated
        mass, drag = vehicle.mass_kg / estimate.effectiveness, vehicle.drag_per_s
        z1, z1_dot = (px - a, py - b, pz - c), (vx - d, vy - e, vz - f)
        feed, jerk = reference.acceleration_ned, reference.jerk_ned
        state = LawState(z1, z1_dot, velocity, attitude, thrust, b_hat, feed, jerk)
        step = backstep(
            ops, gains, state, mass, drag, composite_term=composite_term, suspended=suspended
        )
        # The law's rates as the tilt limit leaves them, and the one that turns the heading.
        k_yaw, most = gains.k_yaw, limits.rates[2]
        yaw, yaw_dot = reference.yaw_rad, reference.yaw_rate_rad_s
        least = limits.find_least_cosine(
            attitude,
            thrust,
            estimate.effectiveness,
            gains.gravity + estimate.disturbance[2],
            feed[2] + step.u_star[2] + drag * velocity[2],
        )
        rate_x, rate_y, self._tilt_limited = limits.limit_tilt(
            attitude, motion.rates, (step.rate_x, step.rate_y), least, gains.k_omega
        )
        third = compute_yaw_rate(ops, attitude, yaw, yaw_dot, rate_y, k_yaw, most)
        rates = wanted = (rate_x, rate_y, third)
        if compensate:
            thrust_command = thrust + self._thrust_lead * step.thrust_rate
            if vehicle.rate_lag_s > 0.0:
                thrust_rate = limits.limit_thrust_rate(thrust, step.thrust_rate, self._thrust_lead)
                ahead = self._look_ahead(state, step, thrust_rate, estimate, mass, interval_s)
                x, y = compute_turn_rates(ops, gains, ahead, mass, drag, suspended)
                x, y, _ = limits.limit_tilt(
                    ahead.attitude, motion.rates, (x, y), least, gains.k_omega
                )
                yaw = yaw + AHEAD_S * yaw_dot
                third = compute_yaw_rate(ops, ahead.attitude, yaw, yaw_dot, y, k_yaw, most)
                rates = self._lead(motion.rates, wanted, (x, y, third))
        else:
            thrust_command = thrust + self._hold * step.thrust_rate
        x, y, turn = rates
        drive, clamped = limits.clamp(
            thrust_command, (x, y, limits.limit_yaw(motion.rates[2], turn))
        )
        self._saturated = clamped | self._tilt_limited
        self._thrust_sent = drive.thrust
        moved = add_scaled(b_hat, interval_s, step.b_hat_dot)
        self.b_hat = clamp_length(ops, moved, gains.b_bound + gains.epsilon)
        known = estimate.disturbance if gains.composite == "provable" else b_hat
        certificate = _SUSPENDED if suspended is True else self._certificate
        diagnostics = describe_step(step, b_hat, known, certificate, wanted)
        return Decision(drive, self._saturated, diagnostics)

    def _follow_observer(self, estimate: Estimate) -> tuple[Vec3, Vec3 | None]:
        """Return b̂ moved by what the observer has found since the last command, and the composite
        term κ (d̂ - b̂) [m/s³], if there is one.

        Provable form: b̂ moves along with d̂, ν = d̂˙ in docs/explanation/law.md. Raw form:
        innovations are added. With adaptation off b̂ stays; while it is suspended only ν moves b̂,
        as the clamped commands are modelled.
        """
        gains, b = self._gains, self.b_hat
        if gains.composite == "off" or gains.kb == 0.0:
            return b, None
        (x, y, z), radius = b, gains.b_bound + gains.epsilon
        if gains.composite == "raw":
            u, v, w = estimate.disturbance_step
            return clamp_length(self._ops, (x + u, y + v, z + w), radius), None
        d, before = estimate.disturbance, self._observed
        self._observed = d
        p, q, r = d
        if before is not None:
            u, v, w = before
            b = x, y, z = clamp_length(self._ops, (x + p - u, y + q - v, z + r - w), radius)
        k = gains.kappa
        return b, (k * (p - x), k * (q - y), k * (r - z))

    def _look_ahead(
        self,
        state: LawState,
        step: LawOutput,
        thrust_rate: Real,
        estimate: Estimate,
        mass: Real,
        interval_s: float,
    ) -> LawState:
        """The law's state ``AHEAD_S`` later: the vehicle along its model, the reference along its
        derivatives.

        So ω˙_d is the derivative of the law itself. A difference of successive ω_d would have each
        pose's innovation in it, and a filter on that lags.
        """
        e, half = AHEAD_S, 0.5 * AHEAD_S * AHEAD_S
        (x, y, z), (ux, uy, uz), (vx, vy, vz), attitude, thrust, b_hat, feed, jerk = state
        (dx, dy, dz), drag, f = estimate.disturbance, self._vehicle.drag_per_s, -thrust / mass
        rx, ry, rz = third_column(attitude)
        ax = f * rx + dx - drag * vx
        ay = f * ry + dy - drag * vy
        az = f * rz + dz - drag * vz + self._gains.gravity
        (fx, fy, fz), (jx, jy, jz) = feed, jerk
        sx, sy, sz = self._find_snap(jerk, interval_s)
        ex, ey, ez = ax - fx, ay - fy, az - fz
        wx, wy, wz = estimate.motion.rates
        return LawState(
            (x + e * ux + half * ex, y + e * uy + half * ey, z + e * uz + half * ez),
            (ux + e * ex - half * jx, uy + e * ey - half * jy, uz + e * ez - half * jz),
            (vx + e * ax, vy + e * ay, vz + e * az),
            rotate(attitude, (e * wx, e * wy, e * wz)),
            thrust + e * thrust_rate,
            add_scaled(b_hat, e, step.b_hat_dot),
            (fx + e * jx, fy + e * jy, fz + e * jz),
            (jx + e * sx, jy + e * sy, jz + e * sz),
        )

    def _find_snap(self, jerk: Vec3, interval_s: float) -> Vec3:
        """The reference's snap now [m/s⁴]: differences of its exact jerk, extrapolated by half an
        interval.
        """
        before, self._jerk = self._jerk, jerk
        if before is None or interval_s <= 0.0:
            return self._slope
        (a, b, c), k = self._slope, 1.0 / interval_s
        (p, q, r), (u, v, w) = jerk, before
        x, y, z = self._slope = (k * (p - u), k * (q - v), k * (r - w))
        return 1.5 * x - 0.5 * a, 1.5 * y - 0.5 * b, 1.5 * z - 0.5 * c

    def _lead(self, rates: Vec3, wanted: Vec3, ahead: Vec3) -> Vec3:
        """Rates to command so that the true ones follow ``wanted``: e = ω_d - ω̂ decays like
        e^(-k_ω t).

        ``ahead`` is what will be wanted ``AHEAD_S`` later.
        """
        n, k, d = self._rate_lead, self._gains.k_omega, 1.0 / AHEAD_S
        (p, q, r), (a, b, c), (x, y, z) = rates, wanted, ahead
        return (
            p + n * (k * (a - p) + d * (x - a)),
            q + n * (k * (b - q) + d * (y - b)),
            r + n * (k * (c - r) + d * (z - c)),
        )


def move_back(reference: Reference, by_s: float) -> Reference:
    """``reference`` as it was ``by_s`` [s] before, by its derivatives."""
    p, v, a, j, yaw, yaw_rate = (getattr(reference, name) for name in reference.__struct_fields__)
    h, half, third = -by_s, 0.5 * by_s * by_s, -by_s * by_s * by_s / 6.0
    return Reference(
        add_scaled(add_scaled(add_scaled(p, h, v), half, a), third, j),
        add_scaled(add_scaled(v, h, a), half, j),
        add_scaled(a, h, j),
        j,
        yaw + h * yaw_rate,
        yaw_rate,
    )


def describe_step(
    step: LawOutput, b_hat: Vec3, known: Vec3, certificate: str, rates: Vec3
) -> Diagnostics:
    """Return what the law says about its ``step``.

    Args:
        step: the law, evaluated.
        b_hat: disturbance of the law's own adaptation [m/s², NED].
        known: disturbance by which V is known [m/s², NED].
        certificate: what bounds the decrease of V.
        rates: wanted body rates [rad/s].
    """
    # By position: by name it would take three times as long.
    return Diagnostics(
        step.z1, step.z2, step.z3, step.u_star, b_hat, step.b_hat_dot, known,
        step.v_terms, step.w_terms, step.v_known, step.w, certificate, step.thrust_rate, rates,
    )  # fmt: skip


_SUSPENDED = "none: adaptation is suspended while the tilt or a command is at its limit"


class DecreaseProof(Enum):
    """Proof of the decrease of V."""

    NONE = "none"
    PAPER = "paper"
    COMPOSITE = "composite"


class DecreaseBound(NamedTuple):
    """Bound on the decrease of V, in words ``proof: says``."""

    proof: DecreaseProof
    says: str

    def __str__(self) -> str:
        return f"{self.proof.value}: {self.says}"


def bound_decrease(gains: Gains) -> DecreaseBound:
    """Which bound on V holds for these gains, for a constant wind and no lag
    (docs/explanation/law-proof.md).
    """
    if gains.kb == 0.0:
        return DecreaseBound(DecreaseProof.NONE, "adaptation is off (controller.kb = 0)")
    if gains.composite == "off":
        return DecreaseBound(DecreaseProof.PAPER, "V falls at least by W")
    if gains.composite == "raw":
        return DecreaseBound(
            DecreaseProof.NONE, "the raw form of composite adaptation has no proof"
        )
    if gains.kb**2 * gains.kappa * projection_slope(gains) ** 2 >= 4.0 * least_k3(gains):
        return DecreaseBound(DecreaseProof.NONE, "the proof needs kb² κ < 4 k3")
    falls = "V and the observer's error fall together, by a share of W at least"
    return DecreaseBound(DecreaseProof.COMPOSITE, falls)


def projection_slope(gains: Gains) -> float:
    """L of docs/explanation/law-proof.md: Lipschitz constant of the projection [-]."""
    return max(1.0, ((gains.b_bound + gains.epsilon) / gains.b_bound) ** 2 - 1.0)


def least_k3(gains: Law) -> float:
    """The smaller of the horizontal and the vertical k3 [1/s]."""
    return min(gains.k3, gains.k3_down)
