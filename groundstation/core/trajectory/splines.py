"""Splines: the smoothest piecewise polynomials through given points, and durations within limits.

Order r = 4 gives polynomials of degree 7 with the least snap (C⁶ at every point), r = 3 those of
degree 5 with the least jerk (C⁴; jerk steps at both ends).

**Coefficients.** The unknowns are the derivatives 1 to r-1 at the knots. A leg of h seconds between
two knots has the polynomial p(x h) = Σ cᵢ xⁱ, x in 0..1. With the derivatives 0 to r-1 at its both
knots in d, and S = diag(h^k), c = A⁻¹ S d, and the leg costs E = ∫|p^(r)|² = dᵀ S H S d h^(1-2r)
with H = A⁻ᵀ Q A⁻¹, Q = ∫₀¹ of the products of the r-th derivatives of xⁱ. Setting the gradient to
zero where a derivative is free is a block-tridiagonal system, symmetric and positive definite,
solved in one sweep forth and back. Prescribing derivatives costs smoothness there alone; at a free
end the conditions are the natural ones. Minimum snap: D. Mellinger, V. Kumar, ICRA 2011; in the
derivatives at the knots: C. Richter, A. Bry, N. Roy, ISRR 2013.

**Durations** of the legs are given, or found from limits of speed and acceleration. First those of
the least cost for a given total duration are searched, by the sign of the gradient (Rprop, in the
logarithm of each duration). The free derivatives minimize E, so its change with them is zero, and
dE/dh with d held is all of the gradient. Then each duration approaches the one at which the leg's
own speed and acceleration just keep the limits. A course flown k times slower has a k-th of the
speed and a k²-th of the acceleration everywhere, so the result of every round is scaled to keep
both limits exactly; the shortest is kept.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.reference import Reference, rest_there
from groundstation.core.trajectory.transitions import Coefficients, differentiate, evaluate

Array = NDArray[np.float64]

DEGREE = 7
"""Degree of all polynomials here [-]; the coefficients of degree 6 and 7 are 0 where r is 3."""
SMOOTH_ROUNDS = 30
"""Rounds in which the durations approach those of the least cost [-]: where the gradient changes
its sign, ``RPROP_SLOWER`` reduces a step from ``RPROP_STEP`` to below 1e-4 in 11. Chosen."""
RPROP_STEP = 0.2
"""First step of the logarithm of a duration [-]. Chosen."""
RPROP_STEPS = (1e-4, 0.7)
"""Smallest and largest step of it [-]. Chosen."""
RPROP_FASTER = 1.2
"""Factor on a step where the gradient keeps its sign [-]: usual for Rprop."""
RPROP_SLOWER = 0.5
"""Factor on a step where the gradient changes its sign [-]: usual for Rprop."""
LIMIT_ROUNDS = 12
"""Rounds after these in which each duration approaches its own limits [-]: each halves what the
logarithm lacks. Chosen."""
LEAST_DEMAND = 0.2
"""Least demand of a leg, as a share of the largest, by which it is shortened in one round [-]: a
leg that needs far less time must not vanish. Chosen."""
INTERVALS = 48
"""Intervals between the samples of a leg at which its peaks are searched [-]. Chosen."""
MARGIN = 1.001
"""Factor on the durations for true peaks between the samples [-]: they are less than a thousandth
higher."""


def fit_smoothest(times_s: Array, known: Array, order: int) -> Array:
    """Return the coefficients of the smoothest piecewise polynomial.

    Args:
        times_s: the knots (N,), rising [s]; N >= 2.
        known: derivatives 0 to ``order`` - 1 at each knot, for several axes: (N, order, axes); nan
            where free, which must be the same for all axes. The points themselves must be given.
        order: r of this file's heading, 3 or 4.

    Returns:
        (N - 1, DEGREE + 1, axes), ascending, by the share x in 0..1 of each leg.
    """
    durations = np.diff(times_s)
    unit = float(np.mean(durations))  # in units of the mean duration the numbers stay near 1
    powers = (durations / unit)[:, None] ** np.arange(order)
    scale = np.concatenate([powers, powers], axis=1)
    inverse = np.linalg.inv(_make_end_matrix(order))
    cost = inverse.T @ _make_roughness_matrix(order) @ inverse
    blocks = (
        scale[:, :, None]
        * cost
        * scale[:, None, :]
        * ((durations / unit) ** (1 - 2 * order))[:, None, None]
    )
    diagonal = np.zeros((len(times_s), order, order))
    diagonal[:-1] += blocks[:, :order, :order]
    diagonal[1:] += blocks[:, order:, order:]
    upper = blocks[:, :order, order:]
    units = (unit ** np.arange(order))[:, None]
    given = np.nan_to_num(known) * units
    origin = given[0, 0].copy()
    given[:, 0] -= origin  # an axis along which all points agree is then 0 exactly
    free = np.isnan(known[:, :, 0])
    derivatives = given + _solve(diagonal, upper, given, free)
    at_ends = np.concatenate([derivatives[:-1], derivatives[1:]], axis=1) * scale[:, :, None]
    coefficients = np.zeros((len(durations), DEGREE + 1, known.shape[2]))
    coefficients[:, : 2 * order] = inverse @ at_ends
    coefficients[:, 0] += origin
    return coefficients


def _solve(diagonal: Array, upper: Array, given: Array, free: NDArray[np.bool_]) -> Array:
    """Return the free derivatives of the least cost, (N, order, axes); 0 where they are given.

    Args:
        diagonal: blocks of the cost for each knot, (N, order, order).
        upper: blocks between each knot and the next, (N - 1, order, order); those below the
            diagonal are their transposes.
        given: given derivatives, 0 where free, (N, order, axes).
        free: whether a derivative is free, (N, order).
    """
    count, order = free.shape
    right = -(diagonal @ given)
    right[:-1] -= upper @ given[1:]
    right[1:] -= np.swapaxes(upper, 1, 2) @ given[:-1]
    right *= free[:, :, None]
    # The row of a given derivative is that of the unit matrix, and its right side is 0.
    matrix = diagonal * (free[:, :, None] & free[:, None, :]) + np.eye(order) * ~free[:, :, None]
    above = upper * (free[:-1, :, None] & free[1:, None, :])
    for k in range(1, count):
        step = np.linalg.solve(matrix[k - 1], np.concatenate([above[k - 1], right[k - 1]], axis=1))
        matrix[k] -= above[k - 1].T @ step[:, :order]
        right[k] -= above[k - 1].T @ step[:, order:]
    found = np.zeros_like(given)
    found[-1] = np.linalg.solve(matrix[-1], right[-1])
    for k in range(count - 2, -1, -1):
        found[k] = np.linalg.solve(matrix[k], right[k] - above[k] @ found[k + 1])
    return found


def _make_end_matrix(order: int) -> Array:
    """Return A of this file's heading: from the coefficients of a leg to the derivatives at x = 0,
    then at x = 1, (2 order, 2 order).
    """
    rows = np.zeros((2 * order, 2 * order))
    for k in range(order):
        rows[k, k] = math.factorial(k)
        rows[order + k, k:] = [math.perm(i, k) for i in range(k, 2 * order)]
    return rows


def _make_roughness_matrix(order: int) -> Array:
    """Return Q of this file's heading, (2 order, 2 order)."""
    products = np.zeros((2 * order, 2 * order))
    for i in range(order, 2 * order):
        for j in range(order, 2 * order):
            products[i, j] = math.perm(i, order) * math.perm(j, order) / (i + j - 2 * order + 1)
    return products


class _LegPolynomials(NamedTuple):
    """Polynomials of one leg, in the share x in 0..1 of it that is flown."""

    start_s: float
    rate: float
    """Inverse of its duration [1/s]."""
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
    """Duration from the first to the last point [s]."""
    joints_s: list[float]
    """Instants at which one polynomial meets the next, and both ends [s], from 0 on."""

    def __init__(self, times_s: Array, coefficients: Array) -> None:
        """Take the knots (N,) [s], and coefficients (N - 1, DEGREE + 1, 4): north, east, down [m],
        heading [rad].
        """
        self.joints_s = [float(t - times_s[0]) for t in times_s]
        self.duration_s = self.joints_s[-1]
        self._legs = [
            _LegPolynomials(start, 1.0 / (end - start), *(tuple(axis) for axis in leg.T.tolist()))
            for (start, end), leg in zip(pairwise(self.joints_s), coefficients, strict=True)
        ]
        self._start = rest_there(self._moving(0.0))
        self._end = rest_there(self._moving(self.duration_s))

    def position_at(self, time_s: float) -> Vec3:
        """Position [m], world NED."""
        if time_s < 0.0:
            return self._start.position_ned
        if time_s >= self.duration_s:
            return self._end.position_ned
        leg, x = self._find_leg(time_s)
        return (evaluate(leg.north, x), evaluate(leg.east, x), evaluate(leg.down, x))

    def at(self, time_s: float) -> Reference:
        """Return the reference ``time_s`` after the start [s]."""
        if time_s < 0.0:
            return self._start
        if time_s >= self.duration_s:
            return self._end
        return self._moving(time_s)

    def _find_leg(self, time_s: float) -> tuple[_LegPolynomials, float]:
        """Return the leg at ``time_s`` [s], and the share of it that is flown by then [-]."""
        leg = self._legs[max(0, min(bisect_right(self.joints_s, time_s), len(self._legs)) - 1)]
        return leg, (time_s - leg.start_s) * leg.rate

    def _moving(self, time_s: float) -> Reference:
        """Return the reference at ``time_s`` [s], between start and end."""
        leg, x = self._find_leg(time_s)
        r1 = leg.rate
        r2 = r1 * r1
        r3 = r1 * r2
        (n1, n2, n3), (e1, e2, e3), (d1, d2, d3) = (
            differentiate(axis, x) for axis in (leg.north, leg.east, leg.down)
        )
        turning, _, _ = differentiate(leg.yaw, x)
        return Reference(
            (evaluate(leg.north, x), evaluate(leg.east, x), evaluate(leg.down, x)),
            (r1 * n1, r1 * e1, r1 * d1),
            (r2 * n2, r2 * e2, r2 * d2),
            (r3 * n3, r3 * e3, r3 * d3),
            evaluate(leg.yaw, x),
            r1 * turning,
        )


def allocate_times(known: Array, order: int, max_speed: float, max_acceleration: float) -> Array:
    """Return the knots (N,) [s] of a short and smooth course that keeps both limits.

    Args:
        known: as :func:`fit_smoothest` takes it; the first three axes are the position [m],
            no two points in a row the same.
        order: r, 3 or 4.
        max_speed: largest speed [m/s].
        max_acceleration: largest acceleration [m/s²].
    """
    lengths = np.linalg.norm(np.diff(known[:, 0, :3], axis=0), axis=1)
    # Start of the search: the time at the largest speed, and the time scale of the acceleration.
    durations = lengths / max_speed + np.sqrt(lengths / max_acceleration)
    best = np.full(len(durations), np.inf)
    step, last = np.full(len(durations), RPROP_STEP), np.zeros(len(durations))
    for number in range(SMOOTH_ROUNDS + LIMIT_ROUNDS):
        coefficients = fit_smoothest(_find_knots(durations), known, order)[:, :, :3]
        demand = _find_demand(coefficients, durations, max_speed, max_acceleration)
        slower = durations * (MARGIN * demand.max())
        if slower.sum() < best.sum():
            best = slower
        if number < SMOOTH_ROUNDS:
            slope = _find_slope(coefficients, durations, order)
            again = slope * last
            factor = np.select([again > 0.0, again < 0.0], [RPROP_FASTER, RPROP_SLOWER], 1.0)
            step = np.clip(step * factor, *RPROP_STEPS)
            last = np.where(again < 0.0, 0.0, slope)
            durations = durations * np.exp(-np.sign(last) * step)
        else:
            durations = slower * np.sqrt((demand / demand.max()).clip(LEAST_DEMAND))
    return _find_knots(best)


def _find_knots(durations: Array) -> Array:
    """Return the knots (N,) [s] of legs of these ``durations`` [s]."""
    return np.concatenate([[0.0], np.cumsum(durations)])


def _find_slope(coefficients: Array, durations: Array, order: int) -> Array:
    """Return the gradient of log(E · T^(2r-1)) by the logarithm of each leg's duration, (N - 1,).

    E is the cost of all legs, and T their total duration. The power of T makes up for what E gains
    by flying the same course slower.
    """
    matrix = _make_end_matrix(order)
    inverse = np.linalg.inv(matrix)
    cost = inverse.T @ _make_roughness_matrix(order) @ inverse
    derivatives = matrix @ coefficients[:, : 2 * order]  # S d
    powers = np.tile(np.arange(order), 2)[:, None]
    scale = durations ** (1 - 2 * order)
    energy = np.einsum("mia,ij,mja->m", derivatives, cost, derivatives) * scale
    moved = 2.0 * np.einsum("mia,ij,mja->m", powers * derivatives, cost, derivatives) * scale
    slope: Array = (moved + (1 - 2 * order) * energy) / energy.sum() + (
        2 * order - 1
    ) * durations / durations.sum()
    return slope


def _find_demand(
    coefficients: Array, durations: Array, max_speed: float, max_acceleration: float
) -> Array:
    """Return the factor by which each leg must be slowed to keep both limits, (N - 1,)."""
    x = np.linspace(0.0, 1.0, INTERVALS + 1)[:, None]
    powers = np.arange(coefficients.shape[1])
    first = powers * x ** np.maximum(powers - 1, 0)
    second = powers * (powers - 1) * x ** np.maximum(powers - 2, 0)
    speed = np.linalg.norm(first @ coefficients, axis=2).max(axis=1) / durations
    acceleration = np.linalg.norm(second @ coefficients, axis=2).max(axis=1) / durations**2
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
    """Return the spline from rest at the first point through all of them to rest at the last.

    Args:
        points_ned: the points [m, world NED].
        yaws: the heading at each [rad].
        order: 4 for the least snap, 3 for the least jerk.
        times_s: instant at which each is reached [s]; None: as early as both limits allow.
        max_speed: largest speed [m/s]; not used with ``times_s``.
        max_acceleration: largest acceleration [m/s²]; not used with ``times_s``.
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
    return Spline(times, fit_smoothest(times, known, order))


def fit_samples(
    times_s: Sequence[float],
    points_ned: Sequence[Vec3],
    yaws: Sequence[float],
    velocities_ned: Sequence[Vec3] | None,
) -> Spline:
    """Return the spline of the least snap through ``points_ned`` [m, world NED] at ``times_s`` [s],
    with ``velocities_ned`` [m/s] there where they are known; ``yaws`` are the headings [rad].
    """
    times = np.array(times_s)
    known = np.full((len(times), 4, 4), np.nan)
    known[:, 0, :3] = points_ned
    known[:, 0, 3] = yaws
    if velocities_ned is not None:
        known[:, 1, :3] = velocities_ned
    # Apart, as only the positions may have a given first derivative.
    positions = fit_smoothest(times, known[:, :, :3], 4)
    headings = fit_smoothest(times, known[:, :, 3:], 4)
    return Spline(times, np.concatenate([positions, headings], axis=2))
