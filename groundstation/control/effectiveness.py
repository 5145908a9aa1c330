"""Thrust effectiveness, told apart from the wind: a second stage beside the observer's filter.

The observer's chain (:mod:`groundstation.control.observer`) is driven by the model's acceleration, in which thrust
counts λ times what the vehicle was told to have: -λ (T/m) R e3 + g e3 + d. λ is a constant, or nearly (batteries sag).
What an error of λ̂ does to the chain is linear and known, so it needs no state in the filter: the filter's error is
x̃ + V (λ - λ̂), where x̃ is its error if λ were known and V follows the filter's own recursion. So λ is estimated from
the innovations that V explains (B. Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969).

Weak thrust and wind look the same while thrust stays as it is: V then settles where it explains no innovation, and λ̂
rests. Every change of thrust or tilt tells them apart. Elementwise: floats, or arrays of shape (N,).
"""

from typing import NamedTuple, TypeAlias

from groundstation.control.model import Motion, new
from groundstation.control.observer import Gain
from groundstation.ops import Ops, Real, Vec3

LIMITS = (0.6, 1.4)
"""λ̂ stays within these [-]: beyond them something is broken, not worn."""


Chain: TypeAlias = tuple[Real, Real, Real, Real]
"""One axis of the observer: position [m], velocity [m/s], disturbance [m/s²] and its rate [m/s³]."""


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
    still = (0.0, 0.0, 0.0, 0.0)
    return Effectiveness(1.0, deviation * deviation, still, still, still)


def later(e: Effectiveness, h: Real, push: tuple[Vec3, Vec3], walk: float) -> Effectiveness:
    """``e`` after ``h`` [s] in which thrust gave ``push`` (see :func:`pushed`) and λ wandered ``walk`` [1/√s]."""
    (px, py, pz), (vx, vy, vz) = push
    value, variance, (xp, xv, xd, xc), (yp, yv, yd, yc), (zp, zv, zd, zc) = e
    # The chain's exact transition, and what thrust adds to it; written out, as it runs once a pose.
    x, y, z = h * xc, h * yc, h * zc
    half = 0.5 * h
    after = (
        value,
        variance + walk * walk * h,
        (xp + h * (xv + half * (xd + x / 3.0)) + px, xv + h * (xd + 0.5 * x) + vx, xd + x, xc),
        (yp + h * (yv + half * (yd + y / 3.0)) + py, yv + h * (yd + 0.5 * y) + vy, yd + y, yc),
        (zp + h * (zv + half * (zd + z / 3.0)) + pz, zv + h * (zd + 0.5 * z) + vz, zd + z, zc),
    )
    return new(Effectiveness, after)


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


def seen(ops: Ops, e: Effectiveness, step: Vec3, gain: Gain, variance: Real, of: int = 0) -> tuple[Effectiveness, Real]:
    """``e`` after an innovation, and by how much λ̂ moved: the observer moves along, see :func:`along`.

    Args:
        ops: elementary functions.
        e: at the instant of the measurement.
        step: innovation of position [m] (``of`` = 0) or of velocity [m/s] (``of`` = 1), NED.
        gain: what the observer makes of it.
        variance: of the innovation, as the observer's filter has it [m² or m²/s²].
        of: which of the chain was measured.
    """
    value, p, x, y, z = e
    # One axis after the other, written out: this runs once a pose.
    (north, east, down), a, b, c = step, x[of], y[of], z[of]
    k = p * a / (variance + a * a * p)
    moved: Real = k * north
    p = p - k * a * p
    k = p * b / (variance + b * b * p)
    moved = moved + k * (east - b * moved)
    p = p - k * b * p
    k = p * c / (variance + c * c * p)
    moved = moved + k * (down - c * moved)
    p = p - k * c * p
    now = ops.clamp(value + moved, *LIMITS)
    kp, kv, kd, kc = gain
    (xp, xv, xd, xc), (yp, yv, yd, yc), (zp, zv, zd, zc) = x, y, z
    after = (
        now,
        p,
        (xp - kp * a, xv - kv * a, xd - kd * a, xc - kc * a),
        (yp - kp * b, yv - kv * b, yd - kd * b, yc - kc * b),
        (zp - kp * c, zv - kv * c, zd - kd * c, zc - kc * c),
    )
    return new(Effectiveness, after), now - value


def along(value: Vec3, e: Effectiveness, moved: Real, of: int) -> Vec3:
    """``value`` of the observer (number ``of`` of the chain, NED) after λ̂ has ``moved``."""
    return value[0] + moved * e.x[of], value[1] + moved * e.y[of], value[2] + moved * e.z[of]
