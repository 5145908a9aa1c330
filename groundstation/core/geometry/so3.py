"""SO(3): rotations as unit quaternions, elementwise in floats or arrays.

A quaternion (w, x, y, z) turns body vectors into world vectors: v_world = R(q) v_body.

Control code is straight-line and elementwise: it uses + - * /, comparisons, and the functions of
:class:`Ops`. Called with ``FLOATS`` it flies one vehicle in plain floats (several times faster than
small arrays); called with ``arrays()`` the same source flies N vehicles, each number being an array
of shape (N,). Both sides of a ``where`` are evaluated, so both must be safe to compute.
"""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

from links.core import from_euler_zyx as from_euler_zyx  # noqa: PLC0414  # one of the rotations here

Real: TypeAlias = float
"""A float, or, under ``arrays()``, a numpy array of shape (N,) of float64."""

Vec3: TypeAlias = tuple[Real, Real, Real]
"""Three components along x, y, z of the frame that the name tells."""

Quat: TypeAlias = tuple[Real, Real, Real, Real]
"""Unit quaternion w, x, y, z; body (FRD) to world (NED) unless the name tells otherwise."""


def _where(condition: Any, yes: float, no: float) -> float:
    return yes if condition else no


def _clamp(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value


class Ops:
    """A set of elementary functions on one kind of number."""

    def __init__(
        self,
        *,
        sqrt: Callable[[Real], Real],
        exp: Callable[[Real], Real],
        sin: Callable[[Real], Real],
        cos: Callable[[Real], Real],
        asinh: Callable[[Real], Real],
        atan2: Callable[[Real, Real], Real],
        degrees: Callable[[Real], Real],
        where: Callable[[Any, Real, Real], Real],
        clamp: Callable[[Real, Real, Real], Real],
    ) -> None:
        """Take the functions.

        ``clamp(x, low, high)`` and ``where(condition, yes, no)`` are elementwise.
        """
        self.sqrt = sqrt
        self.exp = exp
        self.sin = sin
        self.cos = cos
        self.asinh = asinh
        self.atan2 = atan2
        self.degrees = degrees
        self.where = where
        self.clamp = clamp


FLOATS = Ops(
    sqrt=math.sqrt,
    exp=math.exp,
    sin=math.sin,
    cos=math.cos,
    asinh=math.asinh,
    atan2=math.atan2,
    degrees=math.degrees,
    where=_where,
    clamp=_clamp,
)


def arrays() -> Ops:
    """Return these functions on numpy arrays (imported only here: a flight needs none)."""
    import numpy as np

    where: Any = np.where
    return Ops(
        sqrt=np.sqrt,
        exp=np.exp,
        sin=np.sin,
        cos=np.cos,
        asinh=np.arcsinh,
        atan2=np.arctan2,
        degrees=np.degrees,
        where=where,
        clamp=lambda value, low, high: np.minimum(np.maximum(value, low), high),
    )


IDENTITY: Quat = (1.0, 0.0, 0.0, 0.0)
"""Quaternion of no rotation."""
ZERO: Vec3 = (0.0, 0.0, 0.0)
"""Vector of length 0."""


def multiply(a: Quat, b: Quat) -> Quat:
    """Hamilton product: R(multiply(a, b)) = R(a) R(b)."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def conjugate(q: Quat) -> Quat:
    """The inverse rotation of a unit quaternion."""
    w, x, y, z = q
    return (w, -x, -y, -z)


def normalize(q: Quat, ops: Ops = FLOATS) -> Quat:
    """The unit quaternion along ``q``, whose length must not be zero."""
    w, x, y, z = q
    n = 1.0 / ops.sqrt(w * w + x * x + y * y + z * z)
    return (w * n, x * n, y * n, z * n)


def rotate(q: Quat, angle: Vec3) -> Quat:
    """``q`` turned by the rotation vector ``angle`` [rad] given in the body frame: R(q)
    exp(S(angle)).

    Without trigonometry or roots: exp by its Taylor polynomial to order 6, and one Newton step
    towards unit length, 1/√n ≈ (3 - n)/2, which also takes out what rounding has left in ``q``. The
    error is below 1e-9 rad for |angle| < 0.3 rad; longer turns must be split by the caller. Written
    out, as everything here runs through it.
    """
    w, x, y, z = q
    a, b, c = angle
    s = 0.25 * (a * a + b * b + c * c)
    d = 1.0 - s * (0.5 - s * (1.0 / 24.0 - s * (1.0 / 720.0)))
    k = 0.5 - s * (1.0 / 12.0 - s * (1.0 / 240.0))
    a, b, c = k * a, k * b, k * c
    e = w * d - x * a - y * b - z * c
    f = w * a + x * d + y * c - z * b
    g = w * b - x * c + y * d + z * a
    h = w * c + x * b - y * a + z * d
    n = 1.5 - 0.5 * (e * e + f * f + g * g + h * h)
    return (n * e, n * f, n * g, n * h)


def turn_between(before: Quat, after: Quat, ops: Ops = FLOATS) -> Vec3:
    """Rotation vector [rad] that leads from one attitude to the other, in the body's axes."""
    return rotation_vector(multiply(conjugate(before), after), ops)


def rotation_vector(q: Quat, ops: Ops = FLOATS) -> Vec3:
    """The rotation vector [rad] of ``q``, of length <= pi."""
    w, x, y, z = q
    n = ops.sqrt(x * x + y * y + z * z)
    small = n < 1e-9
    sign = ops.where(w < 0.0, -1.0, 1.0)
    # For small angles angle/n -> 2/w; the quotient would be 0/0.
    scale = ops.where(small, 2.0, 2.0 * ops.atan2(n, abs(w)) / ops.where(small, 1.0, n)) * sign
    return (scale * x, scale * y, scale * z)


def third_column(q: Quat) -> Vec3:
    """R e3: where the body's z axis (down) points in the world."""
    w, x, y, z = q
    return (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))


def third_row(q: Quat) -> Vec3:
    """Rᵀ e3: where down, and so gravity, points in the body."""
    w, x, y, z = q
    return (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))


def angle_deg(cosine: float) -> float:
    """The angle [deg] of a cosine, which rounding may have left beyond ±1.

    Not a number counts as 180°, never as 0°.
    """
    return math.degrees(math.acos(min(1.0, max(-1.0, cosine))))  # max(-1.0, nan) is -1.0


def to_world(q: Quat, v: Vec3) -> Vec3:
    """R v: a body vector in world components."""
    w, x, y, z = q
    a, b, c = v
    # t = 2 q_v x v;  R v = v + w t + q_v x t
    tx = 2.0 * (y * c - z * b)
    ty = 2.0 * (z * a - x * c)
    tz = 2.0 * (x * b - y * a)
    return (
        a + w * tx + y * tz - z * ty,
        b + w * ty + z * tx - x * tz,
        c + w * tz + x * ty - y * tx,
    )


def to_body(q: Quat, v: Vec3) -> Vec3:
    """Rᵀ v: a world vector in body components."""
    w, x, y, z = q
    a, b, c = v
    # to_world() of the conjugate.
    tx = 2.0 * (z * b - y * c)
    ty = 2.0 * (x * c - z * a)
    tz = 2.0 * (y * a - x * b)
    return (
        a + w * tx - y * tz + z * ty,
        b + w * ty - z * tx + x * tz,
        c + w * tz - x * ty + y * tx,
    )


def matrix(q: Quat) -> tuple[Vec3, Vec3, Vec3]:
    """R as its three rows."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        third_row(q),
    )


def from_matrix(rows: tuple[Vec3, Vec3, Vec3]) -> Quat:
    """The quaternion of a rotation matrix given as its rows (w >= 0)."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    trace = a + e + i
    if trace > 0.0:
        q = (1.0 + trace, h - f, c - g, d - b)
    elif a >= e and a >= i:
        q = (h - f, 1.0 + a - e - i, b + d, c + g)
    elif e >= i:
        q = (c - g, b + d, 1.0 + e - a - i, f + h)
    else:
        q = (d - b, c + g, f + h, 1.0 + i - a - e)
    w, x, y, z = normalize(q)
    return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)


def euler_zyx(q: Quat, ops: Ops = FLOATS) -> Vec3:
    """Roll, pitch, yaw [rad] (yaw first, intrinsic z-y-x) of a body-to-world quaternion."""
    w, x, y, z = q
    roll = ops.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    sine = ops.clamp(2.0 * (w * y - x * z), -1.0, 1.0)
    pitch = ops.atan2(sine, ops.sqrt(1.0 - sine * sine))
    return (roll, pitch, heading(q, ops))


def heading(q: Quat, ops: Ops = FLOATS) -> Real:
    """Yaw [rad] of :func:`euler_zyx` alone."""
    w, x, y, z = q
    return ops.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
