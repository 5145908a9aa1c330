"""Observer: a Kalman filter of a chain of integrators, and the thrust effectiveness told apart from the wind.

How far one pose moves position, velocity, disturbance and its rate: the model's acceleration drives the chain, so the
filter only has to follow what the model does not know:

    p˙ = v + n_p,   v˙ = a_model + d + n_a,   d˙ = c + n_d,   c˙ = n_c,   measured p + noise of variance r

The three axes share one covariance, as the noise is taken as isotropic. n_p, n_a, n_d, n_c are white. n_p is zero
but for a source that measures velocity too, an autopilot: its position wanders against its velocity (GPS), and must
then not be taken for motion. The gain follows the interval between poses, so a gap needs no special case,
and it follows r, which is measured (see :func:`fourth_difference`).

Stamps that are off by chance, by s, are noise along the velocity: R = r I + s² v vᵀ. Then there are two covariances,
along the motion and across it. Where the motion turns, both are projected onto the new direction, and what correlates
along with across is left out.

Effectiveness is a second stage beside that filter. The chain is driven by the model's acceleration, in which thrust
counts λ times what the vehicle was told to have: -λ (T/m) R e3 + g e3 + d. λ is a constant, or nearly (batteries sag).
What an error of λ̂ does to the chain is linear and known, so it needs no state in the filter: the filter's error is
x̃ + V (λ - λ̂), where x̃ is its error if λ were known and V follows the filter's own recursion. So λ is estimated from
the innovations that V explains (B. Friedland, "Treatment of bias in recursive filtering", IEEE TAC 14, 1969).

Weak thrust and wind look the same while thrust stays as it is: V then settles where it explains no innovation, and λ̂
rests. Every change of thrust or tilt tells them apart. Elementwise: floats, or arrays of shape (N,).
"""

import math
from typing import NamedTuple

from groundstation.core.geometry import FLOATS, Ops, Quat, Real, Vec3, conjugate, multiply, rotate, rotation_vector
from groundstation.core.vehicle import ZERO, ActuatorResponse, new


class Covariance(NamedTuple):
    """The upper triangle of the covariance of (p, v, d, c), in SI units."""

    pp: Real
    pv: Real
    pd: Real
    pc: Real
    vv: Real
    vd: Real
    vc: Real
    dd: Real
    dc: Real
    cc: Real


class Densities(NamedTuple):
    """White-noise densities that drive position [m²/s], velocity [m²/s³], disturbance [m²/s⁵], its rate [m²/s⁷]."""

    position: float
    acceleration: float
    disturbance: float
    disturbance_rate: float


class KalmanGain(NamedTuple):
    """What one metre of innovation changes: position [-], velocity [1/s], disturbance [1/s²], its rate [1/s³]."""

    p: Real
    v: Real
    d: Real
    c: Real


def initial_covariance(noise: Real) -> Covariance:
    """The covariance at the first pose: it is at rest to 1 m/s, the disturbance is known to 1 m/s² and constant."""
    return Covariance(noise, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.01)


def predict_covariance(s: Covariance, h: Real, q: Densities) -> Covariance:
    """``s`` after ``h`` [s] without a pose: F S Fᵀ + Q, F the chain's exact transition.

    Q is diagonal, q h: what it leaves out is of second order in h and grows back through F at the next step.
    """
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    a, b = 0.5 * h * h, h * h * h / 6.0
    p_v = pv + h * vv + a * vd + b * vc
    p_d = pd + h * vd + a * dd + b * dc
    p_c = pc + h * vc + a * dc + b * cc
    v_d = vd + h * dd + a * dc
    v_c = vc + h * dc + a * cc
    d_c = dc + h * cc
    after = (
        pp + h * pv + a * pd + b * pc + h * p_v + a * p_d + b * p_c + q.position * h,
        p_v + h * p_d + a * p_c,
        p_d + h * p_c,
        p_c,
        vv + h * vd + a * vc + h * v_d + a * v_c + q.acceleration * h,
        v_d + h * v_c,
        v_c,
        dd + h * dc + h * d_c + q.disturbance * h,
        d_c,
        cc + q.disturbance_rate * h,
    )
    return new(Covariance, after)


UNEXPECTED, WIDEST = 4.0, 20.0
"""An innovation of more than so many times its expected square widens the covariance, by up to so much [-]."""


def widen_covariance(ops: Ops, s: Covariance, r: Real, step: Vec3) -> Covariance:
    """``s`` as it must have been for the innovation ``step`` [m] to be no surprise, with position noise ``r`` [m²].

    A front of wind is a jump that the chain's noise does not have. Σ then grows as a whole, so that what the chain
    does in its next poses is believed sooner; larger than FΣFᵀ it may be at any time (docs/explanation/law.md, 5.5).
    """
    x, y, z = step
    share = (x * x + y * y + z * z) / (3.0 * UNEXPECTED * (s.pp + r))
    if ops is FLOATS and share <= 1.0:
        return s
    k = ops.clamp(share, 1.0, WIDEST)
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    return new(Covariance, (k * pp, k * pv, k * pd, k * pc, k * vv, k * vd, k * vc, k * dd, k * dc, k * cc))


def update_covariance(s: Covariance, r: Real) -> tuple[KalmanGain, Covariance]:
    """The gain for a pose of position noise ``r`` [m²], and the covariance after it."""
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    w = 1.0 / (pp + r)
    kp, kv, kd, kc = pp * w, pv * w, pd * w, pc * w
    after = (
        pp - kp * pp,
        pv - kp * pv,
        pd - kp * pd,
        pc - kp * pc,
        vv - kv * pv,
        vd - kv * pd,
        vc - kv * pc,
        dd - kd * pd,
        dc - kd * pc,
        cc - kc * pc,
    )
    return new(KalmanGain, (kp, kv, kd, kc)), new(Covariance, after)


def update_moving_covariance(s: Covariance, r: Real) -> tuple[KalmanGain, Covariance]:
    """As :func:`update_covariance`, for a velocity of noise ``r`` [m²/s²]: what one m/s of innovation changes."""
    pp, pv, pd, pc, vv, vd, vc, dd, dc, cc = s
    w = 1.0 / (vv + r)
    kp, kv, kd, kc = pv * w, vv * w, vd * w, vc * w
    after = (
        pp - kp * pv,
        pv - kp * vv,
        pd - kp * vd,
        pc - kp * vc,
        vv - kv * vv,
        vd - kv * vd,
        vc - kv * vc,
        dd - kd * vd,
        dc - kd * vc,
        cc - kc * vc,
    )
    return new(KalmanGain, (kp, kv, kd, kc)), new(Covariance, after)


def fourth_difference(a: Vec3, b: Vec3, c: Vec3, d: Vec3, e: Vec3) -> tuple[Real, Real, Real]:
    """The noise that five positions at equal intervals show, motion all but cancelled.

    The fourth difference of independent noise has 1 + 16 + 36 + 16 + 1 = 70 times its variance; of a smooth motion
    it leaves snap · h⁴ (0.02 mm for 100 m/s⁴ at 50 Hz).

    Returns:
        The variance per axis [m²]; that along the way from the first to the last [m²]; that way squared [m²].
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz), (ex, ey, ez) = a, b, c, d, e
    x = ax - 4.0 * bx + 6.0 * cx - 4.0 * dx + ex
    y = ay - 4.0 * by + 6.0 * cy - 4.0 * dy + ey
    z = az - 4.0 * bz + 6.0 * cz - 4.0 * dz + ez
    u, v, w = ex - ax, ey - ay, ez - az
    way2 = u * u + v * v + w * w
    along = u * x + v * y + w * z
    return (x * x + y * y + z * z) / 210.0, along * along / (70.0 * way2 + NO_WAY_M2), way2


NO_WAY_M2 = 1e-20
"""Keeps a quotient by a way that may be nought finite [m²]."""


class StampNoise(NamedTuple):
    """What fourth differences show along the motion, averaged as the noise of all axes is. Elementwise."""

    along: Real
    """Variance along the motion [m²]."""
    speed2: Real
    """Speed squared [m²/s²]."""


JITTER_SHOWS = 2.0
"""Stamps are off where noise along the motion has so many times the variance of that across it: by chance, with memory
of 100 poses, it has 1.2 times (1σ)."""


def split_noise(ops: Ops, noise: Real, seen: StampNoise, least: float, told_s: float | None) -> tuple[Real, Real]:
    """Noise across the motion, per axis [m²], and how far stamps are off, squared [s²].

    Args:
        ops: elementary functions.
        noise: mean of the three axes [m²].
        seen: along the motion.
        least: the first result is never less [m²].
        told_s: how far stamps are off [s]; None for what is seen, which is nought where it does not show.
    """
    if told_s == 0.0:
        return noise, 0.0
    across = ops.clamp(1.5 * noise - 0.5 * seen.along, least, math.inf)
    if told_s is not None:
        return across, told_s * told_s + 0.0 * across
    shows = seen.along > JITTER_SHOWS * across
    return ops.where(shows, across, noise), ops.where(shows, (seen.along - across) / (seen.speed2 + NO_WAY_M2), 0.0)


class AlongTrack(NamedTuple):
    """The filter along the motion, where stamps are off: its own covariance, in the direction that it had."""

    axis: Vec3
    """Unit vector, NED."""
    covariance: Covariance


class AlongGain(NamedTuple):
    """What an innovation changes along the motion beside what it changes in every direction."""

    axis: Vec3
    more: KalmanGain
    """To be added along it; below 0, as poses tell less there."""
    weight: Real
    """Deviation of the innovation across the motion over that along it, less 1 [-]."""


def find_direction(ops: Ops, velocity: Vec3) -> tuple[Vec3, Real]:
    """Unit vector along ``velocity`` [m/s], nought where that is, and the speed squared [m²/s²]."""
    x, y, z = velocity
    speed2 = x * x + y * y + z * z
    k = 1.0 / ops.sqrt(speed2 + NO_WAY_M2)
    return (k * x, k * y, k * z), speed2


def turn_track(across: Covariance, track: AlongTrack, axis: Vec3) -> tuple[Covariance, Covariance]:
    """Covariances across and along the motion, which now goes along ``axis``: the mean over all directions across.

    Both stay exactly as they are where they are the same.
    """
    a, b, c = track.axis
    x, y, z = axis
    cosine = a * x + b * y + c * z
    kept = cosine * cosine
    lost = 0.5 * (1.0 - kept)
    pairs = list(zip(across, track.covariance, strict=True))
    return (
        new(Covariance, [s + lost * (t - s) for s, t in pairs]),
        new(Covariance, [s + kept * (t - s) for s, t in pairs]),
    )


def weigh_along(ops: Ops, axis: Vec3, gain: KalmanGain, along: KalmanGain, across2: Real, along2: Real) -> AlongGain:
    """Beside ``gain`` in every direction, that ``along`` the motion; the innovation has the variances given."""
    kp, kv, kd, kc = gain
    p, v, d, c = along
    return AlongGain(axis, new(KalmanGain, (p - kp, v - kv, d - kd, c - kc)), ops.sqrt(across2 / along2) - 1.0)


def part_along(axis: Vec3, of: Vec3) -> Vec3:
    """The part of a vector along the unit vector ``axis``."""
    (x, y, z), (a, b, c) = axis, of
    k = x * a + y * b + z * c
    return (k * x, k * y, k * z)


def innovation(measured: Vec3, predicted: Vec3) -> Vec3:
    """i = measured - predicted [m]."""
    return (measured[0] - predicted[0], measured[1] - predicted[1], measured[2] - predicted[2])


def correct(value: Vec3, gain: Real, step: Vec3) -> Vec3:
    """``value`` moved by ``gain`` times ``step``."""
    return (value[0] + gain * step[0], value[1] + gain * step[1], value[2] + gain * step[2])


def correct_by_both(value: Vec3, gain: Real, step: Vec3, more: Real, along: Vec3) -> Vec3:
    """``value`` moved by ``gain`` times ``step`` and by ``more`` times ``along``."""
    return (
        value[0] + gain * step[0] + more * along[0],
        value[1] + gain * step[1] + more * along[1],
        value[2] + gain * step[2] + more * along[2],
    )


def correct_attitude(ops: Ops, predicted: Quat, measured: Quat, gain: float) -> Quat:
    """The predicted attitude turned by ``gain`` (0..1) of the way to the measured one; 1 takes the measurement."""
    if gain >= 1.0:
        return measured
    x, y, z = rotation_vector(multiply(conjugate(predicted), measured), ops)
    return rotate(predicted, (gain * x, gain * y, gain * z))


EFFECTIVENESS_LIMITS = (0.6, 1.4)
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


def predict_effectiveness(
    e: Effectiveness, h: Real, given: ActuatorResponse, mass: float, walk: float
) -> Effectiveness:
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
    ops: Ops,
    e: Effectiveness,
    step: Vec3,
    gain: KalmanGain,
    variance: Real,
    of: int = 0,
    along: AlongGain | None = None,
) -> tuple[Effectiveness, Real]:
    """``e`` after an innovation, and by how much λ̂ moved: the observer moves along by that times V.

    Args:
        ops: elementary functions.
        e: at the instant of the measurement.
        step: innovation of position [m] (``of`` = 0) or of velocity [m/s] (``of`` = 1), NED.
        gain: what the observer makes of it.
        variance: of the innovation, as the observer's filter has it [m² or m²/s²].
        of: which of the chain was measured.
        along: where it has another variance along the motion.
    """
    value, w, p, v, d, c = e
    shown = seen = v if of else p
    if along is not None:  # as if it had the same in every direction
        step = correct(step, along.weight, part_along(along.axis, step))
        seen = correct(seen, along.weight, part_along(along.axis, seen))
    # One axis after the other, written out: this runs once a pose.
    (north, east, down), (x, y, z) = step, seen
    k = w * x / (variance + x * x * w)
    moved: Real = k * north
    w = w - k * x * w
    k = w * y / (variance + y * y * w)
    moved = moved + k * (east - y * moved)
    w = w - k * y * w
    k = w * z / (variance + z * z * w)
    moved = moved + k * (down - z * moved)
    w = w - k * z * w
    now = ops.clamp(value + moved, *EFFECTIVENESS_LIMITS)
    kp, kv, kd, kc = gain
    x, y, z = shown
    after = (
        now,
        w,
        (p[0] - kp * x, p[1] - kp * y, p[2] - kp * z),
        (v[0] - kv * x, v[1] - kv * y, v[2] - kv * z),
        (d[0] - kd * x, d[1] - kd * y, d[2] - kd * z),
        (c[0] - kc * x, c[1] - kc * y, c[2] - kc * z),
    )
    if along is not None:
        (kp, kv, kd, kc), part = along.more, part_along(along.axis, shown)
        _, _, p, v, d, c = after
        after = (now, w, correct(p, -kp, part), correct(v, -kv, part), correct(d, -kd, part), correct(c, -kc, part))
    return new(Effectiveness, after), now - value
