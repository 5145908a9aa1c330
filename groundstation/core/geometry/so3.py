"""Rotations as unit quaternions, elementwise in floats or arrays (see ops.py).

A quaternion (w, x, y, z) turns body vectors into world vectors: v_world = R(q) v_body.
"""

import math

from groundstation.core.geometry.ops import FLOATS, Ops, Quat, Real, Vec3

IDENTITY: Quat = (1.0, 0.0, 0.0, 0.0)


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
    """``q`` turned by the rotation vector ``angle`` [rad] given in the body frame: R(q) exp(S(angle)).

    Without trigonometry or roots: exp by its Taylor polynomial to order 6, and one Newton step towards unit
    length, 1/√n ≈ (3 - n)/2, which also takes out what rounding has left in ``q``. The error is below 1e-9 rad for
    |angle| < 0.3 rad; longer turns must be split by the caller. Written out, as everything here runs through it.
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


def rotation_vector(q: Quat, ops: Ops = FLOATS) -> Vec3:
    """The rotation vector [rad] of ``q``, of length <= pi: the inverse of ``exp``."""
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


def angle_deg(cosine: float) -> float:
    """The angle [deg] of a cosine, which rounding may have left beyond ±1; not a number counts as 180°, never as 0°."""
    return math.degrees(math.acos(min(1.0, max(-1.0, cosine))))  # nan beats no first argument


def to_world(q: Quat, v: Vec3) -> Vec3:
    """R v: a body vector in world components."""
    w, x, y, z = q
    a, b, c = v
    # t = 2 q_v x v;  R v = v + w t + q_v x t
    tx = 2.0 * (y * c - z * b)
    ty = 2.0 * (z * a - x * c)
    tz = 2.0 * (x * b - y * a)
    return (a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx)


def to_body(q: Quat, v: Vec3) -> Vec3:
    """Rᵀ v: a world vector in body components."""
    w, x, y, z = q
    a, b, c = v
    # to_world() of the conjugate.
    tx = 2.0 * (z * b - y * c)
    ty = 2.0 * (x * c - z * a)
    tz = 2.0 * (y * a - x * b)
    return (a + w * tx - y * tz + z * ty, b + w * ty - z * tx + x * tz, c + w * tz - x * ty + y * tx)


def matrix(q: Quat) -> tuple[Vec3, Vec3, Vec3]:
    """R as its three rows."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def from_matrix(rows: tuple[Vec3, Vec3, Vec3], ops: Ops = FLOATS) -> Quat:
    """The quaternion of a rotation matrix given as its rows (floats only; w >= 0)."""
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
    w, x, y, z = normalize(q, ops)
    return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)


def euler_zyx(q: Quat, ops: Ops = FLOATS) -> Vec3:
    """Roll, pitch, yaw [rad] (yaw first, intrinsic z-y-x) of a body-to-world quaternion."""
    w, x, y, z = q
    roll = ops.atan2(2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    sine = ops.clamp(2.0 * (w * y - x * z), -1.0, 1.0)
    pitch = ops.atan2(sine, ops.sqrt(1.0 - sine * sine))
    yaw = ops.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return (roll, pitch, yaw)


def from_euler_zyx(roll: Real, pitch: Real, yaw: Real, ops: Ops = FLOATS) -> Quat:
    """The body-to-world quaternion of roll, pitch, yaw [rad]."""
    cr, sr = ops.cos(0.5 * roll), ops.sin(0.5 * roll)
    cp, sp = ops.cos(0.5 * pitch), ops.sin(0.5 * pitch)
    cy, sy = ops.cos(0.5 * yaw), ops.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )
