"""Adaptive controller: the law, fed the modelled actuators, its output led through their lags and limits. Sans-IO.

Its configuration is the section ``[controller]``: every gain and switch with unit, default and reason.

Lyapunov certificate: what the theory promises before a flight, and a monitor of V against it in flight.

Before: The paper's bound in consistent units: T/m >= g - (B + ε) - sup|p¨d| - sup|u*| - √(2 V(0)), each sup over time
of a Euclidean norm. It is conservative (with the paper's own gains it is negative), so it is reported, not refused on:
in flight the commanded thrust is clamped above ``vehicle.thrust_min_n``.

In flight, floats only: The wind is unknown, so b̃ is too; what the observer knows of it takes its place: w = d̂ - b̂.
With V_m = V_known + |w|²/(2 kb), docs/explanation/law-proof.md (5.9) has V_m˙ = -(W + κ|w|²) + terms, each a gradient
at mid-frame times what moved within the frame; and, for the noise and the gusts that it covers,

    V_m˙ <= -s (W + κ|w|²) + D

on average. So from any instant on, V_m stays below its value there plus the integral of the right side. The monitor
keeps the excess of V_m over the lowest of these bounds: zero where the theory holds; it grows where V rises, and also
where V only swings, though it must fall. Lasting excess is a warning that names the largest term of V_m˙.
"""

import math
from functools import lru_cache
from typing import Annotated, Any, Literal, NamedTuple

import msgspec

from groundstation.core.control.backstepping import (
    BacksteppingAxis,
    Law,
    LawOutput,
    State,
    axis,
    backstep,
    turn_rates,
    within,
    yaw_rate,
)
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.estimation import Composite, Estimation, NonNegative, Positive
from groundstation.core.geometry import FLOATS, Ops, Real, Vec3, rotate, third_column, to_body
from groundstation.core.messages import Certificate, CertificateReading, Decision, Diagnostics, Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle, lead, new


class Gains(Law, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="adaptive"):
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
        NonNegative,
        msgspec.Meta(
            description="κ: pull of b̂ towards d̂ [1/s per kb], provable form only. The proof needs "
            "kb² κ < 4 k3 (the smaller k3)."
        ),
    ] = 28.0
    k_omega: Annotated[
        Positive,
        msgspec.Meta(
            description="How fast a body-rate error shall decay [1/s]. Left so, it is as fast as the "
            "vehicle answers by itself, delay included, where that is more."
        ),
    ] = 14.0


class Uncompensated(
    Gains, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="uncompensated"
):
    """The printed law: the same keys with the paper's gains, and every block around it off unless it is switched on."""

    k3: Positive = 4.0
    k3_down: Positive = 4.0
    kb: NonNegative = 1.0
    sigma_bound: Positive = 1.5
    sigma_slope: Positive = 3.0
    rho_bound: Positive = 1.0
    rho_slope: Positive = 1.0
    kappa: Annotated[
        NonNegative,
        msgspec.Meta(
            description="κ, provable form: pull of b̂ towards d̂ [1/s per kb]; here the proof allows less than 16."
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
"""Up and down, and off the figure where poses are doubted, these gains are so large at most: more is not needed there,
and what poses that lie or come late make of a vehicle grows with them."""
HOLD = {
    "k3_down": 10.0,
    "rho_slope": 2.0,
    "sigma_bound": 3.0,
    "rho_bound": 2.0,
}
"""In a hold these gains are so large at most: with those of the figure poses that come later and later drive a vehicle
that has no motion to tell them by (`faults --state hold`), with the calm ones it gives way to gusts (`upsets`)."""


def calm_gains(gains: Gains) -> Gains:
    """Limit ``gains`` to those that climb and land."""
    return _limit(gains, CALM)


def hold_gains(gains: Gains) -> Gains:
    """Limit ``gains`` to those that hold a place."""
    return _limit(gains, HOLD)


def _limit(gains: Gains, most: dict[str, float]) -> Gains:
    return msgspec.structs.replace(gains, **{name: min(value, getattr(gains, name)) for name, value in most.items()})


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
        self._limits = DemandLimits(ops, vehicle)
        self.b_hat: Vec3 = (0.0, 0.0, 0.0)
        self._witnessed: Vec3 | None = None
        self._jerk: Vec3 | None = None
        self._slope: Vec3 = (0.0, 0.0, 0.0)
        self._thrust_sent: Real | None = None
        self._saturated: Any = False
        self._tilt_limited: Any = False

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
        first = self.decide(sooner, before, interval_s).drive
        tilt_limited = self._tilt_limited
        self.memory = memory
        last, _, seen = self.decide(later, reference, interval_s)
        if vehicle.thrust_delay_s < vehicle.rate_delay_s:
            drive, tilt_limited = ActuatorCommand(first.thrust, last.rates), self._tilt_limited
        else:
            drive = ActuatorCommand(last.thrust, first.rates)
        # Halves that are not sent swing, and clamp nothing.
        self._saturated = self._limits.is_at_limit(drive) | tilt_limited
        return Decision(drive, self._saturated, seen)

    def decide(self, estimate: Estimate, reference: Reference, interval_s: float) -> Decision:
        """One command for the instant of ``estimate``."""
        ops, gains, vehicle, limits = self._ops, self._gains, self._vehicle, self._limits
        motion = estimate.motion
        b_hat, witness = self._include_witness(estimate)
        compensate = gains.actuator_compensation
        thrust = motion.thrust if compensate or self._thrust_sent is None else self._thrust_sent
        velocity, attitude = motion.velocity, motion.attitude
        (px, py, pz), (vx, vy, vz) = motion.position, velocity
        (a, b, c), (d, e, f) = reference.position_ned, reference.velocity_ned
        suspended = self._saturated
        mass, drag = vehicle.mass_kg / estimate.effectiveness, vehicle.drag_per_s
        z1, z1_dot = (px - a, py - b, pz - c), (vx - d, vy - e, vz - f)
        feed, jerk = reference.acceleration_ned, reference.jerk_ned
        state = (z1, z1_dot, velocity, attitude, thrust, b_hat, feed, jerk)
        step = backstep(ops, gains, state, mass, drag, witness=witness, suspended=suspended)
        # The law's rates as the tilt limit leaves them, and the one that turns the heading.
        k_yaw, most, yaw, yaw_dot = gains.k_yaw, limits.rates[2], reference.yaw_rad, reference.yaw_rate_rad_s
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
        rates = wanted = (rate_x, rate_y, yaw_rate(ops, attitude, yaw, yaw_dot, rate_y, k_yaw, most))
        if compensate:
            thrust_command = thrust + self._thrust_lead * step.thrust_rate
            if vehicle.rate_lag_s > 0.0:
                thrust_rate = limits.limit_thrust_rate(thrust, step.thrust_rate, self._thrust_lead)
                ahead = self._look_ahead(state, step, thrust_rate, estimate, mass, interval_s)
                rates_ahead = turn_rates(ops, gains, ahead, mass, drag, suspended)
                rate_x, rate_y, _ = limits.limit_tilt(ahead[3], motion.rates, rates_ahead, least, gains.k_omega)
                yaw = yaw + AHEAD_S * yaw_dot
                third = yaw_rate(ops, ahead[3], yaw, yaw_dot, rate_y, k_yaw, most)
                rates = self._lead(motion.rates, wanted, (rate_x, rate_y, third))
        else:
            thrust_command = thrust + self._hold * step.thrust_rate
        drive, clamped = limits.clamp(thrust_command, rates)
        self._saturated = clamped | self._tilt_limited
        self._thrust_sent = drive.thrust
        dot = step.b_hat_dot
        self.b_hat = within(ops, _add(b_hat, interval_s, dot), gains.b_bound + gains.epsilon)
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
        (x, y, z), radius = b, gains.b_bound + gains.epsilon
        if gains.composite == "raw":
            u, v, w = estimate.disturbance_step
            return within(self._ops, (x + u, y + v, z + w), radius), None
        d, before = estimate.disturbance, self._witnessed
        self._witnessed = d
        p, q, r = d
        if before is not None:
            u, v, w = before
            b = x, y, z = within(self._ops, (x + p - u, y + q - v, z + r - w), radius)
        k = gains.kappa
        return b, (k * (p - x), k * (q - y), k * (r - z))

    def _look_ahead(
        self, state: State, step: LawOutput, thrust_rate: Real, estimate: Estimate, mass: Real, interval_s: float
    ) -> State:
        """The law's state ``AHEAD_S`` later: the vehicle along its model, the reference along its derivatives.

        So ω˙_d is the derivative of the law itself. A difference of successive ω_d would have each pose's innovation
        in it, and a filter on that lags.
        """
        e, half = AHEAD_S, 0.5 * AHEAD_S * AHEAD_S
        (x, y, z), (ux, uy, uz), (vx, vy, vz), attitude, thrust, b_hat, feed, jerk = state
        (dx, dy, dz), drag, f = estimate.disturbance, self._vehicle.drag_per_s, -thrust / mass
        rx, ry, rz = third_column(attitude)
        ax, ay, az = f * rx + dx - drag * vx, f * ry + dy - drag * vy, f * rz + dz - drag * vz + self._gains.gravity
        (fx, fy, fz), (jx, jy, jz) = feed, jerk
        sx, sy, sz = self._find_snap(jerk, interval_s)
        ex, ey, ez = ax - fx, ay - fy, az - fz
        wx, wy, wz = estimate.motion.rates
        return (
            (x + e * ux + half * ex, y + e * uy + half * ey, z + e * uz + half * ez),
            (ux + e * ex - half * jx, uy + e * ey - half * jy, uz + e * ez - half * jz),
            (vx + e * ax, vy + e * ay, vz + e * az),
            rotate(attitude, (e * wx, e * wy, e * wz)),
            thrust + e * thrust_rate,
            _add(b_hat, e, step.b_hat_dot),
            (fx + e * jx, fy + e * jy, fz + e * jz),
            (jx + e * sx, jy + e * sy, jz + e * sz),
        )

    def _find_snap(self, jerk: Vec3, interval_s: float) -> Vec3:
        """The reference's snap now [m/s⁴]: differences of its exact jerk, extrapolated by half an interval."""
        before, self._jerk = self._jerk, jerk
        if before is None or interval_s <= 0.0:
            return self._slope
        (a, b, c), k = self._slope, 1.0 / interval_s
        (p, q, r), (u, v, w) = jerk, before
        x, y, z = self._slope = (k * (p - u), k * (q - v), k * (r - w))
        return 1.5 * x - 0.5 * a, 1.5 * y - 0.5 * b, 1.5 * z - 0.5 * c

    def _lead(self, rates: Vec3, wanted: Vec3, ahead: Vec3) -> Vec3:
        """Rates to command so that the true ones follow ``wanted``: e = ω_d - ω̂ decays like e^(-k_ω t).

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
        _add(_add(_add(p, h, v), half, a), third, j),
        _add(_add(v, h, a), half, j),
        _add(a, h, j),
        j,
        yaw + h * yaw_rate,
        yaw_rate,
    )


def _add(a: Vec3, k: Real, b: Vec3) -> Vec3:
    return (a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2])


_SUSPENDED = "none: adaptation is suspended while the tilt or a command is at its limit"


def bound_decrease(gains: Gains) -> str:
    """Which bound on V holds for these gains, for a constant wind and no lag (docs/explanation/law-proof.md)."""
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


NO_FUNCTION = "none: this controller comes without a Lyapunov function"


class ThrustBound(NamedTuple):
    """The bound and its terms, all in m/s²."""

    bound: float
    """What thrust over mass never falls below; negative: the theory promises nothing."""
    gravity: float
    disturbance: float
    """B + ε."""
    reference: float
    """sup |p¨d|."""
    virtual_control: float
    """sup |u*|: √3 times the largest value on one axis."""
    start: float
    """√(2 V(0))."""


@lru_cache(16)
def virtual_control_sup(law: Law) -> float:
    """The largest |u*| on one axis [m/s²], over all position and speed errors (u* is odd: z1_dot > 0 is enough).

    A coarse grid far beyond where Ω' has made u* fall again (one half of it, as u* is odd), then three finer ones
    around its best point.
    """
    m = law.sigma_bound
    z1, z1_span = 0.0, 10.0 * m / law.sigma_slope
    x2 = x2_span = 5.0 * (m + law.velocity_scale)
    top, points = 0.0, 30
    for last in (0, 12, 12, 12):
        best = (z1, x2)
        for i in range(last, -points - 1, -1):
            first = z1 + z1_span * i / points
            slope = BacksteppingAxis(*axis(FLOATS, law.shape, first, 0.0)).sigma_prime
            if law.k2 * law.rho_bound + m + slope * (m + law.velocity_scale) < top:
                continue  # |u*| is nowhere more than that for this z1: |x2| <= (M + c) Ω'(x2)
            for j in range(-points, points + 1):
                second = x2 + x2_span * j / points
                value = abs(BacksteppingAxis(*axis(FLOATS, law.shape, first, second)).u_star)
                if value > top:
                    top, best = value, (first, second)
        z1, x2 = best
        z1_span, x2_span, points = 2.0 * z1_span / points, 2.0 * x2_span / points, 12
    return top


def thrust_bound(law: Law, *, acceleration_sup: float, v_start: float) -> ThrustBound:
    """The bound for a reference whose acceleration stays below ``acceleration_sup`` [m/s²], from V(0) = ``v_start``."""
    disturbance = law.b_bound + law.epsilon
    control = math.sqrt(3.0) * virtual_control_sup(law)
    start = math.sqrt(2.0 * v_start)
    bound = law.gravity - disturbance - acceleration_sup - control - start
    return ThrustBound(bound, law.gravity, disturbance, acceleration_sup, control, start)


COVERED_RATE_M_S3 = 8.0
"""β: how fast b̂ and û may be moved by wind and actuators, and the bound still hold [m/s³]. The sine gusts of `adverse`
have 0.9; a tilt rate that is off by 0.8 rad/s, as behind the front of `gust_front`, has 8."""


class Decrease(NamedTuple):
    """The bound V_m˙ <= -s (W + κ|w|²) + D for one set of gains (docs/explanation/law-proof.md, section 5.9)."""

    name: str
    """Which bound holds, or why none does."""
    share: float
    """s [-]; 0 where nothing is proved."""
    power: float
    """What D has for wind and actuators; :func:`noise_power` comes on top [m²/s³]."""
    spare: float
    """How far V_m may stand above its bound for what is not measured [m²/s²]."""


def decrease(law: Law) -> Decrease:
    """The bound that these gains have in flight."""
    name = bound_decrease(law) if isinstance(law, Gains) else "none: the gains of the law alone"
    left = 1.0
    if name.startswith("composite") and isinstance(law, Gains):
        beyond = max(1.0, ((law.b_bound + law.epsilon) / law.b_bound) ** 2 - 1.0)
        left = 1.0 - 0.5 * law.kb * beyond * math.sqrt(law.kappa / min(law.k3, law.k3_down))
    # Without a d̂ of its own nothing stands for b̃: V_known may rise by what the last term of V can give.
    spare = 0.5 * (2.0 * law.b_bound + law.epsilon) ** 2 / law.kb if name.startswith("paper") else 0.0
    share = 0.0 if name.startswith("none") else 0.5 * left
    return Decrease(name, share, COVERED_RATE_M_S3**2 / (2.0 * left * min(law.k3, law.k3_down)), spare)


class Measure(NamedTuple):
    """V_m = V_known + |w|²/(2 kb) with w = d̂ - b̂, and what it must fall by, for one set of gains. Elementwise."""

    decrease: Decrease
    """The bound that these gains have."""
    weight: float
    """1/(2 kb) [s²]; 0 without an observer that finds d̂ by itself."""
    kappa: float
    """κ [1/s]; 0 likewise."""
    b_bound2: float
    """B², what the law keeps |b̂|² about [m²/s⁴]; without adaptation inf."""

    def of(self, d: Diagnostics) -> tuple[Real, Real]:
        """V_m [m²/s²], and W + κ|w|² [m²/s³], where the law says ``d``."""
        bx, by, bz = d.b_hat
        wx, wy, wz = d.disturbance
        wx, wy, wz = wx - bx, wy - by, wz - bz
        ww = wx * wx + wy * wy + wz * wz
        return d.v_known + self.weight * ww, d.w + self.kappa * ww


def measure(config: Estimation) -> Measure:
    """What can be measured of V under these gains; for a controller without a Lyapunov function, of nothing."""
    law = config if isinstance(config, Law) else None
    known = Decrease(NO_FUNCTION, 0.0, 0.0, 0.0) if law is None else decrease(law)
    bound2 = law.b_bound**2 if law is not None and law.kb > 0.0 else math.inf
    if isinstance(config, Gains) and config.composite == "provable" and config.kb > 0.0:
        return Measure(known, 0.5 / config.kb, config.kappa, bound2)
    return Measure(known, 0.0, 0.0, bound2)


def noise_power(law: Law, noise_m: Real, interval_s: Real) -> Real:
    """What D has for poses of noise ``noise_m`` [m, 1σ per axis] every ``interval_s`` [s]: [m²/s³]. Elementwise.

    Innovations are white, so on average V_m only gains the second-order part of their jumps: half of its curvature at
    the origin times their intensity, on three axes. The observer's gains are those of its steady state in continuous
    time for a chain that the disturbance's rate drives: a Butterworth filter of order 4.
    """
    intensity = noise_m * noise_m * interval_s
    w: Real = (law.wind_rate_noise**2 / intensity) ** 0.125
    l1, l2, l3 = 2.613 * w, 3.414 * w * w, 2.613 * w * w * w
    if law.composite == "off":
        l3 = 0.0
    r = law.sigma_slope
    z2 = l2 + r * l1
    z3 = l3 + law.k2 * law.rho_slope * z2 + r * (l1 + l2)
    return 1.5 * intensity * (r * l1 * l1 + z2 * z2 + z3 * z3)


RATES = "rate error of the actuators"
THRUST = "thrust error of the actuators"
LIMITS = "commands at their limit"
WITNESSES = "observer and tracking disagree about the wind (kb² κ against 4 k3)"
SIDEWAYS = "the disturbance moves sideways (gusts; or rate lag, delay or attitude not as told)"
VERTICAL = "the disturbance moves vertically (gusts; or thrust, its lag or delay not as told)"
POSES = "poses contradict the model (noise, or lags or delay not as told)"


def terms(
    before: Motion,
    told: Diagnostics,
    saturated: bool,
    after: Motion,
    now: Diagnostics,
    dt: float,
    *,
    total: float,
    mass: float,
    pull: float,
) -> dict[str, float]:
    """What V_m gained from each source within one frame [m²/s²].

    Args:
        before: the vehicle at the last command.
        told: what the law said there.
        saturated: whether that command was clamped; the law then adapts nothing at the present one.
        after: the vehicle at the present command.
        now: what the law says there.
        dt: between the two [s].
        total: V_m's rise plus the decrease W + κ|w|² over the frame [m²/s²].
        mass: [kg].
        pull: kb κ [1/s].
    """
    z3: Vec3 = (
        0.5 * (told.z3[0] + now.z3[0]),
        0.5 * (told.z3[1] + now.z3[1]),
        0.5 * (told.z3[2] + now.z3[2]),
    )
    zx, zy, zz = to_body(before.attitude, z3)
    x, y = (0.5 * (before.rates[i] + after.rates[i]) - told.rates_wanted[i] for i in (0, 1))
    turning = before.thrust / mass * (zy * x - zx * y) * dt
    pushing = (told.thrust_rate * dt - (after.thrust - before.thrust)) / mass * zz
    d, e = told.disturbance, now.disturbance
    moved = (z3[0] * (e[0] - d[0]), z3[1] * (e[1] - d[1]), z3[2] * (e[2] - d[2]))
    w = (d[0] - told.b_hat[0], d[1] - told.b_hat[1], d[2] - told.b_hat[2])
    found = {
        LIMITS if saturated else RATES: turning,
        WITNESSES: 0.0 if saturated else pull * dt * (z3[0] * w[0] + z3[1] * w[1] + z3[2] * w[2]),
        SIDEWAYS: moved[0] + moved[1],
        VERTICAL: moved[2],
    }
    if saturated:
        found[LIMITS] += pushing
    else:
        found[THRUST] = pushing
    found[POSES] = total - sum(found.values())
    return found


LASTING_S = 0.5
"""What lasts so long is told [s]: an outage of the poses, or a gust's front, is over by then."""
PINNED_S = 1.0
"""Commands at their limit for so long are told [s]: a climb of 1 m takes less."""
SUSPENDED_MEAN_S = 1.0
"""Time constant of the share of commands at which the bound is suspended [s]; above one half it is told."""
REST_S = 5.0
"""What comes again sooner than this after its end is not told again [s]."""

HOLDS, VIOLATED, SUSPENDED, NONE = "holds", "violated", "suspended", "none"


class Lasting:
    """A condition that is told once when it has lasted, and again only after a rest."""

    __slots__ = ("_ended_s", "_least_s", "_told", "for_s")

    def __init__(self, least_s: float = LASTING_S) -> None:
        self.for_s, self._least_s = 0.0, least_s
        self._told = False
        self._ended_s = -math.inf

    def so(self, time_s: float, dt: float) -> bool:
        """It was so for another ``dt`` [s]; True when that is to be told."""
        if self.for_s == 0.0 and time_s - self._ended_s > REST_S:
            self._told = False
        self.for_s += dt
        if self._told or self.for_s < self._least_s:
            return False
        self._told = True
        return True

    def over(self, time_s: float) -> None:
        """It is so no longer."""
        if self.for_s > 0.0:
            self.for_s = 0.0
            self._ended_s = time_s


class CertificateMonitor:
    """Looks at every command of one flight, and changes nothing."""

    def __init__(self, vehicle: Vehicle, config: Estimation) -> None:
        self._vehicle = vehicle
        self._least_n, self._most_n = vehicle.thrust_min_n, vehicle.thrust_max_n
        self._noise: tuple[float, float] | None = None
        self._rising, self._outside = Lasting(), Lasting()
        self._pinned, self._limited = Lasting(PINNED_S), Lasting(PINNED_S)
        self._fed: dict[str, float] = {}
        self._limited_share, self._fed_at_limit = 0.0, dict[str, float]()
        self._peak = self._fed_s = self._watched_s = self._violated_s = self._suspended_s = 0.0
        self._opening = ""
        self.regain(config)
        if self._law is not None and self._known.share == 0.0:
            self._opening = f"Lyapunov: {self._known.name}; only a lasting rise of V will be told"

    def regain(self, config: Estimation) -> None:
        """The gains are others from now on, and V with them: begin from there."""
        law = config if isinstance(config, Law) else None
        self._config, self._law, self._measure = config, law, measure(config)
        self._known, self._bound2 = self._measure.decrease, self._measure.b_bound2
        self._radius = law.b_bound + law.epsilon if law is not None else None
        self._power = self._known.power
        if self._noise is not None:
            self.noise(*self._noise)
        self._quiet = self._state(suspended=False)
        self.restart()

    def restart(self) -> None:
        """The reference jumps, and V with it: begin from there."""
        self._time = -math.inf
        self._v = self._fall = self._excess = 0.0
        self._motion: Motion | None = None
        self._decision: Decision | None = None

    def noise(self, noise_m: float, interval_s: float) -> None:
        """The poses' noise as measured [m, 1σ per axis] and their mean interval [s]: D follows them."""
        self._noise = (noise_m, interval_s)
        if self._law is not None:
            self._power = self._known.power + noise_power(self._law, noise_m, interval_s)

    def look(self, time_s: float, motion: Motion, decision: Decision) -> CertificateReading:
        """One command, and the motion that it rests on."""
        v, fall = self._measure.of(decision.diagnostics)
        dt, before = time_s - self._time, self._decision
        words, self._opening, state = self._opening, "", NONE
        if before is not None and 0.0 < dt < LASTING_S:
            rise, fallen = v - self._v, 0.5 * dt * (fall + self._fall)
            excess = self._excess + rise + self._known.share * fallen - self._power * dt
            if before.saturated:  # nothing is promised: the bound begins anew from here
                excess = 0.0
            if excess > 0.0 or self._excess > 0.0:
                words = _both(words, self._above(excess, v, rise + fallen, dt, motion, before, decision))
            if before.saturated or self._limited_share > 0.0:
                words = _both(words, self._suspended(rise + fallen, dt, motion, before, decision))
            bx, by, bz = decision.diagnostics.b_hat
            b2 = bx * bx + by * by + bz * bz
            if b2 > self._bound2 or self._outside.for_s > 0.0:
                words = _both(words, self._beyond(math.sqrt(b2), dt))
            thrust = decision.drive.thrust
            if not self._least_n < thrust < self._most_n or self._pinned.for_s > 0.0:
                words = _both(words, self._at_limit(thrust, dt))
            self._watched_s += dt
            state = self._quiet
            if before.saturated or self._excess > 0.0 or self._outside.for_s > 0.0:
                state = self._state(suspended=before.saturated)
                if state is VIOLATED:
                    self._violated_s += dt
                elif state is SUSPENDED:
                    self._suspended_s += dt
        self._time = time_s
        self._v, self._fall, self._motion, self._decision = v, fall, motion, decision
        return CertificateReading(state, self._excess, words)

    def _above(
        self, excess: float, v: float, total: float, dt: float, motion: Motion, before: Decision, decision: Decision
    ) -> str:
        """V_m is above its bound, or was until now: what has fed it since?"""
        if self._excess == 0.0:
            self._fed, self._fed_s, self._peak = {}, 0.0, 0.0
        # The bound is not let fall below zero by more than V has been above it, so that what is over is over.
        self._peak = max(self._peak, v)
        self._excess = excess = min(max(excess, 0.0), self._peak + self._known.spare)
        if excess <= self._known.spare:
            self._rising.over(self._time)
        if excess <= 0.0 or self._motion is None:
            return ""
        self._fed_s += dt
        self._feed(self._fed, total, dt, motion, before, decision)
        # While adaptation is suspended nothing is promised, so that time does not count.
        if excess <= self._known.spare or before.saturated or not self._rising.so(self._time, dt):
            return ""
        largest = _largest(self._fed, self._fed_s)
        return f"Lyapunov: V has been above its bound for {self._fed_s:.1f} s; largest term: {largest}"

    def _suspended(self, total: float, dt: float, motion: Motion, before: Decision, decision: Decision) -> str:
        """The bound is suspended at more than half of the commands, or was until now."""
        share = self._limited_share
        share += dt / (dt + SUSPENDED_MEAN_S) * (float(before.saturated) - share)
        self._limited_share = share if share > 0.01 else 0.0
        if share <= 0.5 or self._law is None:
            self._limited.over(self._time)
            self._fed_at_limit = {}
            return ""
        self._feed(self._fed_at_limit, total, dt, motion, before, decision)
        told = self._limited.so(self._time, dt)
        # Commands at a limit are the consequence; what else feeds V is the cause.
        self._fed_at_limit.pop(LIMITS, None)
        if not told or self._pinned.for_s >= LASTING_S:  # that says it, too
            return ""
        for_s = self._limited.for_s
        return (
            f"Lyapunov: the bound is suspended most of the time, with {LIMITS}; "
            f"largest other term: {_largest(self._fed_at_limit, for_s)}"
        )

    def _feed(
        self,
        fed: dict[str, float],
        total: float,
        dt: float,
        motion: Motion,
        before: Decision,
        decision: Decision,
    ) -> None:
        """Add to ``fed`` what V_m gained from each source within the last frame."""
        assert self._motion is not None, "there was a command before"
        for name, energy in terms(
            self._motion,
            before.diagnostics,
            before.saturated,
            motion,
            decision.diagnostics,
            dt,
            total=total,
            mass=self._vehicle.mass_kg,
            pull=self._config.kb * self._measure.kappa,
        ).items():
            fed[name] = fed.get(name, 0.0) + energy

    def _beyond(self, length: float, dt: float) -> str:
        """|b̂| is above B, or was until now."""
        law = self._law
        if law is None or length <= law.b_bound:
            self._outside.over(self._time)
            return ""
        if not self._outside.so(self._time, dt):
            return ""
        return (
            f"Lyapunov: |b̂| = {length:.1f} m/s² has been above B = {law.b_bound:g} for {self._outside.for_s:.1f} s: "
            "wind, thrust or mass are off by more than controller.b_bound covers"
        )

    def _at_limit(self, thrust: float, dt: float) -> str:
        """The thrust is at one of its limits, or was until now."""
        if self._least_n < thrust < self._most_n:
            self._pinned.over(self._time)
            return ""
        if not self._pinned.so(self._time, dt):
            return ""
        which = "upper" if thrust >= self._most_n else "lower"
        return (
            f"thrust margin: the command has been at its {which} limit, {thrust:.2f} N, "
            f"for {self._pinned.for_s:.1f} s; the Lyapunov bound is suspended"
        )

    def _state(self, *, suspended: bool) -> str:
        if max(self._rising.for_s, self._outside.for_s) >= LASTING_S:
            return VIOLATED
        if self._law is None:
            return NONE
        return SUSPENDED if suspended else HOLDS if self._known.share > 0.0 else NONE

    def reading(self) -> Certificate | None:
        """For screens; None before the second command."""
        decision = self._decision
        if decision is None or self._watched_s == 0.0:
            return None
        return Certificate(
            state=self._state(suspended=decision.saturated),
            bound=self._known.name,
            v=self._v,
            excess=self._excess,
            violated_fraction=self._violated_s / self._watched_s,
            suspended_fraction=self._suspended_s / self._watched_s,
            b_hat_fraction=self._radius and math.hypot(*decision.diagnostics.b_hat) / self._radius,
        )


def _largest(fed: dict[str, float], for_s: float) -> str:
    """The largest term of ``fed`` over ``for_s`` [s], and the next where it is half as large."""
    (name, most), (other, next_) = sorted(fed.items(), key=lambda item: -item[1])[:2]
    said = f"{name}, {most / for_s:.2g} m²/s³"
    return said if next_ < 0.5 * most else f"{said}; then {other}, {next_ / for_s:.2g}"


def _both(words: str, more: str) -> str:
    """Two sentences, either of which may be empty."""
    return f"{words}; {more}" if words and more else words or more
