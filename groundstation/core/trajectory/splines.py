"""Splines: the smoothest piecewise polynomials through given points, and durations within limits.

Between the points fly polynomials of degree 7 with the least snap (C⁶ at every point), or of degree
5 with the least jerk (C⁴; jerk steps at both ends). Times are given, or found from limits of speed
and acceleration: first those of least ∫|p^(r)|² for a given duration, by the sign of the gradient
(Rprop, in the logarithm of each leg's time). With the derivatives at the knots in d, a leg of h
seconds costs E = dᵀ S H S d h^(1-2r), S = diag(h^k), so dE/dh with d held is all of the gradient.
Then each leg is moved towards what its own speed and acceleration ask for. A course flown k times
slower has a k-th of the speed and a k²-th of the acceleration everywhere, so every round is brought
within both limits exactly; the shortest is kept.

The unknowns are the derivatives 1 to r-1 at the knots. A span has the polynomial p(x h) = Σ cᵢ xⁱ,
c = A⁻¹ S d, and H = A⁻ᵀ Q A⁻¹, Q = ∫₀¹ of the products of the r-th derivatives of xⁱ. Setting the
gradient to zero where a derivative is free is a block-tridiagonal system, symmetric and positive
definite, solved in one sweep forth and back. Prescribing derivatives costs smoothness there alone;
at a free end the conditions are the natural ones. Minimum snap: D. Mellinger, V. Kumar, ICRA 2011;
in the derivatives at the knots: C. Richter, A. Bry, N. Roy, ISRR 2013.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.reference import Reference, rest_there
from groundstation.core.trajectory.transitions import Coefficients, differentiate, evaluate

Array = NDArray[np.float64]

DEGREE = 7
"""Degree of all polynomials here [-]; quintics end in two zeros."""


def smoothest(times_s: Array, known: Array, order: int) -> Array:
    """Coefficients of the smoothest piecewise polynomial.

    Args:
        times_s: the knots (N,), rising [s]; N >= 2.
        known: derivatives 0 to ``order`` - 1 at each knot, for several axes: (N, order, axes); nan
            where free, which must be the same for all axes. The points themselves must be given.
        order: r of this file's heading, 3 or 4.

    Returns:
        (N - 1, DEGREE + 1, axes), ascending, by the share x in 0..1 of each span.
    """
    spans = np.diff(times_s)
    unit = float(np.mean(spans))  # in units of the mean span the numbers stay near 1
    powers = (spans / unit)[:, None] ** np.arange(order)
    scale = np.concatenate([powers, powers], axis=1)
    inverse = np.linalg.inv(ends(order))
    cost = inverse.T @ roughness(order) @ inverse
    blocks = (
        scale[:, :, None]
        * cost
        * scale[:, None, :]
        * ((spans / unit) ** (1 - 2 * order))[:, None, None]
    )
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


def _solve(own: Array, next_: Array, given: Array, free: NDArray[np.bool_]) -> Array:
    """Solve for the free derivatives, (N, order, axes); 0 elsewhere."""
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


def ends(order: int) -> Array:
    """A: from the coefficients to the derivatives at x = 0, then at x = 1."""
    rows = np.zeros((2 * order, 2 * order))
    for k in range(order):
        rows[k, k] = math.factorial(k)
        rows[order + k, k:] = [math.perm(i, k) for i in range(k, 2 * order)]
    return rows


def roughness(order: int) -> Array:
    """Q of this file's heading."""
    products = np.zeros((2 * order, 2 * order))
    for i in range(order, 2 * order):
        for j in range(order, 2 * order):
            products[i, j] = math.perm(i, order) * math.perm(j, order) / (i + j - 2 * order + 1)
    return products


class _Span(NamedTuple):
    start_s: float
    rate: float
    """One over its length [1/s]."""
    north: Coefficients
    east: Coefficients
    down: Coefficients
    yaw: Coefficients


class Spline:
    """Position and heading as polynomials in time, evaluated in plain floats.

    See :class:`Trajectory` for its methods.

    Before its start and after its end it is at rest at its first and its last point.
    """

    duration_s: float
    """When it ends [s]."""
    joints_s: list[float]
    """Where one polynomial meets the next [s], from 0 on."""

    def __init__(self, times_s: Array, coefficients: Array) -> None:
        """Take the knots (N,) [s], and coefficients (N - 1, DEGREE + 1, 4): north, east, down [m],
        heading [rad].
        """
        self.joints_s = [float(t - times_s[0]) for t in times_s]
        self.duration_s = self.joints_s[-1]
        self._spans = [
            _Span(start, 1.0 / (end - start), *(tuple(axis) for axis in span.T.tolist()))
            for start, end, span in zip(
                self.joints_s, self.joints_s[1:], coefficients, strict=False
            )
        ]
        self._start = rest_there(self._moving(0.0))
        self._end = rest_there(self._moving(self.duration_s))

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        if time_s < 0.0:
            return self._start.position_ned
        if time_s >= self.duration_s:
            return self._end.position_ned
        span, x = self._place(time_s)
        return (evaluate(span.north, x), evaluate(span.east, x), evaluate(span.down, x))

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
        (n1, n2, n3), (e1, e2, e3), (d1, d2, d3) = (
            differentiate(axis, x) for axis in (span.north, span.east, span.down)
        )
        turning, _, _ = differentiate(span.yaw, x)
        return Reference(
            (evaluate(span.north, x), evaluate(span.east, x), evaluate(span.down, x)),
            (r1 * n1, r1 * e1, r1 * d1),
            (r2 * n2, r2 * e2, r2 * d2),
            (r3 * n3, r3 * e3, r3 * d3),
            evaluate(span.yaw, x),
            r1 * turning,
        )


SMOOTH_ROUNDS = 30
"""Iterations that make the durations smooth [-]: their steps halve where the gradient turns, 0.2 to
below 1e-4."""
LIMIT_ROUNDS = 12
"""Iterations after these that bring each leg to its own limits [-]: a step halves the distance."""
INTERVALS = 48
"""Intervals between the samples of a leg at which its peaks are searched [-]."""
MARGIN = 1.001
"""Factor on the durations for true peaks between the samples [-]: they are less than a thousandth
higher."""


def allocate_times(known: Array, order: int, max_speed: float, max_acceleration: float) -> Array:
    """Times (N,) [s] of a short and smooth course that keeps both limits.

    Args:
        known: as :func:`smoothest` takes it; the first three axes are a place [m],
            no two in a row the same.
        order: r, 3 or 4.
        max_speed: largest speed [m/s].
        max_acceleration: largest acceleration [m/s²].
    """
    lengths = np.linalg.norm(np.diff(known[:, 0, :3], axis=0), axis=1)
    legs = lengths / max_speed + np.sqrt(lengths / max_acceleration)
    best = np.full(len(legs), np.inf)
    step, last = np.full(len(legs), 0.2), np.zeros(len(legs))
    for number in range(SMOOTH_ROUNDS + LIMIT_ROUNDS):
        coefficients = smoothest(_times(legs), known, order)[:, :, :3]
        demand = _find_demand(coefficients, legs, max_speed, max_acceleration)
        slower = legs * (MARGIN * demand.max())
        if slower.sum() < best.sum():
            best = slower
        if number < SMOOTH_ROUNDS:
            slope = _slope(coefficients, legs, order)
            again = slope * last
            step = np.clip(step * np.select([again > 0.0, again < 0.0], [1.2, 0.5], 1.0), 1e-4, 0.7)
            last = np.where(again < 0.0, 0.0, slope)
            legs = legs * np.exp(-np.sign(last) * step)
        else:
            legs = slower * (demand / demand.max()).clip(0.2) ** 0.5
    return _times(best)


def _times(legs: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(legs)])


def _slope(coefficients: Array, legs: Array, order: int) -> Array:
    """The gradient of log(∫|p^(r)|² · duration^(2r-1)), which no pace changes, by the logarithm of
    each leg's time.
    """
    matrix = ends(order)
    inverse = np.linalg.inv(matrix)
    cost = inverse.T @ roughness(order) @ inverse
    derivatives = matrix @ coefficients[:, : 2 * order]  # S d
    powers = np.tile(np.arange(order), 2)[:, None]
    scale = legs ** (1 - 2 * order)
    energy = np.einsum("mia,ij,mja->m", derivatives, cost, derivatives) * scale
    moved = 2.0 * np.einsum("mia,ij,mja->m", powers * derivatives, cost, derivatives) * scale
    slope: Array = (moved + (1 - 2 * order) * energy) / energy.sum() + (
        2 * order - 1
    ) * legs / legs.sum()
    return slope


def _find_demand(
    coefficients: Array, legs: Array, max_speed: float, max_acceleration: float
) -> Array:
    """Return the factor by which each leg must be slowed to keep both limits, (M,)."""
    x = np.linspace(0.0, 1.0, INTERVALS + 1)[:, None]
    powers = np.arange(coefficients.shape[1])
    first = powers * x ** np.maximum(powers - 1, 0)
    second = powers * (powers - 1) * x ** np.maximum(powers - 2, 0)
    speed = np.linalg.norm(first @ coefficients, axis=2).max(axis=1) / legs
    acceleration = np.linalg.norm(second @ coefficients, axis=2).max(axis=1) / (legs * legs)
    demand: Array = np.maximum(speed / max_speed, np.sqrt(acceleration / max_acceleration))
    return demand


def fit_waypoints(
    points_ned: Sequence[Sequence[float]],
    yaws: Sequence[float],
    order: int,
    *,
    times_s: Sequence[float] | None,
    max_speed: float,
    max_acceleration: float,
) -> Spline:
    """The spline from rest at the first point through all of them to rest at the last.

    Args:
        points_ned: the points [m].
        yaws: the heading at each [rad].
        order: 4 for the least snap, 3 for the least jerk.
        times_s: when each is reached [s]; None: as early as the two limits allow.
        max_speed: [m/s].
        max_acceleration: [m/s²].
    """
    known = np.full((len(points_ned), order, 4), np.nan)
    known[:, 0, :3] = points_ned
    known[:, 0, 3] = yaws
    known[0, 1:] = known[-1, 1:] = 0.0
    times = (
        allocate_times(known, order, max_speed, max_acceleration)
        if times_s is None
        else np.array(times_s)
    )
    return Spline(times, smoothest(times, known, order))


def fit_samples(
    times_s: Sequence[float],
    points_ned: Sequence[Vec3],
    yaws: Sequence[float],
    velocities_ned: Sequence[Vec3] | None,
) -> Spline:
    """The spline of the least snap through ``points_ned`` [m] at ``times_s`` [s], and with
    ``velocities_ned`` [m/s] there where they are known; ``yaws`` are the headings [rad].
    """
    times = np.array(times_s)
    known = np.full((len(times), 4, 4), np.nan)
    known[:, 0, :3] = points_ned
    known[:, 0, 3] = yaws
    if velocities_ned is not None:
        known[:, 1, :3] = velocities_ned
    places = smoothest(times, known[:, :, :3], 4)
    headings = smoothest(times, known[:, :, 3:], 4)
    return Spline(times, np.concatenate([places, headings], axis=2))
