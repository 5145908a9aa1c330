"""Thrust effectiveness, told apart from the wind: a second stage beside the observer's filter.

The observer's chain (observer.py) is driven by the model's acceleration, in which thrust
counts λ times what the vehicle was told to have: -λ (T/m) R e3 + g e3 + d. λ is a constant, or nearly (batteries sag).
What an error of λ̂ does to the chain is linear and known, so it needs no state in the filter: the filter's error is
x̃ + V (λ - λ̂), where x̃ is its error if λ were known and V follows the filter's own recursion. So λ is estimated from
the innovations that V explains (B. Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969).

Weak thrust and wind look the same while thrust stays as it is: V then settles where it explains no innovation, and λ̂
rests. Every change of thrust or tilt tells them apart. Elementwise: floats, or arrays of shape (N,).
"""

from typing import NamedTuple

from groundstation.core.estimation.observer import Gain
from groundstation.core.geometry import Ops, Real, Vec3
from groundstation.core.vehicle import ZERO, Driven, new

LIMITS = (0.6, 1.4)
"""λ̂ stays within these [-]: beyond them something is broken, not worn."""


class Effectiveness(NamedTuple):
    """λ̂, how well it is known, and V: how the observer answers to it, NED per unit of λ."""

    value: Real
    """λ̂: true thrust over told thrust [-]."""
    variance: Real
    """Of λ̂ [-]."""
    p: Vec3
    """V's position [m]."""
    v: Vec3
    """V's velocity [m/s]."""
    d: Vec3
    """V's disturbance [m/s²]."""
    c: Vec3
    """V's rate of disturbance [m/s³]."""


def initial_effectiveness(deviation: float) -> Effectiveness:
    """Before the flight: λ̂ = 1, known to ``deviation`` (1σ)."""
    return Effectiveness(1.0, deviation * deviation, ZERO, ZERO, ZERO, ZERO)


def predict_effectiveness(e: Effectiveness, h: Real, given: Driven, mass: float, walk: float) -> Effectiveness:
    """``e`` after ``h`` [s] in which commands did what ``given`` says.

    The chain's exact transition, and what a unit of λ gives to a vehicle told to have ``mass`` [kg]; meanwhile λ
    wanders ``walk`` [1/√s].
    """
    value, variance, (px, py, pz), (vx, vy, vz), (dx, dy, dz), c = e
    _, _, _, (ix, iy, iz), (sx, sy, sz) = given
    k = -1.0 / mass
    x, y, z = h * c[0], h * c[1], h * c[2]
    half, third = 0.5 * h, 1.0 / 3.0
    after = (
        value,
        variance + walk * walk * h,
        (
            px + h * (vx + half * (dx + third * x)) + k * sx,
            py + h * (vy + half * (dy + third * y)) + k * sy,
            pz + h * (vz + half * (dz + third * z)) + k * sz,
        ),
        (
            vx + h * (dx + 0.5 * x) + k * ix,
            vy + h * (dy + 0.5 * y) + k * iy,
            vz + h * (dz + 0.5 * z) + k * iz,
        ),
        (dx + x, dy + y, dz + z),
        c,
    )
    return new(Effectiveness, after)


def update_effectiveness(
    ops: Ops, e: Effectiveness, step: Vec3, gain: Gain, variance: Real, of: int = 0
) -> tuple[Effectiveness, Real]:
    """``e`` after an innovation, and by how much λ̂ moved: the observer moves along by that times V.

    Args:
        ops: elementary functions.
        e: at the instant of the measurement.
        step: innovation of position [m] (``of`` = 0) or of velocity [m/s] (``of`` = 1), NED.
        gain: what the observer makes of it.
        variance: of the innovation, as the observer's filter has it [m² or m²/s²].
        of: which of the chain was measured.
    """
    value, w, p, v, d, c = e
    # One axis after the other, written out: this runs once a pose.
    (north, east, down), (x, y, z) = step, v if of else p
    k = w * x / (variance + x * x * w)
    moved: Real = k * north
    w = w - k * x * w
    k = w * y / (variance + y * y * w)
    moved = moved + k * (east - y * moved)
    w = w - k * y * w
    k = w * z / (variance + z * z * w)
    moved = moved + k * (down - z * moved)
    w = w - k * z * w
    now = ops.clamp(value + moved, *LIMITS)
    kp, kv, kd, kc = gain
    after = (
        now,
        w,
        (p[0] - kp * x, p[1] - kp * y, p[2] - kp * z),
        (v[0] - kv * x, v[1] - kv * y, v[2] - kv * z),
        (d[0] - kd * x, d[1] - kd * y, d[2] - kd * z),
        (c[0] - kc * x, c[1] - kc * y, c[2] - kc * z),
    )
    return new(Effectiveness, after), now - value
