"""Vectors of three components, floats or arrays of vehicles. Sans-IO."""

from typing import TypeVar

from groundstation.core.geometry.so3 import Real, Vec3

_Tuple = TypeVar("_Tuple", bound=tuple[float, ...])


def add(a: Vec3, b: Vec3) -> Vec3:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(k: Real, a: Vec3) -> Vec3:
    """Return k a."""
    return (k * a[0], k * a[1], k * a[2])


def add_scaled(a: Vec3, k: Real, b: Vec3) -> Vec3:
    """Return a + k b."""
    return (a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2])


def multiply_each(a: Vec3, b: Vec3) -> Vec3:
    """Return the products of the components, such as a gain for each axis times its error."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return a x b."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def interpolate(start: _Tuple, end: _Tuple, share: float) -> _Tuple:
    """Return the point at ``share`` of the way from ``start`` to ``end``, of any number of
    components.

    One step of a mean: ``start`` is its value, ``end`` the new sample, ``share`` the weight of
    that.
    """
    return tuple(x + share * (y - x) for x, y in zip(start, end, strict=True))  # type: ignore[return-value]
