"""The law: nonlinear adaptive backstepping, equations (5)-(10) of Cabecinhas, Cunha, Silvestre, ACC 2013.

A pure function: state in, state rates and commands out; no clock, no I/O. The printed paper is wrong in
places; docs/explanation/law.md lists them, and this file is the corrected form.

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
    Ṫ, ω1, ω2   N/s, rad/s      what the vehicle should do                    (10)

On the plant of the paper, V˙ = -W + b̃ᵀ(ξ - Proj) <= -W.

σ and ρ are of one family: odd, smooth, bound ``bound`` and slope ``slope`` at 0. The paper prints
M r s/√(1+r²s²), whose slope is M·r; bound M and slope r need the form below.
Elementwise: floats, or arrays of shape (N,).
"""

import math
from typing import Annotated, Any, NamedTuple

import msgspec

from groundstation.core.estimation import Estimation, NonNegative, Positive
from groundstation.core.geometry import FLOATS, Ops, Quat, Real, Vec3, third_column, to_body


class Law(Estimation, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Gains of the pure law. Defaults and where they come from: docs/explanation/law.md; the paper's are said beside.

    It stands on :class:`Estimation` only because a struct has one base; the law reads ``gravity`` of it.
    """

    k2: Positive = 2.0
    """Gain on ρ(z2) [m/s²]; paper: 2. Off the figure, and on it for 5 s after poses were suspect, at most 1.75."""
    k3: Positive = 5.0
    """Gain on z3 [1/s]; paper: 4."""
    k3_down: Positive = 14.0
    """The same for the vertical axis [1/s], where only thrust acts; paper: 4. Off the figure, as k2, at most 6."""
    kb: NonNegative = 0.4
    """Adaptation gain [1/s² per m/s² of V's gradient]; paper: 1; 0 switches adaptation off."""
    k_yaw: NonNegative = 1.0
    """Heading gain [1/s]."""
    sigma_bound: Positive = 1.5
    """M: bound of σ [m/s]; paper: 1.5."""
    sigma_slope: Positive = 4.5
    """r: slope of σ at 0 [1/s]; paper: 3. Off the figure, as k2, at most 3."""
    rho_bound: Positive = 1.0
    """Bound of ρ [-]."""
    rho_slope: Positive = 3.0
    """Slope of ρ at 0 [s/m]. Off the figure, as k2, at most 1."""
    velocity_scale: Positive = 1.0
    """c: how fast Ω grows beyond M [m/s]."""
    b_bound: Positive = 5.0
    """B: largest disturbance to adapt to [m/s²]. It must cover thrust-scale errors (0.2 g = 2 m/s²) too. Left so, it is
    what `vehicle.wind_share` gives, where that is more."""
    epsilon: Positive = 0.5
    """ε: b̂ stays within B + ε [m/s²]."""
    delta: Positive = 0.1
    """δ: smooths the projection [m²/s⁴]."""
    projection_order: Annotated[int, msgspec.Meta(ge=1, le=6)] = 1
    """n: the projection is n times continuously differentiable."""


def saturation(ops: Ops, s: Real, bound: Real, slope: Real) -> tuple[Real, Real, Real, Real]:
    """σ(s) = M r s/√(M² + r² s²), its first and second derivative, and its integral φ(s) from 0.

    φ(s) = (M/r)(√(M² + r² s²) - M), written without the cancellation near 0.
    """
    rs = slope * s
    root = ops.sqrt(bound * bound + rs * rs)
    w = 1.0 / root
    first = slope * bound * bound * bound * w * w * w
    return bound * rs * w, first, -3.0 * slope * rs * w * w * first, bound / slope * rs * rs / (root + bound)


def growth(ops: Ops, s: Real, bound: Real, scale: Real) -> tuple[Real, Real, Real]:
    """Ω(s) - s, Ω'(s), Ω''(s): Ω is the identity on [-M, M] and faster than linear outside.

    The excess Ω(s) - s is returned, not Ω itself: it is exactly 0 inside, so that a quotient
    z2/(Ω(x2) + Ω(σ)) = z2/(z2 + excess) needs no subtraction of nearly equal numbers.

    Args:
        ops: elementary functions.
        s: the argument [m/s].
        bound: M [m/s].
        scale: c > 0 [m/s], how fast Ω' grows outside.
    """
    if ops is FLOATS and -bound <= s <= bound:
        # One vehicle is here nearly always: the same to the bit, in a third of the time.
        nought = -0.0 if s < 0.0 else 0.0
        return nought, 1.0, nought
    y = ops.clamp(abs(s) - bound, 0.0, math.inf)
    t = y / scale
    first = ops.sqrt(1.0 + t * t)
    sign = ops.where(s < 0.0, -1.0, 1.0)
    excess = sign * (0.5 * (y * first + scale * ops.asinh(t)) - y)
    second = sign * t / (scale * first)
    return excess, first, second


class Brink(msgspec.Struct, frozen=True, gc=False):
    """How far b̂ is beyond B: the part of (9) that does not depend on ξ."""

    eta1: Real
    scale: Real


def brink(ops: Ops, b_hat: Vec3, *, bound: Real, epsilon: Real, order: int) -> Brink | None:
    """η1, and 2 (ε² + 2εB)^(n+1) B²; None for one vehicle within B, as nearly always: nothing is held back then."""
    bx, by, bz = b_hat
    outside = ops.clamp(bx * bx + by * by + bz * bz - bound * bound, 0.0, math.inf)
    if ops is FLOATS and outside == 0.0:
        return None
    scale = 2.0 * (epsilon * epsilon + 2.0 * epsilon * bound) ** (order + 1) * bound * bound
    return Brink(outside ** (order + 1), scale)


def project_at(ops: Ops, xi: Vec3, b_hat: Vec3, edge: Brink | None, delta: Real) -> Vec3:
    """Proj(ξ, b̂) at that ``edge``."""
    if edge is None:
        return xi
    (x, y, z), (bx, by, bz) = xi, b_hat
    inner = bx * x + by * y + bz * z
    k = edge.eta1 * (inner + ops.sqrt(inner * inner + delta * delta)) / edge.scale
    return (x - k * bx, y - k * by, z - k * bz)


def project(ops: Ops, xi: Vec3, b_hat: Vec3, *, bound: Real, epsilon: Real, delta: Real, order: int) -> Vec3:
    """Proj(ξ, b̂) = ξ - η1 η2 / (2 (ε² + 2εB)^(n+1) B²) b̂, with the signs and squares that print lost.

    Args:
        ops: elementary functions.
        xi: ξ, what would drive the estimate without projection.
        b_hat: b̂ [m/s²], NED.
        bound: B > 0 [m/s²].
        epsilon: ε > 0 [m/s²].
        delta: δ > 0, smooths η2 about zero.
        order: n >= 1; Proj is n times continuously differentiable.

    Returns:
        Proj(ξ, b̂), which equals ξ wherever |b̂| <= B (P1-P4 of the paper, Theorem 3).
    """
    return project_at(ops, xi, b_hat, brink(ops, b_hat, bound=bound, epsilon=epsilon, order=order), delta)


def within(ops: Ops, b_hat: Vec3, radius: Real) -> Vec3:
    """b̂ scaled radially into the ball of ``radius``: after an Euler step this never increases |b - b̂|."""
    bx, by, bz = b_hat
    # The floor only avoids 0/0; inside the ball the factor is 1 whatever the length.
    square = bx * bx + by * by + bz * bz
    if ops is FLOATS and square < radius * radius:
        return b_hat
    length = ops.sqrt(square + 1e-300)
    k = ops.clamp(radius / length, 0.0, 1.0)
    return (bx * k, by * k, bz * k)


POSITION_LIMIT = 1e6
"""Errors are clamped here [m, m/s², m/s³], far beyond any room, so that no finite input overflows."""
VELOCITY_LIMIT = 1e4
"""[m/s]; V grows like the fourth power of the speed error."""


class BacksteppingAxis(msgspec.Struct, frozen=True, gc=False):
    """One axis of the double integrator: error, virtual control and its partial derivatives."""

    z1: Real
    z1_dot: Real
    z2: Real
    sigma: Real
    sigma_prime: Real
    u_star: Real
    du_dz1: Real
    du_dz2: Real
    dv_dz2: Real
    v_sigma: Real
    """φ(z1), the first part of V_DI."""
    v_omega: Real
    """½ (Ω(x2) + Ω(σ))², the second."""
    w_sigma: Real
    """σ², the first part of W."""
    w_rho: Real
    """k2 z2 ρ(z2), the second."""


class LawOutput(msgspec.Struct, frozen=True, gc=False):
    """What the law says at one instant."""

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

    @property
    def v_known(self) -> Real:
        """V_DI + ½ z3ᵀz3: V without its b̃ term."""
        return self.v_terms[0] + self.v_terms[1] + self.v_terms[2]

    @property
    def w(self) -> Real:
        """W = σᵀσ + k2 z2ᵀρ(z2) + z3ᵀ k3 z3."""
        return self.w_terms[0] + self.w_terms[1] + self.w_terms[2]


def axis(ops: Ops, law: Law, z1: Real, z1_dot: Real) -> BacksteppingAxis:
    """(5), (6) and their partial derivatives in (z1, z2), for one axis."""
    x1, x2, k2, m = z1, z1_dot, law.k2, law.sigma_bound
    s, s1, s2, v_sigma = saturation(ops, x1, m, law.sigma_slope)
    z2 = x2 + s  # (5)
    rho, rho1, _, _ = saturation(ops, z2, law.rho_bound, law.rho_slope)
    if ops is FLOATS and -m <= x2 <= m:
        # One vehicle is here nearly always, where Ω is the identity: the same, without what is then 0 or 1.
        a, slope = k2 * rho + s, k2 * rho1
        u_x1, u_x2 = -((slope + 1.0) * s1 + s2 * x2), -(slope + s1)
        du_dz1 = u_x1 - s1 * u_x2
        return BacksteppingAxis(
            x1, x2, z2, s, s1, -(a + s1 * x2), du_dz1, u_x2, z2, v_sigma, 0.5 * z2 * z2, s * s, k2 * z2 * rho
        )
    excess, o1, o2 = growth(ops, x2, m, law.velocity_scale)
    # Ω(x2) + Ω(σ) = z2 + excess: zero only where the excess is (|σ| < M < |x2|), and there q = 1.
    sum_ = z2 + excess
    over = 1.0 / ops.where(excess == 0.0, 1.0, sum_)
    q = 1.0 - excess * over
    a = k2 * rho + s
    i = 1.0 / o1
    u_star = -i * (q * a + s1 * x2)  # (6)
    q_x1 = s1 * excess * over * over
    q_x2 = (z2 * (1.0 - o1) + excess) * over * over
    u_x1 = -i * (q_x1 * a + q * (k2 * rho1 + 1.0) * s1 + s2 * x2)
    u_x2 = -i * (q_x2 * a + q * k2 * rho1 + s1) - u_star * o2 * i
    # In the order of the fields: by name it would take three times as long, three times a command.
    v_omega, du_dz1, dv_dz2 = 0.5 * sum_ * sum_, u_x1 - s1 * u_x2, o1 * sum_
    return BacksteppingAxis(x1, x2, z2, s, s1, u_star, du_dz1, u_x2, dv_dz2, v_sigma, v_omega, s * s, k2 * z2 * rho)


def confine(ops: Ops, v: Vec3, limit: float) -> Vec3:
    """Each component within ±``limit``."""
    x, y, z = v
    if ops is FLOATS and -limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit:
        return v
    clamp = ops.clamp
    return clamp(x, -limit, limit), clamp(y, -limit, limit), clamp(z, -limit, limit)


class LawState(NamedTuple):
    """What one evaluation of the law is of."""

    z1: Vec3
    """p - pd [m], NED."""
    z1_dot: Vec3
    """v - p˙d [m/s], NED."""
    velocity: Vec3
    """v [m/s], NED: what drag acts on."""
    attitude: Quat
    """Unit quaternion, body FRD to world NED."""
    thrust: Real
    """T [N]; the law needs T > 0 and takes at least a thousandth of the weight."""
    b_hat: Vec3
    """b̂ [m/s²], NED."""
    acceleration: Vec3
    """p¨d [m/s²], NED."""
    jerk: Vec3
    """p⃛d [m/s³], NED."""


def backstep(
    ops: Ops,
    law: Law,
    state: LawState,
    *,
    mass: Real,
    drag: float = 0.0,
    witness: Vec3 | None = None,
    suspended: bool = False,
) -> LawOutput:
    """One evaluation of the law.

    Args:
        ops: elementary functions (floats, or arrays of shape (N,)).
        law: gains.
        state: where, of which vehicle and reference.
        mass: [kg].
        drag: linear drag c as told: -c v is a part of the acceleration [1/s].
        witness: κ (d̂ - b̂) [m/s³ per kb], a second witness of the disturbance (composite adaptation), or None.
            It moves b̂ only: Ṫ and ω answer b̂˙ = kb Proj(ξ, b̂), which follows gusts better (docs/decisions/0005).
        suspended: True freezes b̂ (on the ground, saturated); the law then uses b̂˙ = 0.
    """
    (x, y, z), (z3x, z3y, z3z), xi, edge, kb, b_dot, thrust, turn = _evaluate(ops, law, state, mass, drag, suspended)
    if witness is not None:
        more = (xi[0] + witness[0], xi[1] + witness[1], xi[2] + witness[2])
        b_dot = _adaptation(ops, law, kb, more, state.b_hat, edge)
    aside, down = z3x * z3x + z3y * z3y, z3z * z3z
    return LawOutput(
        mass * turn[2],  # (10)
        -(mass / thrust) * turn[1],
        (mass / thrust) * turn[0],
        b_dot,
        (x.z1, y.z1, z.z1),
        (x.z2, y.z2, z.z2),
        (z3x, z3y, z3z),
        (x.u_star, y.u_star, z.u_star),
        (x.v_sigma + y.v_sigma + z.v_sigma, x.v_omega + y.v_omega + z.v_omega, 0.5 * (aside + down)),
        (x.w_sigma + y.w_sigma + z.w_sigma, x.w_rho + y.w_rho + z.w_rho, law.k3 * aside + law.k3_down * down),
    )


def turn_rates(
    ops: Ops, law: Law, state: LawState, *, mass: Real, drag: float = 0.0, suspended: bool = False
) -> tuple[Real, Real]:
    """ω1 and ω2 [rad/s] alone of what :func:`backstep` says of the same."""
    *_, thrust, turn = _evaluate(ops, law, state, mass, drag, suspended)
    return -(mass / thrust) * turn[1], (mass / thrust) * turn[0]


def _evaluate(ops: Ops, law: Law, state: LawState, mass: Real, drag: float, suspended: bool) -> Any:
    """The three axes, z3, ξ, the projection's edge, kb as it acts, b̂˙ = kb Proj(ξ, b̂), T, and y of (10), FRD."""
    z1, z1_dot, velocity, attitude, thrust, b_hat, acceleration, jerk = state
    a, b, c = confine(ops, z1, POSITION_LIMIT)
    d, e, f = confine(ops, z1_dot, VELOCITY_LIMIT)
    x, y, z = axis(ops, law, a, d), axis(ops, law, b, e), axis(ops, law, c, f)
    thrust = ops.clamp(thrust, 1e-3 * mass * law.gravity, 1e6)
    down = third_column(attitude)
    f = -thrust / mass
    ax, ay, az = confine(ops, acceleration, POSITION_LIMIT)
    ux = f * down[0] + b_hat[0] - ax
    uy = f * down[1] + b_hat[1] - ay
    uz = f * down[2] + law.gravity + b_hat[2] - az
    jx, jy, jz = confine(ops, jerk, POSITION_LIMIT)
    if drag:
        vx, vy, vz = velocity
        ux, uy, uz = ux - drag * vx, uy - drag * vy, uz - drag * vz
        # û moves by -c v˙, of which û + p¨d is known, and -c b̃ is left to the adaptation.
        jx, jy, jz = jx + drag * (ux + ax), jy + drag * (uy + ay), jz + drag * (uz + az)
    z3x, z3y, z3z = ux - x.u_star, uy - y.u_star, uz - z.u_star  # (7)
    xi: Vec3 = (
        x.dv_dz2 - (x.du_dz2 + drag) * z3x,
        y.dv_dz2 - (y.du_dz2 + drag) * z3y,
        z.dv_dz2 - (z.du_dz2 + drag) * z3z,
    )
    edge = brink(ops, b_hat, bound=law.b_bound, epsilon=law.epsilon, order=law.projection_order)
    kb = ops.where(suspended, 0.0, law.kb)
    b_dot = _adaptation(ops, law, kb, xi, b_hat, edge)  # (8)
    k3 = law.k3
    turn = to_body(
        attitude,
        (
            k3 * z3x + x.dv_dz2 + b_dot[0] - jx - _u_star_rate(x, ux),
            k3 * z3y + y.dv_dz2 + b_dot[1] - jy - _u_star_rate(y, uy),
            law.k3_down * z3z + z.dv_dz2 + b_dot[2] - jz - _u_star_rate(z, uz),
        ),
    )
    return (x, y, z), (z3x, z3y, z3z), xi, edge, kb, b_dot, thrust, turn


def _adaptation(ops: Ops, law: Law, kb: Real, xi: Vec3, b_hat: Vec3, edge: Brink | None) -> Vec3:
    """b̂˙ = kb Proj(ξ, b̂); ``kb`` is 0 where adaptation is suspended."""
    x, y, z = project_at(ops, xi, b_hat, edge, law.delta)
    return (kb * x, kb * y, kb * z)


def _u_star_rate(a: BacksteppingAxis, u_hat: Real) -> Real:
    """The known part of u˙*: what it would be if b̂ were b."""
    return a.du_dz1 * a.z1_dot + a.du_dz2 * (u_hat + a.sigma_prime * a.z1_dot)


def yaw_rate(ops: Ops, *, attitude: Quat, yaw: Real, yaw_dot: Real, rate_y: Real, k_yaw: Real, limit: Real) -> Real:
    """ω3 [rad/s] that turns the heading towards ``yaw`` [rad]; the law leaves ω3 free.

    ω3 = (cosθ (ψ˙d - k_ψ sin(ψ - ψd)) - sinφ ω2)/cosφ, kept away from |roll| = 90° and limited.
    """
    w, x, y, z = attitude
    # The first column and last row of R give the angles without trigonometry.
    north, east = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)
    cos_pitch = ops.sqrt(north * north + east * east + 1e-12)
    r32, r33 = 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    roll_norm = ops.sqrt(r32 * r32 + r33 * r33 + 1e-12)
    sin_roll, cos_roll = r32 / roll_norm, r33 / roll_norm
    # sin(ψ - ψd) by the difference formula, from (cosψ, sinψ) = (north, east)/cosθ.
    sine = (east * ops.cos(yaw) - north * ops.sin(yaw)) / cos_pitch
    cos_roll = ops.where(cos_roll < 0.0, -1.0, 1.0) * ops.clamp(abs(cos_roll), 0.2, 1.0)
    rate = (cos_pitch * (yaw_dot - k_yaw * sine) - sin_roll * rate_y) / cos_roll
    return ops.clamp(rate, -limit, limit)
