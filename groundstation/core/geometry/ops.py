"""The elementary functions of the control code, once for floats and once for arrays of vehicles.

Control code is straight-line and elementwise: it uses + - * /, comparisons, and the functions here.
Called with ``FLOATS`` it flies one vehicle in plain floats (several times faster than small arrays);
called with ``ARRAYS`` the same source flies N vehicles, each number being an array of shape (N,).
Both sides of a ``where`` are evaluated, so both must be safe to compute.
"""

import math
from collections.abc import Callable
from typing import Any, TypeAlias

Real: TypeAlias = float
"""A float, or, under ``ARRAYS``, a numpy array of shape (N,) of float64."""

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

    __slots__ = ("asinh", "atan2", "clamp", "cos", "exp", "sin", "sqrt", "where")

    def __init__(
        self,
        *,
        sqrt: Callable[[Real], Real],
        exp: Callable[[Real], Real],
        sin: Callable[[Real], Real],
        cos: Callable[[Real], Real],
        asinh: Callable[[Real], Real],
        atan2: Callable[[Real, Real], Real],
        where: Callable[[Any, Real, Real], Real],
        clamp: Callable[[Real, Real, Real], Real],
    ) -> None:
        """Take the functions; ``clamp(x, low, high)`` and ``where(condition, yes, no)`` are elementwise."""
        self.sqrt = sqrt
        self.exp = exp
        self.sin = sin
        self.cos = cos
        self.asinh = asinh
        self.atan2 = atan2
        self.where = where
        self.clamp = clamp


FLOATS = Ops(
    sqrt=math.sqrt,
    exp=math.exp,
    sin=math.sin,
    cos=math.cos,
    asinh=math.asinh,
    atan2=math.atan2,
    where=_where,
    clamp=_clamp,
)


def arrays() -> Ops:
    """The same functions on numpy arrays (numpy is imported only here: one vehicle never needs it)."""
    import numpy as np

    where: Any = np.where
    return Ops(
        sqrt=np.sqrt,
        exp=np.exp,
        sin=np.sin,
        cos=np.cos,
        asinh=np.arcsinh,
        atan2=np.arctan2,
        where=where,
        clamp=lambda value, low, high: np.minimum(np.maximum(value, low), high),
    )
