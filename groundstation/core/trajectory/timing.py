"""When to be where: times for waypoints that come without, within limits of speed and acceleration.

First the times of least ∫|p^(r)|² for a given duration, found leg by leg by the sign of the gradient (Rprop, in the
logarithm of each leg's time). That is no search among polynomials: with the derivatives at the knots in d, a leg of h
seconds costs E = dᵀ S H S d h^(1-2r), S = diag(h^k), and those are the best ones already, so dE/dh with d held is all
of the gradient. Then each leg is moved towards what its own speed and acceleration ask for. A course flown k
times slower has a k-th of the speed and a k²-th of the acceleration everywhere, so every round can be brought within
both limits exactly; the shortest is kept.
"""

from typing import TYPE_CHECKING

from groundstation.core.trajectory.spline import ends, roughness, smoothest

if TYPE_CHECKING:
    from groundstation.core.trajectory.spline import Array

SMOOTH_ROUNDS, LIMIT_ROUNDS = 30, 12
LOOKS = 48
"""Speed and acceleration are looked at so often within a leg."""
MARGIN = 1.001
"""Peaks lie between the looks, less than a thousandth higher."""


def allocated(known: "Array", order: int, max_speed: float, max_acceleration: float) -> "Array":
    """Times (N,) [s] of a short and smooth course that keeps both limits.

    Args:
        known: as :func:`groundstation.core.trajectory.spline.smoothest` takes it; the first three axes are a place [m],
            no two in a row the same.
        order: r, 3 or 4.
        max_speed: largest speed [m/s].
        max_acceleration: largest acceleration [m/s²].
    """
    import numpy as np

    lengths = np.linalg.norm(np.diff(known[:, 0, :3], axis=0), axis=1)
    legs = lengths / max_speed + np.sqrt(lengths / max_acceleration)
    best = np.full(len(legs), np.inf)
    step, last = np.full(len(legs), 0.2), np.zeros(len(legs))
    for number in range(SMOOTH_ROUNDS + LIMIT_ROUNDS):
        coefficients = smoothest(_times(legs), known, order)[:, :, :3]
        asked = _asked(coefficients, legs, max_speed, max_acceleration)
        slower = legs * (MARGIN * asked.max())
        if slower.sum() < best.sum():
            best = slower
        if number < SMOOTH_ROUNDS:
            slope = _slope(coefficients, legs, order)
            again = slope * last
            step = np.clip(step * np.select([again > 0.0, again < 0.0], [1.2, 0.5], 1.0), 1e-4, 0.7)
            last = np.where(again < 0.0, 0.0, slope)
            legs = legs * np.exp(-np.sign(last) * step)
        else:
            legs = slower * (asked / asked.max()).clip(0.2) ** 0.5
    return _times(best)


def _times(legs: "Array") -> "Array":
    import numpy as np

    return np.concatenate([[0.0], np.cumsum(legs)])


def _slope(coefficients: "Array", legs: "Array", order: int) -> "Array":
    """The gradient of log(∫|p^(r)|² · duration^(2r-1)), which no pace changes, by the logarithm of each leg's time."""
    import numpy as np

    matrix = ends(order)
    inverse = np.linalg.inv(matrix)
    cost = inverse.T @ roughness(order) @ inverse
    derivatives = matrix @ coefficients[:, : 2 * order]  # S d
    powers = np.tile(np.arange(order), 2)[:, None]
    scale = legs ** (1 - 2 * order)
    energy = np.einsum("mia,ij,mja->m", derivatives, cost, derivatives) * scale
    moved = 2.0 * np.einsum("mia,ij,mja->m", powers * derivatives, cost, derivatives) * scale
    slope: Array = (moved + (1 - 2 * order) * energy) / energy.sum() + (2 * order - 1) * legs / legs.sum()
    return slope


def _asked(coefficients: "Array", legs: "Array", max_speed: float, max_acceleration: float) -> "Array":
    """How many times slower each leg must be flown to keep both limits, (M,)."""
    import numpy as np

    x = np.linspace(0.0, 1.0, LOOKS + 1)[:, None]
    powers = np.arange(coefficients.shape[1])
    first = powers * x ** np.maximum(powers - 1, 0)
    second = powers * (powers - 1) * x ** np.maximum(powers - 2, 0)
    speed = np.linalg.norm(first @ coefficients, axis=2).max(axis=1) / legs
    acceleration = np.linalg.norm(second @ coefficients, axis=2).max(axis=1) / (legs * legs)
    asked: Array = np.maximum(speed / max_speed, np.sqrt(acceleration / max_acceleration))
    return asked
