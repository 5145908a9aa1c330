"""Thrust effectiveness, told apart from the wind: a second stage beside the observer's filter.

The observer's chain (:mod:`groundstation.control.observer`) is driven by the model's acceleration, in which thrust
counts λ times what the vehicle was told to have: -λ (T/m) R e3 + g e3 + d. λ is a constant, or nearly (batteries sag).
What an error of λ̂ does to the chain is linear and known, so it needs no state in the filter: the filter's error is
x̃ + V (λ - λ̂), where x̃ is its error if λ were known and V follows the filter's own recursion. So λ is estimated from
the innovations that V explains (B. Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969).

Weak thrust and wind look the same while thrust stays as it is: V then settles where it explains no innovation, and λ̂
rests. Every change of thrust or tilt tells them apart. Elementwise: floats, or arrays of shape (N,).
"""

from typing import NamedTuple

from groundstation.control.model import Motion
from groundstation.control.observer import Gain
from groundstation.ops import Ops, Real, Vec3

LIMITS = (0.6, 1.4)
"""λ̂ stays within these [-]: beyond them something is broken, not worn."""


class Chain(NamedTuple):
    """One axis of the observer: position [m], velocity [m/s], disturbance [m/s²] and its rate [m/s³]."""

    p: Real
    v: Real
    d: Real
    c: Real


class Effectiveness(NamedTuple):
    """λ̂, how well it is known, and how each axis of the observer answers to it."""

    value: Real
    """λ̂: true thrust over told thrust [-]."""
    variance: Real
    """Of λ̂ [-]."""
    x: Chain
    """V on the north axis, per unit of λ; then east and down."""
    y: Chain
    z: Chain


def told(deviation: float) -> Effectiveness:
    """Before the flight: λ̂ = 1, known to ``deviation`` (1σ)."""
    still = Chain(0.0, 0.0, 0.0, 0.0)
    return Effectiveness(1.0, deviation * deviation, still, still, still)


def later(e: Effectiveness, h: Real, push: tuple[Vec3, Vec3], walk: float) -> Effectiveness:
    """``e`` after ``h`` [s] in which thrust gave ``push`` (see :func:`pushed`) and λ wandered ``walk`` [1/√s]."""
    (px, py, pz), (vx, vy, vz) = push
    return Effectiveness(
        e.value,
        e.variance + walk * walk * h,
        _later(e.x, h, px, vx),
        _later(e.y, h, py, vy),
        _later(e.z, h, pz, vz),
    )


def _later(s: Chain, h: Real, way: Real, speed: Real) -> Chain:
    """The chain's exact transition, and what thrust adds to it."""
    return Chain(
        s.p + h * (s.v + 0.5 * h * (s.d + h * s.c / 3.0)) + way,
        s.v + h * (s.d + 0.5 * h * s.c) + speed,
        s.d + h * s.c,
        s.c,
    )


def pushed(e: Effectiveness, before: Motion, after: Motion, h: Real, other: Vec3) -> tuple[Vec3, Vec3]:
    """What a unit of λ added to position [m] and velocity [m/s] when the model rolled for ``h`` [s].

    ``other`` is all other acceleration in it: gravity and disturbance [m/s², NED].
    """
    k = 1.0 / e.value
    (px, py, pz), (vx, vy, vz) = before.position, before.velocity
    (qx, qy, qz), (wx, wy, wz) = after.position, after.velocity
    ax, ay, az = h * other[0], h * other[1], h * other[2]
    a = 0.5 * h
    return (
        (k * (qx - px - h * vx - a * ax), k * (qy - py - h * vy - a * ay), k * (qz - pz - h * vz - a * az)),
        (k * (wx - vx - ax), k * (wy - vy - ay), k * (wz - vz - az)),
    )


def seen(
    ops: Ops, e: Effectiveness, step: Vec3, gain: Gain, variance: Real, of: int = 0
) -> tuple[Effectiveness, tuple[Chain, Chain, Chain]]:
    """``e`` after an innovation, and what the three axes of the observer change by as λ̂ moves.

    Args:
        ops: elementary functions.
        e: at the instant of the measurement.
        step: innovation of position [m] (``of`` = 0) or of velocity [m/s] (``of`` = 1), NED.
        gain: what the observer makes of it.
        variance: of the innovation, as the observer's filter has it [m² or m²/s²].
        of: which of the chain was measured.
    """
    value, p = e.value, e.variance
    moved: Real = 0.0
    for chain, r in zip((e.x, e.y, e.z), step, strict=True):
        s = chain[of]
        k = p * s / (variance + s * s * p)
        moved = moved + k * (r - s * moved)
        p = p - k * s * p
    new = ops.clamp(value + moved, *LIMITS)
    moved = new - value
    x, y, z = _seen(e.x, gain, of), _seen(e.y, gain, of), _seen(e.z, gain, of)
    return Effectiveness(new, p, x, y, z), (_times(x, moved), _times(y, moved), _times(z, moved))


def _seen(s: Chain, k: Gain, of: int) -> Chain:
    m = s[of]
    return Chain(s.p - k.p * m, s.v - k.v * m, s.d - k.d * m, s.c - k.c * m)


def _times(s: Chain, k: Real) -> Chain:
    return Chain(k * s.p, k * s.v, k * s.d, k * s.c)
