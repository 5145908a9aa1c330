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
from functools import cached_property
from typing import Annotated, Any, NamedTuple, TypeAlias

import msgspec

from groundstation.core.estimation import Estimation, NonNegative, Positive
from groundstation.core.geometry import FLOATS, Ops, Quat, Real, Vec3, third_column, to_body


class Law(Estimation, frozen=True, kw_only=True, forbid_unknown_fields=True, dict=True):
    """Gains of the pure law. Defaults and where they come from: docs/explanation/law.md; the paper's are said beside.

    It stands on :class:`Estimation` only because a struct has one base; the law reads ``gravity`` of it.
    """

    k2: Annotated[
        Positive,
        msgspec.Meta(
            description="Gain on ρ(z2) [m/s²]; paper: 2. Off the figure, and on it for 5 s after "
            "poses were suspect, at most 1.75."
        ),
    ] = 2.0
    k3: Annotated[Positive, msgspec.Meta(description="Gain on z3 [1/s]; paper: 4.")] = 5.0
    k3_down: Annotated[
        Positive,
        msgspec.Meta(
            description="The same for the vertical axis [1/s], where only thrust acts; paper: 4. "
            "Off the figure, as k2, at most 6."
        ),
    ] = 14.0
    kb: Annotated[
        NonNegative,
        msgspec.Meta(
            description="Adaptation gain [1/s² per m/s² of V's gradient]; paper: 1; 0 switches adaptation off."
        ),
    ] = 0.4
    k_yaw: Annotated[NonNegative, msgspec.Meta(description="Heading gain [1/s].")] = 1.0
    sigma_bound: Annotated[
        Positive,
        msgspec.Meta(
            description="M: bound of σ [m/s], and the speed error up to which u* is linear in it; "
            "paper: 1.5. Off the figure, as k2, at most 3."
        ),
    ] = 6.0
    sigma_slope: Annotated[
        Positive, msgspec.Meta(description="r: slope of σ at 0 [1/s]; paper: 3. Off the figure, as k2, at most 3.")
    ] = 4.5
    rho_bound: Annotated[Positive, msgspec.Meta(description="Bound of ρ [-]. Off the figure, as k2, at most 2.")] = 6.0
    rho_slope: Annotated[
        Positive, msgspec.Meta(description="Slope of ρ at 0 [s/m]. Off the figure, as k2, at most 1.")
    ] = 3.0
    velocity_scale: Annotated[Positive, msgspec.Meta(description="c: how fast Ω grows beyond M [m/s].")] = 1.0
    b_bound: Annotated[
        Positive,
        msgspec.Meta(
            description="B: largest disturbance to adapt to [m/s²]. 14 is what the paper's vehicle "
            "can trim sideways; left so, it is what this vehicle can: `vehicle.wind_share` of "
            "√((T_max/m)² - g²), but at least 5."
        ),
    ] = 14.0
    epsilon: Annotated[Positive, msgspec.Meta(description="ε: b̂ stays within B + ε [m/s²].")] = 0.5
    delta: Annotated[Positive, msgspec.Meta(description="δ: smooths the projection [m²/s⁴].")] = 0.1
    projection_order: Annotated[
        int, msgspec.Meta(ge=1, le=6, description="n: the projection is n times continuously differentiable.")
    ] = 1

    @cached_property
    def shape(self) -> "Shape":
        """What one axis of the law is made of."""
        sigma, rho = saturation(self.sigma_bound, self.sigma_slope), saturation(self.rho_bound, self.rho_slope)
        return Shape(self.k2, sigma, rho, self.velocity_scale)


class Saturation(msgspec.Struct, frozen=True, gc=False):
    """σ or ρ, M r s/√(M² + r² s²): bound M, slope r, and what is made of these alone."""

    bound: Real
    """M."""
    slope: Real
    """r."""
    bound2: Real
    """M²."""
    steepness: Real
    """r M³: σ' is that over the root's cube."""
    bend: Real
    """-3 r: σ'' is that times r s σ' over the root's square."""
    area: Real
    """M/r, of the integral φ."""


def saturation(bound: Real, slope: Real) -> Saturation:
    """The member of the family that has this bound and slope."""
    return Saturation(bound, slope, bound * bound, slope * bound * bound * bound, -3.0 * slope, bound / slope)


def integral(by: Saturation, rs: Real, root: Real) -> Real:
    """φ(s), the integral of σ from 0: (M/r)(√(M² + r² s²) - M), written without the cancellation near 0."""
    return by.area * rs * rs / (root + by.bound)


class Shape(msgspec.Struct, frozen=True, gc=False):
    """Gains and functions of one axis; the same for all three."""

    k2: Real
    sigma: Saturation
    """σ."""
    rho: Saturation
    """ρ."""
    velocity_scale: Real
    """c of Ω [m/s]."""


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


def brink(ops: Ops, b_hat: Vec3, bound: Real, epsilon: Real, order: int) -> Brink | None:
    """η1, and 2 (ε² + 2εB)^(n+1) B²; None for one vehicle within B, as nearly always: nothing is held back then."""
    bx, by, bz = b_hat
    square = bx * bx + by * by + bz * bz
    if ops is FLOATS and square <= bound * bound:
        return None
    outside = ops.clamp(square - bound * bound, 0.0, math.inf)
    scale = 2.0 * (epsilon * epsilon + 2.0 * epsilon * bound) ** (order + 1) * bound * bound
    return Brink(outside ** (order + 1), scale)


def project_at(ops: Ops, xi: Vec3, b_hat: Vec3, edge: Brink, delta: Real) -> Vec3:
    """Proj(ξ, b̂) at that ``edge``."""
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
    edge = brink(ops, b_hat, bound, epsilon, order)
    return xi if edge is None else project_at(ops, xi, b_hat, edge, delta)


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


class BacksteppingAxis(NamedTuple):
    """One axis of the law: what drives it, its errors, and the virtual control with its partial derivatives."""

    z3: Real
    xi: Real
    """ξ of (8)."""
    demand: Real
    """k3 z3 + ∂V/∂z2: what (10) asks for beside the known parts."""
    u_star_dot: Real
    """u˙* as it would be if b̂ were b."""
    z2: Real
    sigma: Real
    u_star: Real
    rho: Real
    """ρ(z2)."""
    omega: Real
    """Ω(x2) + Ω(σ) [m/s]."""
    rs: Real
    """r z1 and the root of σ(z1), for φ(z1)."""
    root: Real
    sigma_prime: Real
    du_dz1: Real
    du_dz2: Real
    dv_dz2: Real


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
    v_known: Real
    """V_DI + ½ z3ᵀz3: V without its b̃ term."""
    w: Real
    """W = σᵀσ + k2 z2ᵀρ(z2) + z3ᵀ k3 z3."""


def axis(
    ops: Ops, shape: Shape, z1: Real, z1_dot: Real, u_hat: Real = 0.0, k3: Real = 0.0, drag: float = 0.0
) -> tuple[Real, ...]:
    """(5), (6), their partial derivatives in (z1, z2), (7), and what (8) and (10) take, of one axis.

    It gives what :class:`BacksteppingAxis` names: it runs six times a command, and a plain tuple is made and taken
    apart in less than half of a named one's time.
    """
    k2, by, x2, sqrt = shape.k2, shape.sigma, z1_dot, ops.sqrt
    m, rs = by.bound, by.slope * z1
    root = sqrt(by.bound2 + rs * rs)
    w = 1.0 / root
    s, s1 = m * rs * w, by.steepness * w * w * w  # σ(z1) and its derivatives
    s2 = by.bend * rs * w * w * s1
    z2, by = x2 + s, shape.rho  # (5)
    rz = by.slope * z2
    w = 1.0 / sqrt(by.bound2 + rz * rz)
    rho, rho1 = by.bound * rz * w, by.steepness * w * w * w  # ρ(z2)
    a = k2 * rho + s
    if ops is FLOATS and -m <= x2 <= m:
        # One vehicle is here nearly always, where Ω is the identity: the same, without what is then 0 or 1.
        slope, omega, by_z2 = k2 * rho1, z2, z2
        u_star, u_x1, u_x2 = -(a + s1 * x2), -((slope + 1.0) * s1 + s2 * x2), -(slope + s1)
    else:
        excess, o1, o2 = growth(ops, x2, m, shape.velocity_scale)
        # Ω(x2) + Ω(σ) = z2 + excess: zero only where the excess is (|σ| < M < |x2|), and there q = 1.
        omega = z2 + excess
        over = 1.0 / ops.where(excess == 0.0, 1.0, omega)
        q, i, by_z2 = 1.0 - excess * over, 1.0 / o1, o1 * omega
        u_star = -i * (q * a + s1 * x2)  # (6)
        q_x1 = s1 * excess * over * over
        q_x2 = (z2 * (1.0 - o1) + excess) * over * over
        u_x1 = -i * (q_x1 * a + q * (k2 * rho1 + 1.0) * s1 + s2 * x2)
        u_x2 = -i * (q_x2 * a + q * k2 * rho1 + s1) - u_star * o2 * i
    u_z1, z3 = u_x1 - s1 * u_x2, u_hat - u_star  # (7)
    return (
        z3, by_z2 - (u_x2 + drag) * z3, k3 * z3 + by_z2, u_z1 * x2 + u_x2 * (u_hat + s1 * x2),
        z2, s, u_star, rho, omega, rs, root, s1, u_z1, u_x2, by_z2,
    )  # fmt: skip


def confine(ops: Ops, v: Vec3, limit: float) -> Vec3:
    """Each component within ±``limit``."""
    (x, y, z), clamp = v, ops.clamp
    return clamp(x, -limit, limit), clamp(y, -limit, limit), clamp(z, -limit, limit)


NEAR2 = min(POSITION_LIMIT, VELOCITY_LIMIT) ** 2
"""Where the squares of all that is confined add up to less, as in every flight, nothing has to be."""


class LawState(NamedTuple):
    """What one evaluation of the law is of: a plain tuple does as well, and is made in a third of the time."""

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


State: TypeAlias = tuple[Vec3, Vec3, Vec3, Quat, Real, Vec3, Vec3, Vec3]
"""What :class:`LawState` names."""


def backstep(
    ops: Ops,
    law: Law,
    state: State,
    mass: Real,
    drag: float = 0.0,
    *,
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
    x, y, z, z1, edge, kb, b_dot, thrust, turn = _evaluate(ops, law, state, mass, drag, suspended)
    z3x, xi_x, _, _, xz2, xs, xu, x_rho, x_omega, xr, x_root, _, _, _, _ = x
    z3y, xi_y, _, _, yz2, ys, yu, y_rho, y_omega, yr, y_root, _, _, _, _ = y
    z3z, xi_z, _, _, zz2, zs, zu, z_rho, z_omega, zr, z_root, _, _, _, _ = z
    if witness is not None:
        more = (xi_x + witness[0], xi_y + witness[1], xi_z + witness[2])
        b_dot = _adaptation(ops, law, kb, more, state[5], edge)
    aside, down, k2 = z3x * z3x + z3y * z3y, z3z * z3z, law.k2
    by = law.shape.sigma
    phi = integral(by, xr, x_root) + integral(by, yr, y_root) + integral(by, zr, z_root)
    stored = 0.5 * x_omega * x_omega + 0.5 * y_omega * y_omega + 0.5 * z_omega * z_omega
    third = 0.5 * (aside + down)
    near, lost = xs * xs + ys * ys + zs * zs, k2 * xz2 * x_rho + k2 * yz2 * y_rho + k2 * zz2 * z_rho
    turned = law.k3 * aside + law.k3_down * down
    return LawOutput(
        mass * turn[2],  # (10)
        -(mass / thrust) * turn[1],
        (mass / thrust) * turn[0],
        b_dot,
        z1,
        (xz2, yz2, zz2),
        (z3x, z3y, z3z),
        (xu, yu, zu),
        (phi, stored, third),
        (near, lost, turned),
        phi + stored + third,
        near + lost + turned,
    )


def turn_rates(
    ops: Ops, law: Law, state: State, mass: Real, drag: float = 0.0, suspended: bool = False
) -> tuple[Real, Real]:
    """ω1 and ω2 [rad/s] alone of what :func:`backstep` says of the same."""
    evaluated = _evaluate(ops, law, state, mass, drag, suspended)
    thrust, turn = evaluated[7], evaluated[8]
    return -(mass / thrust) * turn[1], (mass / thrust) * turn[0]


def _evaluate(ops: Ops, law: Law, state: State, mass: Real, drag: float, suspended: bool) -> Any:
    """The three axes, z1, the projection's edge, kb as it acts, b̂˙ = kb Proj(ξ, b̂), T, and y of (10), FRD."""
    z1, z1_dot, (vx, vy, vz), attitude, thrust, b_hat, acceleration, jerk = state
    bx, by, bz = b_hat
    (a, b, c), (d, e, f), (ax, ay, az), (jx, jy, jz) = z1, z1_dot, acceleration, jerk
    if ops is not FLOATS or not (
        a * a + b * b + c * c + d * d + e * e + f * f
        + ax * ax + ay * ay + az * az + jx * jx + jy * jy + jz * jz < NEAR2
    ):  # fmt: skip
        a, b, c = z1 = confine(ops, z1, POSITION_LIMIT)
        d, e, f = confine(ops, z1_dot, VELOCITY_LIMIT)
        ax, ay, az = confine(ops, acceleration, POSITION_LIMIT)
        jx, jy, jz = confine(ops, jerk, POSITION_LIMIT)
    thrust = ops.clamp(thrust, 1e-3 * mass * law.gravity, 1e6)
    north, east, down = third_column(attitude)
    push = -thrust / mass
    ux, uy, uz = push * north + bx - ax, push * east + by - ay, push * down + law.gravity + bz - az
    if drag:
        ux, uy, uz = ux - drag * vx, uy - drag * vy, uz - drag * vz
        # û moves by -c v˙, of which û + p¨d is known, and -c b̃ is left to the adaptation.
        jx, jy, jz = jx + drag * (ux + ax), jy + drag * (uy + ay), jz + drag * (uz + az)
    shape, k3 = law.shape, law.k3
    x = axis(ops, shape, a, d, ux, k3, drag)
    y = axis(ops, shape, b, e, uy, k3, drag)
    z = axis(ops, shape, c, f, uz, law.k3_down, drag)
    edge = brink(ops, b_hat, law.b_bound, law.epsilon, law.projection_order)
    kb = ops.where(suspended, 0.0, law.kb)
    p, q, r = b_dot = _adaptation(ops, law, kb, (x[1], y[1], z[1]), b_hat, edge)  # (8)
    turn = to_body(attitude, (x[2] + p - jx - x[3], y[2] + q - jy - y[3], z[2] + r - jz - z[3]))
    return x, y, z, z1, edge, kb, b_dot, thrust, turn


def _adaptation(ops: Ops, law: Law, kb: Real, xi: Vec3, b_hat: Vec3, edge: Brink | None) -> Vec3:
    """b̂˙ = kb Proj(ξ, b̂); ``kb`` is 0 where adaptation is suspended."""
    x, y, z = xi if edge is None else project_at(ops, xi, b_hat, edge, law.delta)
    return (kb * x, kb * y, kb * z)


def yaw_rate(ops: Ops, attitude: Quat, yaw: Real, yaw_dot: Real, rate_y: Real, k_yaw: Real, limit: Real) -> Real:
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
    if ops is not FLOATS or not 0.2 <= cos_roll <= 1.0:
        cos_roll = ops.where(cos_roll < 0.0, -1.0, 1.0) * ops.clamp(abs(cos_roll), 0.2, 1.0)
    rate = (cos_pitch * (yaw_dot - k_yaw * sine) - sin_roll * rate_y) / cos_roll
    return ops.clamp(rate, -limit, limit)
