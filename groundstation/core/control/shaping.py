"""The shaping functions of the law, per axis: σ, ρ, Ω and φ with exact derivatives.

σ and ρ are of one family: odd, smooth, bound ``bound`` and slope ``slope`` at 0. The paper prints
M r s/√(1+r²s²), whose slope is M·r; bound M and slope r need the form below.
Elementwise: floats, or arrays of shape (N,).
"""

import math

from groundstation.core.geometry import FLOATS, Ops, Real


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
