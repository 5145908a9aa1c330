"""A Kalman filter of a chain of integrators: how far one pose moves position, velocity, disturbance and its rate.

The model's acceleration drives the chain, so the filter only has to follow what the model does not know:

    p˙ = v + n_p,   v˙ = a_model + d + n_a,   d˙ = c + n_d,   c˙ = n_c,   measured p + noise of variance r

The three axes share one covariance, as the noise is taken as isotropic. n_p, n_a, n_d, n_c are white. n_p is zero
but for a source that measures velocity too, an autopilot: its position wanders against its velocity (GPS), and must
then not be taken for motion. The gain follows the interval between poses, so a gap needs no special case,
and it follows r, which is measured (see :func:`fourth_difference`). Elementwise: floats, or arrays of shape (N,).
"""

from typing import NamedTuple

from groundstation.ops import Ops, Quat, Real, Vec3
from groundstation.so3 import conjugate, multiply, rotation_vector, turned


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


class Gain(NamedTuple):
    """What one metre of innovation changes: position [-], velocity [1/s], disturbance [1/s²], its rate [1/s³]."""

    p: Real
    v: Real
    d: Real
    c: Real


def begun(noise: Real) -> Covariance:
    """The covariance at the first pose: it is at rest to 1 m/s, the disturbance is known to 1 m/s² and constant."""
    return Covariance(noise, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.01)


def later(s: Covariance, h: Real, q: Densities) -> Covariance:
    """``s`` after ``h`` [s] without a pose: F S Fᵀ + Q, F the chain's exact transition.

    Q is diagonal, q h: what it leaves out is of second order in h and grows back through F at the next step.
    """
    a, b = 0.5 * h * h, h * h * h / 6.0
    p_v = s.pv + h * s.vv + a * s.vd + b * s.vc
    p_d = s.pd + h * s.vd + a * s.dd + b * s.dc
    p_c = s.pc + h * s.vc + a * s.dc + b * s.cc
    v_d = s.vd + h * s.dd + a * s.dc
    v_c = s.vc + h * s.dc + a * s.cc
    d_c = s.dc + h * s.cc
    return Covariance(
        pp=s.pp + h * s.pv + a * s.pd + b * s.pc + h * p_v + a * p_d + b * p_c + q.position * h,
        pv=p_v + h * p_d + a * p_c,
        pd=p_d + h * p_c,
        pc=p_c,
        vv=s.vv + h * s.vd + a * s.vc + h * v_d + a * v_c + q.acceleration * h,
        vd=v_d + h * v_c,
        vc=v_c,
        dd=s.dd + h * s.dc + h * d_c + q.disturbance * h,
        dc=d_c,
        cc=s.cc + q.disturbance_rate * h,
    )


def seen(s: Covariance, r: Real) -> tuple[Gain, Covariance]:
    """The gain for a pose of position noise ``r`` [m²], and the covariance after it."""
    w = 1.0 / (s.pp + r)
    k = Gain(s.pp * w, s.pv * w, s.pd * w, s.pc * w)
    return k, Covariance(
        pp=s.pp - k.p * s.pp,
        pv=s.pv - k.p * s.pv,
        pd=s.pd - k.p * s.pd,
        pc=s.pc - k.p * s.pc,
        vv=s.vv - k.v * s.pv,
        vd=s.vd - k.v * s.pd,
        vc=s.vc - k.v * s.pc,
        dd=s.dd - k.d * s.pd,
        dc=s.dc - k.d * s.pc,
        cc=s.cc - k.c * s.pc,
    )


def seen_moving(s: Covariance, r: Real) -> tuple[Gain, Covariance]:
    """As :func:`seen`, for a velocity of noise ``r`` [m²/s²]: what one m/s of innovation changes."""
    w = 1.0 / (s.vv + r)
    k = Gain(s.pv * w, s.vv * w, s.vd * w, s.vc * w)
    return k, Covariance(
        pp=s.pp - k.p * s.pv,
        pv=s.pv - k.p * s.vv,
        pd=s.pd - k.p * s.vd,
        pc=s.pc - k.p * s.vc,
        vv=s.vv - k.v * s.vv,
        vd=s.vd - k.v * s.vd,
        vc=s.vc - k.v * s.vc,
        dd=s.dd - k.d * s.vd,
        dc=s.dc - k.d * s.vc,
        cc=s.cc - k.c * s.vc,
    )


def fourth_difference(a: Vec3, b: Vec3, c: Vec3, d: Vec3, e: Vec3) -> Real:
    """The variance of position noise [m²] that five positions at equal intervals show, motion all but cancelled.

    The fourth difference of independent noise has 1 + 16 + 36 + 16 + 1 = 70 times its variance; of a smooth motion
    it leaves snap · h⁴ (0.02 mm for 100 m/s⁴ at 50 Hz).
    """
    total: Real = 0.0
    for i in range(3):
        x = a[i] - 4.0 * b[i] + 6.0 * c[i] - 4.0 * d[i] + e[i]
        total = total + x * x
    return total / 210.0


def innovation(measured: Vec3, predicted: Vec3) -> Vec3:
    """i = measured - predicted [m]."""
    return (measured[0] - predicted[0], measured[1] - predicted[1], measured[2] - predicted[2])


def corrected(value: Vec3, gain: Real, step: Vec3) -> Vec3:
    """``value`` moved by ``gain`` times ``step``."""
    return (value[0] + gain * step[0], value[1] + gain * step[1], value[2] + gain * step[2])


def corrected_attitude(ops: Ops, predicted: Quat, measured: Quat, gain: float) -> Quat:
    """The predicted attitude turned by ``gain`` (0..1) of the way to the measured one; 1 takes the measurement."""
    if gain >= 1.0:
        return measured
    x, y, z = rotation_vector(multiply(conjugate(predicted), measured), ops)
    return turned(predicted, (gain * x, gain * y, gain * z))
