"""Smoothest piecewise polynomials: through given points at given times, with the least integral of |p^(r)|².

r = 3 gives quintics (least jerk, C⁴ where only the points are given), r = 4 septics (least snap, C⁶). The unknowns are
the derivatives 1 to r-1 at the knots. A span of h seconds with those of both its ends in d has the polynomial
p(x h) = Σ cᵢ xⁱ, c = A⁻¹ S d, S = diag(h^k), and costs dᵀ S H S d h^(1-2r), H = A⁻ᵀ Q A⁻¹, Q = ∫₀¹ of the products of
the r-th derivatives of xⁱ. Setting the gradient to zero where a derivative is free is a block-tridiagonal system,
symmetric and positive definite, solved in one sweep forth and back: thousands of knots cost a moment. The condition at
a free k-th derivative is that p^(2r-1-k) does not jump: prescribing some derivatives costs smoothness there alone, and
at a free end the conditions are the natural ones.
Minimum snap: D. Mellinger, V. Kumar, ICRA 2011; in the derivatives at the knots: C. Richter, A. Bry, N. Roy, ISRR 2013.
"""

import math
from bisect import bisect_right
from typing import TYPE_CHECKING, NamedTuple

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.port import Reference

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

DEGREE = 7
"""Of all polynomials here; quintics end in two zeros."""


def smoothest(times_s: "Array", known: "Array", order: int) -> "Array":
    """Coefficients of the smoothest piecewise polynomial.

    Args:
        times_s: the knots (N,), rising [s]; N >= 2.
        known: derivatives 0 to ``order`` - 1 at each knot, for several axes: (N, order, axes); nan where free, which
            must be the same for all axes. The points themselves must be given.
        order: r of this file's heading, 3 or 4.

    Returns:
        (N - 1, DEGREE + 1, axes), ascending, by the share x in 0..1 of each span.
    """
    import numpy as np

    spans = np.diff(times_s)
    unit = float(np.mean(spans))  # in units of the mean span the numbers stay near 1
    powers = (spans / unit)[:, None] ** np.arange(order)
    scale = np.concatenate([powers, powers], axis=1)
    inverse = np.linalg.inv(ends(order))
    cost = inverse.T @ roughness(order) @ inverse
    blocks = scale[:, :, None] * cost * scale[:, None, :] * ((spans / unit) ** (1 - 2 * order))[:, None, None]
    own = np.zeros((len(times_s), order, order))
    own[:-1] += blocks[:, :order, :order]
    own[1:] += blocks[:, order:, order:]
    next_ = blocks[:, :order, order:]
    units = (unit ** np.arange(order))[:, None]
    given = np.nan_to_num(known) * units
    origin = given[0, 0].copy()
    given[:, 0] -= origin  # what stays where it is stays there to the last digit
    free = np.isnan(known[:, :, 0])
    found = given + _solve(own, next_, given, free)
    both = np.concatenate([found[:-1], found[1:]], axis=1) * scale[:, :, None]
    coefficients = np.zeros((len(spans), DEGREE + 1, known.shape[2]))
    coefficients[:, : 2 * order] = inverse @ both
    coefficients[:, 0] += origin
    return coefficients


def _solve(own: "Array", next_: "Array", given: "Array", free: "npt.NDArray[np.bool_]") -> "Array":
    """What the free derivatives must be, (N, order, axes), and 0 elsewhere."""
    import numpy as np

    count, order = free.shape
    side = -(own @ given)
    side[:-1] -= next_ @ given[1:]
    side[1:] -= np.swapaxes(next_, 1, 2) @ given[:-1]
    side *= free[:, :, None]
    matrix = own * (free[:, :, None] & free[:, None, :]) + np.eye(order) * ~free[:, :, None]
    link = next_ * (free[:-1, :, None] & free[1:, None, :])
    for k in range(1, count):
        step = np.linalg.solve(matrix[k - 1], np.concatenate([link[k - 1], side[k - 1]], axis=1))
        matrix[k] -= link[k - 1].T @ step[:, :order]
        side[k] -= link[k - 1].T @ step[:, order:]
    found = np.zeros_like(given)
    found[-1] = np.linalg.solve(matrix[-1], side[-1])
    for k in range(count - 2, -1, -1):
        found[k] = np.linalg.solve(matrix[k], side[k] - link[k] @ found[k + 1])
    return found


def ends(order: int) -> "Array":
    """A: from the coefficients to the derivatives at x = 0, then at x = 1."""
    import numpy as np

    rows = np.zeros((2 * order, 2 * order))
    for k in range(order):
        rows[k, k] = math.factorial(k)
        rows[order + k, k:] = [math.perm(i, k) for i in range(k, 2 * order)]
    return rows


def roughness(order: int) -> "Array":
    """Q of this file's heading."""
    import numpy as np

    products = np.zeros((2 * order, 2 * order))
    for i in range(order, 2 * order):
        for j in range(order, 2 * order):
            products[i, j] = math.perm(i, order) * math.perm(j, order) / (i + j - 2 * order + 1)
    return products


Axis = tuple[float, float, float, float, float, float, float, float]


class _Span(NamedTuple):
    start_s: float
    rate: float
    """One over its length [1/s]."""
    north: Axis
    east: Axis
    down: Axis
    yaw: Axis


class Spline:
    """Position and heading as polynomials in time, evaluated in plain floats. See the port for its methods.

    Before its start and after its end it rests at its first and its last point.
    """

    __slots__ = ("_end", "_spans", "_start", "duration_s", "joints_s")

    duration_s: float
    """When it ends [s]."""
    joints_s: list[float]
    """Where one polynomial meets the next [s], from 0 on."""

    def __init__(self, times_s: "Array", coefficients: "Array") -> None:
        """Take the knots (N,) [s], and coefficients (N - 1, DEGREE + 1, 4): north, east, down [m], heading [rad]."""
        self.joints_s = [float(t - times_s[0]) for t in times_s]
        self.duration_s = self.joints_s[-1]
        self._spans = [
            _Span(start, 1.0 / (end - start), *(tuple(axis) for axis in span.T.tolist()))
            for start, end, span in zip(self.joints_s, self.joints_s[1:], coefficients, strict=False)
        ]
        self._start = _resting(self._moving(0.0))
        self._end = _resting(self._moving(self.duration_s))

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        if time_s < 0.0:
            return self._start.position_ned
        if time_s >= self.duration_s:
            return self._end.position_ned
        span, x = self._place(time_s)
        return (_value(span.north, x), _value(span.east, x), _value(span.down, x))

    def at(self, time_s: float) -> Reference:
        """The reference ``time_s`` after the start [s]."""
        if time_s < 0.0:
            return self._start
        if time_s >= self.duration_s:
            return self._end
        return self._moving(time_s)

    def _place(self, time_s: float) -> tuple[_Span, float]:
        span = self._spans[max(0, min(bisect_right(self.joints_s, time_s), len(self._spans)) - 1)]
        return span, (time_s - span.start_s) * span.rate

    def _moving(self, time_s: float) -> Reference:
        span, x = self._place(time_s)
        r1 = span.rate
        r2 = r1 * r1
        r3 = r1 * r2
        n, e, d, yaw = span.north, span.east, span.down, span.yaw
        return Reference(
            (_value(n, x), _value(e, x), _value(d, x)),
            (r1 * _first(n, x), r1 * _first(e, x), r1 * _first(d, x)),
            (r2 * _second(n, x), r2 * _second(e, x), r2 * _second(d, x)),
            (r3 * _third(n, x), r3 * _third(e, x), r3 * _third(d, x)),
            _value(yaw, x),
            r1 * _first(yaw, x),
        )


def _value(c: Axis, x: float) -> float:
    c0, c1, c2, c3, c4, c5, c6, c7 = c
    return c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * (c5 + x * (c6 + x * c7))))))


def _first(c: Axis, x: float) -> float:
    _, c1, c2, c3, c4, c5, c6, c7 = c
    return c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * (5.0 * c5 + x * (6.0 * c6 + x * 7.0 * c7)))))


def _second(c: Axis, x: float) -> float:
    _, _, c2, c3, c4, c5, c6, c7 = c
    return 2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * (20.0 * c5 + x * (30.0 * c6 + x * 42.0 * c7))))


def _third(c: Axis, x: float) -> float:
    _, _, _, c3, c4, c5, c6, c7 = c
    return 6.0 * c3 + x * (24.0 * c4 + x * (60.0 * c5 + x * (120.0 * c6 + x * 210.0 * c7)))


def _resting(reference: Reference) -> Reference:
    return Reference(reference.position_ned, yaw_rad=reference.yaw_rad)
