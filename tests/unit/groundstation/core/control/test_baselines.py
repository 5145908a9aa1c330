"""The parts of the baselines: directions of turning, pushes, and integrals that stop."""

import math
from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.core.control import (
    acceleration,
    make_controller,
    push,
)
from groundstation.core.control.controllers import L1, Indi
from groundstation.core.geometry import Quat, Vec3, third_column
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.messages import Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion, Vehicle

G = 9.81
VEHICLE = Vehicle()
LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)
ZERO: Vec3 = (0.0, 0.0, 0.0)

part = st.floats(-4.0, 4.0)
vec = st.tuples(part, part, part)
angle = st.floats(-1.2, 1.2)
attitude = st.builds(from_euler_zyx, angle, angle, angle)


def estimate(motion: dict[str, Any] | None = None, disturbance: Vec3 = ZERO) -> Estimate:
    still = Motion((0.0, 0.0, -1.0), ZERO, LEVEL, VEHICLE.mass_kg * G, ZERO)
    return Estimate(0.0, still._replace(**(motion or {})), disturbance, ZERO)


HERE = Reference((0.0, 0.0, -1.0))


@given(attitude, vec, vec)
def test_thrust_along_the_push_gives_the_wanted_acceleration(q: Quat, wanted: Vec3, wind: Vec3) -> None:
    along, cut = push(wanted, wind, G, math.radians(80.0))
    x, y, z = along
    assert not cut
    assert (wind[0] - x, wind[1] - y, G + wind[2] - z) == pytest.approx(wanted, abs=1e-9)
    motion = Motion(ZERO, ZERO, q, 0.9, ZERO)
    u, v, w = third_column(q)
    assert acceleration(motion, wind, 0.3, G) == pytest.approx(
        (wind[0] - 3.0 * u, wind[1] - 3.0 * v, wind[2] + G - 3.0 * w)
    )


@given(st.tuples(*(st.floats(-300.0, 300.0),) * 3))
def test_a_push_is_never_tilted_beyond_its_limit_nor_upside_down(wanted: Vec3) -> None:
    (x, y, z), cut = push(wanted, ZERO, G, math.radians(30.0))
    assert z >= 1.0
    assert math.hypot(x, y) <= z * math.tan(math.radians(30.0)) * (1.0 + 1e-12)
    if math.hypot(wanted[0], wanted[1]) > (G - min(wanted[2], G - 1.0)) * math.tan(math.radians(30.0)) * 1.001:
        assert cut


def test_indi_pushes_against_the_wind_that_the_observer_sees() -> None:
    gains = Indi(k_acceleration=0.0, actuator_compensation=False)
    decision = make_controller(gains, VEHICLE).decide(estimate(disturbance=(0.0, 0.0, 2.0)), HERE, 0.0)
    assert decision.drive.thrust == pytest.approx(VEHICLE.mass_kg * (G + 2.0))


def test_l1_finds_an_unknown_push_by_its_formulas_and_counteracts_what_its_filter_lets_through() -> None:
    # v̂˙ = f + σ̂ + A_s ṽ over T_s, σ̂ = -Φ⁻¹ e^(A_s T_s) ṽ, then C(s); the vehicle gathers speed by σ beyond the model.
    gains, h, sigma = L1(predictor_pole=2.0, bandwidth_rad_s=6.0), VEHICLE.frame_period_s, 0.8
    controller = make_controller(gains, VEHICLE)
    keep = math.exp(-2.0 * h)
    phi = (1.0 - keep) / 2.0
    off = filtered = 0.0
    for k in range(120):
        moving = estimate({"velocity": (k * h * sigma, 0.0, -2.0 * k * h * sigma)})
        seen = controller.decide(moving, HERE, h if k else 0.0).diagnostics.b_hat
        found = -keep / phi * off
        filtered += (1.0 - math.exp(-6.0 * h)) * (found - filtered) if k else 0.0
        assert seen == pytest.approx((filtered, 0.0, -2.0 * filtered), abs=1e-9)
        off = keep * off + phi * found - h * sigma
    # What stays of it is the known share: e^(A_s T_s) T_s / Φ.
    assert filtered == pytest.approx(keep * h / phi * sigma, rel=1e-3)
