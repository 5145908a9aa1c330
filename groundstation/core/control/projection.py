"""The smooth projection (9) that keeps the disturbance estimate inside a ball of radius B + ε."""

import math

import msgspec

from groundstation.core.geometry import FLOATS, Ops, Real, Vec3


class Brink(msgspec.Struct, frozen=True, gc=False):
    """How far b̂ is beyond B: the part of (9) that does not depend on ξ."""

    eta1: Real
    scale: Real


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
    return held_back(ops, xi, b_hat, brink(ops, b_hat, bound=bound, epsilon=epsilon, order=order), delta)


def brink(ops: Ops, b_hat: Vec3, *, bound: Real, epsilon: Real, order: int) -> Brink | None:
    """η1, and 2 (ε² + 2εB)^(n+1) B²; None for one vehicle within B, as nearly always: nothing is held back then."""
    bx, by, bz = b_hat
    outside = ops.clamp(bx * bx + by * by + bz * bz - bound * bound, 0.0, math.inf)
    if ops is FLOATS and outside == 0.0:
        return None
    scale = 2.0 * (epsilon * epsilon + 2.0 * epsilon * bound) ** (order + 1) * bound * bound
    return Brink(outside ** (order + 1), scale)


def held_back(ops: Ops, xi: Vec3, b_hat: Vec3, edge: Brink | None, delta: Real) -> Vec3:
    """Proj(ξ, b̂) at that ``edge``."""
    if edge is None:
        return xi
    (x, y, z), (bx, by, bz) = xi, b_hat
    inner = bx * x + by * y + bz * z
    k = edge.eta1 * (inner + ops.sqrt(inner * inner + delta * delta)) / edge.scale
    return (x - k * bx, y - k * by, z - k * bz)


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
