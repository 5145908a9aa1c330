"""Law: nonlinear adaptive backstepping, equations (5)-(10) of Cabecinhas, Cunha, Silvestre, ACC
2013, in the form corrected by docs/explanation/law.md, which lists the errors of the print.

A pure function: state in, state rates and commands out; no clock, no I/O.

    symbol      unit    frame   meaning                                       equation
    p, v        m, m/s  NED     position, velocity                            (1)
    R (q)       -       FRD→NED attitude                                      (2)
    T           N       -z FRD  thrust the rotors give now, > 0               (1)
    b̂           m/s²    NED     estimate of the disturbance b                 (8)
    z1          m       NED     p - pd
    z2          m/s     NED     z1˙ + σ(z1)                                   (5)
    û           m/s²    NED     -(T/m) R e3 + g e3 + b̂ - p¨d
    u*          m/s²    NED     virtual control                               (6)
    z3          m/s²    NED     û - u*                                        (7)
    ξ           m/s³    NED     b̂˙ without gain and projection                (8)
    y           m/s³    FRD     jerk that brings z3 to 0                      (10)
    Ṫ, ω1, ω2   N/s, rad/s      commands: thrust rate, roll and pitch rate    (10)

V is the Lyapunov function. Its terms have different units, as in the paper: factors of 1 that carry
a unit are left out. On the plant of the paper, V˙ = -W + b̃ᵀ(ξ - Proj) <= -W.

σ and ρ are of one family of odd, smooth functions: M r s/√(M² + r² s²), with bound M and slope r at
0. (The paper prints M r s/√(1 + r² s²), whose slope is M·r.) All functions work elementwise: on
floats, or on arrays of shape (N,).
"""

import math
from functools import cached_property
from typing import Annotated, NamedTuple

import msgspec

from groundstation.core.estimation import (
    AccelerationBound,
    Estimation,
    Gain,
    GainOrOff,
    Ratio,
    Smoothing,
    SpeedBound,
)
from groundstation.core.geometry import Ops, Quat, Real, Vec3, add, scale, third_column, to_body


class Law(Estimation, frozen=True, kw_only=True, forbid_unknown_fields=True, dict=True):
    """Gains of the pure law. docs/explanation/law.md, section 7, gives the origin of each default.

    The base is :class:`Estimation`, as a controller's section also configures its estimator, and a
    struct has one base only. Of it the law reads ``gravity`` alone.
    """

    k2: Annotated[
        AccelerationBound,
        msgspec.Meta(
            description="Gain on ρ(z2) [m/s²]; paper: 2. With calm gains at most 1.75: in climbs "
            "and descents, with poses more than 0.07 s apart, and in a hold while poses are "
            "doubted."
        ),
    ] = 2.0
    k3: Annotated[Gain, msgspec.Meta(description="Gain on z3 [1/s]; paper: 4.")] = 5.0
    k3_down: Annotated[
        Gain,
        msgspec.Meta(
            description="The same for the vertical axis [1/s], where only thrust acts; paper: 4. "
            "In a hold at most 10, with calm gains (see k2) 6."
        ),
    ] = 14.0
    kb: Annotated[
        GainOrOff,
        msgspec.Meta(
            description="Adaptation gain [1/s² per m/s² of V's gradient]; paper: 1; 0 switches "
            "adaptation off."
        ),
    ] = 0.4
    k_yaw: Annotated[GainOrOff, msgspec.Meta(description="Heading gain [1/s].")] = 1.0
    sigma_bound: Annotated[
        SpeedBound,
        msgspec.Meta(
            description="M: bound of σ [m/s], and the speed error up to which u* is linear in it; "
            "paper: 1.5. In a hold and with calm gains (see k2) at most 3."
        ),
    ] = 6.0
    sigma_slope: Annotated[
        Gain,
        msgspec.Meta(
            description="r: slope of σ at 0 [1/s]; paper: 3. With calm gains (see k2) at most 3."
        ),
    ] = 4.5
    rho_bound: Annotated[
        Ratio,
        msgspec.Meta(
            description="Bound of ρ [-]. In a hold and with calm gains (see k2) at most 2."
        ),
    ] = 6.0
    rho_slope: Annotated[
        Ratio,
        msgspec.Meta(
            description="Slope of ρ at 0 [s/m]. In a hold at most 2, with calm gains (see k2) 1."
        ),
    ] = 3.0
    velocity_scale: Annotated[
        SpeedBound,
        msgspec.Meta(
            description="c: speed beyond M over which Ω' begins to grow [m/s]; less grows faster."
        ),
    ] = 1.0
    b_bound: Annotated[
        AccelerationBound,
        msgspec.Meta(
            description="B: largest disturbance to adapt to [m/s²]. The default 14, which the "
            "paper's vehicle can trim sideways, is replaced by what yours can: "
            "`vehicle.wind_share` of √((T_max/m)² - g²), but at least 5."
        ),
    ] = 14.0
    epsilon: Annotated[
        AccelerationBound, msgspec.Meta(description="ε: b̂ stays within B + ε [m/s²].")
    ] = 0.5
    delta: Annotated[Smoothing, msgspec.Meta(description="δ: smooths the projection [m²/s⁴].")] = (
        0.1
    )
    projection_order: Annotated[
        int,
        msgspec.Meta(
            ge=1, le=6, description="n: the projection is n times continuously differentiable."
        ),
    ] = 1

    @cached_property
    def shape(self) -> "Shape":
        """Gain and functions of one axis."""
        sigma = make_saturation(self.sigma_bound, self.sigma_slope)
        rho = make_saturation(self.rho_bound, self.rho_slope)
        return Shape(self.k2, sigma, rho, self.velocity_scale)


class Saturation(msgspec.Struct, frozen=True, gc=False):
    """σ or ρ: M r s/root with root = √(M² + r² s²), and the constants of its derivatives and its
    integral.
    """

    bound: Real
    """M."""
    slope: Real
    """r."""
    bound2: Real
    """M²."""
    steepness: Real
    """r M³, for the first derivative σ' = r M³/root³."""
    bend: Real
    """-3 r, for the second derivative σ'' = -3 r (r s) σ'/root²."""
    area: Real
    """M/r, for the integral φ = (M/r) (root - M)."""


def make_saturation(bound: Real, slope: Real) -> Saturation:
    """Return σ or ρ of this ``bound`` M and ``slope`` r."""
    return Saturation(
        bound, slope, bound * bound, slope * bound * bound * bound, -3.0 * slope, bound / slope
    )


def integrate_saturation(sigma: Saturation, rs: Real, root: Real) -> Real:
    """Return φ(s), the integral of σ from 0 to s: (M/r)(root - M), written without the cancellation
    near 0.

    Args:
        sigma: σ.
        rs: r s.
        root: √(M² + r² s²).
    """
    return sigma.area * rs * rs / (root + sigma.bound)


class Shape(msgspec.Struct, frozen=True, gc=False):
    """Gain and functions of one axis; all three axes have the same."""

    k2: Real
    sigma: Saturation
    """σ."""
    rho: Saturation
    """ρ."""
    velocity_scale: Real
    """c of Ω [m/s]."""


def evaluate_growth(ops: Ops, s: Real, bound: Real, scale: Real) -> tuple[Real, Real, Real]:
    """Return Ω(s) - s, Ω'(s), Ω''(s): Ω is the identity on [-M, M] and faster than linear outside.

    The excess Ω(s) - s is returned, not Ω itself: it is exactly 0 inside, so that a quotient
    z2/(Ω(x2) + Ω(σ)) = z2/(z2 + excess) needs no subtraction of nearly equal numbers.

    Args:
        ops: elementary functions.
        s: the argument [m/s].
        bound: M [m/s].
        scale: c > 0 [m/s], the distance from M over which Ω' begins to grow.
    """
    y = ops.clamp(abs(s) - bound, 0.0, math.inf)  # y and Ω as in docs/explanation/law.md, section 2
    t = y / scale
    first = ops.sqrt(1.0 + t * t)
    sign = ops.where(s < 0.0, -1.0, 1.0)
    excess = sign * (0.5 * (y * first + scale * ops.asinh(t)) - y)
    second = sign * t / (scale * first)
    return excess, first, second


def project(
    ops: Ops, xi: Vec3, b_hat: Vec3, *, bound: Real, epsilon: Real, delta: Real, order: int
) -> Vec3:
    """Return Proj(ξ, b̂) = ξ - η1 η2 / (2 (ε² + 2εB)^(n+1) B²) b̂, equation (9) with the signs and
    squares that the print lacks.

    Args:
        ops: elementary functions.
        xi: ξ [m/s³], NED: the direction in which the estimate would move without projection.
        b_hat: b̂ [m/s²], NED.
        bound: B > 0 [m/s²].
        epsilon: ε > 0 [m/s²].
        delta: δ > 0 [m²/s⁴]: smooths η2 about zero.
        order: n >= 1; Proj is n times continuously differentiable.

    Returns:
        Proj(ξ, b̂), which equals ξ wherever |b̂| <= B (P1-P4 of the paper, Theorem 3).
    """
    (x, y, z), (bx, by, bz) = xi, b_hat
    eta1 = ops.clamp(bx * bx + by * by + bz * bz - bound * bound, 0.0, math.inf) ** (order + 1)
    inner = bx * x + by * y + bz * z
    eta2 = inner + ops.sqrt(inner * inner + delta * delta)
    k = (
        eta1
        * eta2
        / (2.0 * (epsilon * epsilon + 2.0 * epsilon * bound) ** (order + 1) * bound * bound)
    )
    return (x - k * bx, y - k * by, z - k * bz)


def clamp_length(ops: Ops, b_hat: Vec3, radius: Real) -> Vec3:
    """Scale b̂ radially into the ball of ``radius``.

    For a true b in that ball this never increases |b - b̂|.
    """
    bx, by, bz = b_hat
    length = ops.sqrt(bx * bx + by * by + bz * bz + 1e-300)  # not 0 where b̂ is
    k = ops.clamp(radius / length, 0.0, 1.0)
    return (bx * k, by * k, bz * k)


INPUT_LIMIT = 1e6
"""Limit of the thrust, and of each component of the other inputs that the law calculates with
[SI units]: no finite input overflows, though V grows with their fourth power. Chosen: far beyond
any flight."""
THRUST_SHARE_MIN = 1e-3
"""Least thrust that the law calculates with, as a share of the weight [-]: it divides by it.
Chosen: far below any thrust that flies."""
COS_ROLL_MIN = 0.2
"""Least |cos(roll)| that the heading rate is divided by [-]: 0.2 is a roll of 78 deg, beyond the
tilt limits in use."""


class BacksteppingAxis(msgspec.Struct, frozen=True, gc=False):
    """Values of the law along one axis, at one state."""

    z3: Real
    """[m/s²]."""
    xi: Real
    """ξ of (8) [m/s³]."""
    demand: Real
    """k3 z3 + ∂V/∂z2, a term of y in (10) [m/s³]."""
    u_star_dot: Real
    """u˙* for b̂ = b, another term of y in (10) [m/s³]."""
    z2: Real
    """[m/s]."""
    sigma: Real
    """σ(z1) [m/s]."""
    u_star: Real
    """[m/s²]."""
    rho: Real
    """ρ(z2) [-]."""
    omega: Real
    """Ω(x2) + Ω(σ) [m/s]."""
    rs: Real
    """r z1, for φ(z1)."""
    root: Real
    """√(M² + r² z1²), for φ(z1)."""
    sigma_prime: Real
    """σ'(z1) [1/s]."""
    du_dz1: Real
    """∂u*/∂z1 [1/s²]."""
    du_dz2: Real
    """∂u*/∂z2 [1/s]."""
    dv_dz2: Real
    """∂V/∂z2 [m/s]."""


class LawOutput(msgspec.Struct, frozen=True, gc=False):
    """Output of the law at one instant."""

    thrust_rate: Real
    """Ṫ [N/s]."""
    rate_x: Real
    """ω1 [rad/s], roll rate, FRD."""
    rate_y: Real
    """ω2 [rad/s], pitch rate, FRD."""
    b_hat_dot: Vec3
    """b̂˙ [m/s³], NED."""
    z1: Vec3
    z2: Vec3
    z3: Vec3
    u_star: Vec3
    v_terms: Vec3
    """Σ φ(z1), ½|Ω(x2) + Ω(σ)|², ½ z3ᵀz3: all of V but its b̃ term."""
    w_terms: Vec3
    """σᵀσ, k2 z2ᵀρ(z2), z3ᵀ k3 z3: all of W."""
    v_known: Real
    """V_DI + ½ z3ᵀz3: V without its b̃ term."""
    w: Real
    """W = σᵀσ + k2 z2ᵀρ(z2) + z3ᵀ k3 z3."""


def evaluate_axis(
    ops: Ops,
    shape: Shape,
    z1: Real,
    z1_dot: Real,
    u_hat: Real = 0.0,
    k3: Real = 0.0,
    drag: float = 0.0,
) -> BacksteppingAxis:
    """Evaluate one axis of (5), (6) and (7), the partial derivatives in (z1, z2), and its terms of
    (8) and (10).

    Symbols as in docs/explanation/law.md, section 2: x2 = z1˙, q and M; s, s1, s2 are σ(z1) and its
    derivatives, o1, o2 are Ω' and Ω'' at x2, a = k2 ρ(z2) + σ(z1). u_x1, u_x2 and u_z1 are partial
    derivatives of u*.
    """
    k2, sigma, rho_shape, x2, sqrt = shape.k2, shape.sigma, shape.rho, z1_dot, ops.sqrt
    m, rs = sigma.bound, sigma.slope * z1
    root = sqrt(sigma.bound2 + rs * rs)
    w = 1.0 / root
    s, s1 = m * rs * w, sigma.steepness * w * w * w
    s2 = sigma.bend * rs * w * w * s1
    z2 = x2 + s  # (5)
    rz = rho_shape.slope * z2
    w = 1.0 / sqrt(rho_shape.bound2 + rz * rz)
    rho, rho1 = rho_shape.bound * rz * w, rho_shape.steepness * w * w * w
    a = k2 * rho + s
    excess, o1, o2 = evaluate_growth(ops, x2, m, shape.velocity_scale)
    # Ω(x2) + Ω(σ) = z2 + excess: zero only where the excess is (|σ| < M < |x2|), and there q = 1.
    omega = z2 + excess
    over = 1.0 / ops.where(excess == 0.0, 1.0, omega)
    q, i, by_z2 = 1.0 - excess * over, 1.0 / o1, o1 * omega  # by_z2 is ∂V/∂z2
    u_star = -i * (q * a + s1 * x2)  # (6)
    q_x1 = s1 * excess * over * over
    q_x2 = (z2 * (1.0 - o1) + excess) * over * over
    u_x1 = -i * (q_x1 * a + q * (k2 * rho1 + 1.0) * s1 + s2 * x2)
    u_x2 = -i * (q_x2 * a + q * k2 * rho1 + s1) - u_star * o2 * i
    u_z1, z3 = u_x1 - s1 * u_x2, u_hat - u_star  # (7)
    return BacksteppingAxis(
        z3, by_z2 - (u_x2 + drag) * z3, k3 * z3 + by_z2, u_z1 * x2 + u_x2 * (u_hat + s1 * x2),
        z2, s, u_star, rho, omega, rs, root, s1, u_z1, u_x2, by_z2,
    )  # fmt: skip


def clamp_each(ops: Ops, v: Vec3, limit: float) -> Vec3:
    """Clamp each component to ±``limit``."""
    (x, y, z), clamp = v, ops.clamp
    return clamp(x, -limit, limit), clamp(y, -limit, limit), clamp(z, -limit, limit)


class LawState(NamedTuple):
    """Input of one evaluation of the law."""

    z1: Vec3
    """p - pd [m], NED."""
    z1_dot: Vec3
    """v - p˙d [m/s], NED."""
    velocity: Vec3
    """v [m/s], NED, for the drag."""
    attitude: Quat
    """Unit quaternion, body FRD to world NED."""
    thrust: Real
    """T [N], at least ``THRUST_SHARE_MIN`` of the weight is taken."""
    b_hat: Vec3
    """b̂ [m/s²], NED."""
    acceleration: Vec3
    """p¨d [m/s²], NED."""
    jerk: Vec3
    """p⃛d [m/s³], NED."""


class LawTerms(msgspec.Struct, frozen=True, gc=False):
    """Terms of the law's output."""

    axes: tuple[BacksteppingAxis, BacksteppingAxis, BacksteppingAxis]
    z1: Vec3
    """Clamped position error [m], NED."""
    kb: Real
    """Adaptation gain: 0 while suspended."""
    b_hat_dot: Vec3
    """kb Proj(ξ, b̂) [m/s³], NED."""
    thrust: Real
    """Clamped T [N]."""
    y: Vec3
    """y of (10) [m/s³], FRD."""


def backstep(
    ops: Ops,
    law: Law,
    state: LawState,
    mass: Real,
    drag: float = 0.0,
    *,
    composite_term: Vec3 | None = None,
    suspended: bool = False,
) -> LawOutput:
    """Evaluate the law once.

    Args:
        ops: elementary functions (floats, or arrays of shape (N,)).
        law: gains.
        state: errors, vehicle and reference.
        mass: [kg].
        drag: configured linear drag c [1/s]: -c v is a part of the acceleration.
        composite_term: κ (d̂ - b̂) [m/s³], NED, of composite adaptation, or None. It is added to ξ
            in b̂˙. Ṫ and ω do not contain it: they use b̂˙ = kb Proj(ξ, b̂), which follows gusts
            better (docs/decisions/0005-observer-and-adaptation.md).
        suspended: whether b̂ is frozen (on the ground, saturated); the law then uses b̂˙ = 0.
    """
    terms = _evaluate(ops, law, state, mass, drag, suspended)
    (x, y, z), b_dot = terms.axes, terms.b_hat_dot
    thrust, (y1, y2, y3) = terms.thrust, terms.y
    if composite_term is not None:
        xi = add((x.xi, y.xi, z.xi), composite_term)
        b_dot = _find_adaptation(ops, law, terms.kb, xi, state.b_hat)
    v_terms, w_terms = _find_lyapunov_terms(law, x, y, z)
    return LawOutput(
        mass * y3,  # (10)
        -(mass / thrust) * y2,
        (mass / thrust) * y1,
        b_dot,
        terms.z1,
        (x.z2, y.z2, z.z2),
        (x.z3, y.z3, z.z3),
        (x.u_star, y.u_star, z.u_star),
        v_terms,
        w_terms,
        v_terms[0] + v_terms[1] + v_terms[2],
        w_terms[0] + w_terms[1] + w_terms[2],
    )


def _find_lyapunov_terms(
    law: Law, x: BacksteppingAxis, y: BacksteppingAxis, z: BacksteppingAxis
) -> tuple[Vec3, Vec3]:
    """Return the terms of V and of W in position, velocity and the third error."""
    level2, down2 = x.z3 * x.z3 + y.z3 * y.z3, z.z3 * z.z3
    k2, sigma = law.k2, law.shape.sigma
    v_position = (
        integrate_saturation(sigma, x.rs, x.root)
        + integrate_saturation(sigma, y.rs, y.root)
        + integrate_saturation(sigma, z.rs, z.root)
    )
    v_velocity = 0.5 * x.omega * x.omega + 0.5 * y.omega * y.omega + 0.5 * z.omega * z.omega
    v_third = 0.5 * (level2 + down2)
    w_position = x.sigma * x.sigma + y.sigma * y.sigma + z.sigma * z.sigma
    w_velocity = k2 * x.z2 * x.rho + k2 * y.z2 * y.rho + k2 * z.z2 * z.rho
    w_third = law.k3 * level2 + law.k3_down * down2
    return (v_position, v_velocity, v_third), (w_position, w_velocity, w_third)


def compute_turn_rates(
    ops: Ops, law: Law, state: LawState, mass: Real, drag: float = 0.0, suspended: bool = False
) -> tuple[Real, Real]:
    """Return ω1 and ω2 [rad/s] of :func:`backstep`, without the rest."""
    terms = _evaluate(ops, law, state, mass, drag, suspended)
    y1, y2, _ = terms.y
    return -(mass / terms.thrust) * y2, (mass / terms.thrust) * y1


def _evaluate(
    ops: Ops, law: Law, state: LawState, mass: Real, drag: float, suspended: bool
) -> LawTerms:
    """Evaluate the three axes and (10)."""
    z1, z1_dot, (vx, vy, vz), attitude, thrust, b_hat, acceleration, jerk = state
    bx, by, bz = b_hat
    z1x, z1y, z1z = z1 = clamp_each(ops, z1, INPUT_LIMIT)
    z1x_dot, z1y_dot, z1z_dot = clamp_each(ops, z1_dot, INPUT_LIMIT)
    ax, ay, az = clamp_each(ops, acceleration, INPUT_LIMIT)
    jx, jy, jz = clamp_each(ops, jerk, INPUT_LIMIT)
    thrust = ops.clamp(thrust, THRUST_SHARE_MIN * mass * law.gravity, INPUT_LIMIT)
    north, east, down = third_column(attitude)
    push = -thrust / mass
    ux, uy, uz = push * north + bx - ax, push * east + by - ay, push * down + law.gravity + bz - az
    if drag:
        ux, uy, uz = ux - drag * vx, uy - drag * vy, uz - drag * vz
        # The drag changes û by -c v˙. Of v˙, û + p¨d is known; -c b̃ is left to the adaptation.
        jx, jy, jz = jx + drag * (ux + ax), jy + drag * (uy + ay), jz + drag * (uz + az)
    shape, k3 = law.shape, law.k3
    x = evaluate_axis(ops, shape, z1x, z1x_dot, ux, k3, drag)
    y = evaluate_axis(ops, shape, z1y, z1y_dot, uy, k3, drag)
    z = evaluate_axis(ops, shape, z1z, z1z_dot, uz, law.k3_down, drag)
    kb = ops.where(suspended, 0.0, law.kb)
    b_hat_dot = _find_adaptation(ops, law, kb, (x.xi, y.xi, z.xi), b_hat)  # (8)
    bx_dot, by_dot, bz_dot = b_hat_dot
    y_ned = (
        x.demand + bx_dot - jx - x.u_star_dot,
        y.demand + by_dot - jy - y.u_star_dot,
        z.demand + bz_dot - jz - z.u_star_dot,
    )
    return LawTerms((x, y, z), z1, kb, b_hat_dot, thrust, to_body(attitude, y_ned))


def _find_adaptation(ops: Ops, law: Law, kb: Real, xi: Vec3, b_hat: Vec3) -> Vec3:
    """Return b̂˙ = kb Proj(ξ, b̂) [m/s³]; ``kb`` is 0 where adaptation is suspended."""
    projected = project(
        ops,
        xi,
        b_hat,
        bound=law.b_bound,
        epsilon=law.epsilon,
        delta=law.delta,
        order=law.projection_order,
    )
    return scale(kb, projected)


def compute_yaw_rate(
    ops: Ops, attitude: Quat, yaw: Real, yaw_dot: Real, rate_y: Real, k_yaw: Real, limit: Real
) -> Real:
    """Return ω3 [rad/s] that turns the heading towards ``yaw`` [rad]; the law leaves ω3 free.

    ω3 = (cosθ (ψ˙d - k_ψ sin(ψ - ψd)) - sinφ ω2)/cosφ, with |cosφ| >= ``COS_ROLL_MIN``, and within
    ±``limit`` [rad/s].
    """
    w, x, y, z = attitude
    # The first column and last row of R give the angles without trigonometry; 1e-12 avoids 0/0
    # where a norm is 0.
    north, east = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
    cos_pitch = ops.sqrt(north * north + east * east + 1e-12)
    r32, r33 = 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    roll_norm = ops.sqrt(r32 * r32 + r33 * r33 + 1e-12)
    sin_roll, cos_roll = r32 / roll_norm, r33 / roll_norm
    # sin(ψ - ψd) by the difference formula, from (cosψ, sinψ) = (north, east)/cosθ.
    sine = (east * ops.cos(yaw) - north * ops.sin(yaw)) / cos_pitch
    cos_roll = ops.where(cos_roll < 0.0, -1.0, 1.0) * ops.clamp(abs(cos_roll), COS_ROLL_MIN, 1.0)
    rate = (cos_pitch * (yaw_dot - k_yaw * sine) - sin_roll * rate_y) / cos_roll
    return ops.clamp(rate, -limit, limit)
