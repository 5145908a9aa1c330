"""What the theory promises before take-off: the a-priori bound that keeps thrust positive.

The paper's bound in consistent units: T/m >= g - (B + ε) - sup|p¨d| - sup|u*| - √(2 V(0)), each sup over time of a
Euclidean norm. It is conservative (with the paper's own gains it is negative), so it is reported, not refused on:
in flight the commanded thrust is clamped above ``vehicle.thrust_min_n``.
"""

import math
from typing import NamedTuple

from groundstation.control.backstepping import axis
from groundstation.control.gains import Law
from groundstation.ops import FLOATS, Vec3


class ThrustBound(NamedTuple):
    """The bound and its terms, all in m/s²."""

    bound: float
    """What thrust over mass never falls below; negative: the theory promises nothing."""
    gravity: float
    disturbance: float
    """B + ε."""
    reference: float
    """sup |p¨d|."""
    virtual_control: float
    """sup |u*|: √3 times the largest value on one axis."""
    start: float
    """√(2 V(0))."""


def virtual_control_sup(law: Law) -> float:
    """The largest |u*| on one axis [m/s²], over all position and speed errors (u* is odd: z1_dot > 0 is enough).

    A coarse grid far beyond where Ω' has made u* fall again, then three finer ones around its best point.
    """
    m = law.sigma_bound
    z1, z1_span = 0.0, 10.0 * m / law.sigma_slope
    x2 = x2_span = 5.0 * (m + law.velocity_scale)
    top, points = 0.0, 30
    for _ in range(4):
        best = (z1, x2)
        for i in range(-points, points + 1):
            for j in range(-points, points + 1):
                first, second = z1 + z1_span * i / points, x2 + x2_span * j / points
                value = abs(axis(FLOATS, law, first, second).u_star)
                if value > top:
                    top, best = value, (first, second)
        z1, x2 = best
        z1_span, x2_span, points = 2.0 * z1_span / points, 2.0 * x2_span / points, 12
    return top


def thrust_bound(law: Law, *, acceleration_sup: float, v_start: float) -> ThrustBound:
    """The bound for a reference whose acceleration stays below ``acceleration_sup`` [m/s²], from V(0) = ``v_start``."""
    disturbance = law.b_bound + law.epsilon
    control = math.sqrt(3.0) * virtual_control_sup(law)
    start = math.sqrt(2.0 * v_start)
    bound = law.gravity - disturbance - acceleration_sup - control - start
    return ThrustBound(bound, law.gravity, disturbance, acceleration_sup, control, start)


def acceleration_sup(accelerations: list[Vec3]) -> float:
    """sup |p¨d| [m/s²] over samples of a reference."""
    return max((math.hypot(*a) for a in accelerations), default=0.0)
