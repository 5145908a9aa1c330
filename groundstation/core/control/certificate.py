"""What the theory promises: the a-priori bound that keeps thrust positive, and how V must fall in flight.

The paper's bound in consistent units: T/m >= g - (B + ε) - sup|p¨d| - sup|u*| - √(2 V(0)), each sup over time of a
Euclidean norm. It is conservative (with the paper's own gains it is negative), so it is reported, not refused on:
in flight the commanded thrust is clamped above ``vehicle.thrust_min_n``.
"""

import math
from typing import NamedTuple

from groundstation.core.control.adaptive import bound_decrease
from groundstation.core.control.backstepping import axis
from groundstation.core.control.gains import Gains, Law
from groundstation.core.estimation import Estimation
from groundstation.core.geometry import FLOATS, Real, Vec3
from groundstation.core.messages import Diagnostics

NO_FUNCTION = "none: this controller comes without a Lyapunov function"


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

    A coarse grid far beyond where Ω' has made u* fall again (one half of it, as u* is odd), then three finer ones
    around its best point.
    """
    m = law.sigma_bound
    z1, z1_span = 0.0, 10.0 * m / law.sigma_slope
    x2 = x2_span = 5.0 * (m + law.velocity_scale)
    top, points = 0.0, 30
    for last in (0, 12, 12, 12):
        best = (z1, x2)
        for i in range(-points, last + 1):
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


COVERED_RATE_M_S3 = 3.0
"""β: how fast b̂ and û may be moved by wind and actuators, and the bound still hold [m/s³]. The sine gusts of `adverse`
have 0.9; a tilt rate that is off by 0.2 rad/s has 2."""


class Decrease(NamedTuple):
    """The bound V_m˙ <= -s (W + κ|w|²) + D for one set of gains (docs/explanation/law.md, section 5.9)."""

    name: str
    """Which bound holds, or why none does."""
    share: float
    """s [-]; 0 where nothing is proved."""
    power: float
    """What D has for wind and actuators; :func:`noise_power` comes on top [m²/s³]."""
    spare: float
    """How far V_m may stand above its bound for what is not measured [m²/s²]."""


def decrease(law: Law) -> Decrease:
    """The bound that these gains have in flight."""
    name = bound_decrease(law) if isinstance(law, Gains) else "none: the gains of the law alone"
    left = 1.0
    if name.startswith("composite") and isinstance(law, Gains):
        beyond = max(1.0, ((law.b_bound + law.epsilon) / law.b_bound) ** 2 - 1.0)
        left = 1.0 - 0.5 * law.kb * beyond * math.sqrt(law.kappa / law.k3)
    # Without a d̂ of its own nothing stands for b̃: V_known may rise by what the last term of V can give.
    spare = 0.5 * (2.0 * law.b_bound + law.epsilon) ** 2 / law.kb if name.startswith("paper") else 0.0
    share = 0.0 if name.startswith("none") else 0.5 * left
    return Decrease(name, share, COVERED_RATE_M_S3**2 / (2.0 * left * law.k3), spare)


class Measure(NamedTuple):
    """V_m = V_known + |w|²/(2 kb) with w = d̂ - b̂, and what it must fall by, for one set of gains. Elementwise."""

    decrease: Decrease
    """The bound that these gains have."""
    weight: float
    """1/(2 kb) [s²]; 0 without an observer that finds d̂ by itself."""
    kappa: float
    """κ [1/s]; 0 likewise."""
    b_bound2: float
    """B², what the law keeps |b̂|² about [m²/s⁴]; without adaptation inf."""

    def of(self, d: Diagnostics) -> tuple[Real, Real]:
        """V_m [m²/s²], and W + κ|w|² [m²/s³], where the law says ``d``."""
        bx, by, bz = d.b_hat
        wx, wy, wz = d.disturbance
        wx, wy, wz = wx - bx, wy - by, wz - bz
        ww = wx * wx + wy * wy + wz * wz
        return d.v_known + self.weight * ww, d.w + self.kappa * ww


def measure(config: Estimation) -> Measure:
    """What can be measured of V under these gains; for a controller without a Lyapunov function, of nothing."""
    law = config if isinstance(config, Law) else None
    known = Decrease(NO_FUNCTION, 0.0, 0.0, 0.0) if law is None else decrease(law)
    bound2 = law.b_bound**2 if law is not None and law.kb > 0.0 else math.inf
    if isinstance(config, Gains) and config.composite == "provable" and config.kb > 0.0:
        return Measure(known, 0.5 / config.kb, config.kappa, bound2)
    return Measure(known, 0.0, 0.0, bound2)


def noise_power(law: Law, noise_m: Real, interval_s: Real) -> Real:
    """What D has for poses of noise ``noise_m`` [m, 1σ per axis] every ``interval_s`` [s]: [m²/s³]. Elementwise.

    Innovations are white, so on average V_m only gains the second-order part of their jumps: half of its curvature at
    the origin times their intensity, on three axes. The observer's gains are those of its steady state in continuous
    time for a chain that the disturbance's rate drives: a Butterworth filter of order 4.
    """
    intensity = noise_m * noise_m * interval_s
    w: Real = (law.wind_rate_noise**2 / intensity) ** 0.125
    l1, l2, l3 = 2.613 * w, 3.414 * w * w, 2.613 * w * w * w
    if law.composite == "off":
        l3 = 0.0
    r = law.sigma_slope
    z2 = l2 + r * l1
    z3 = l3 + law.k2 * law.rho_slope * z2 + r * (l1 + l2)
    return 1.5 * intensity * (r * l1 * l1 + z2 * z2 + z3 * z3)
