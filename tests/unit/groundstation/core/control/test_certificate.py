"""The a-priori thrust bound, in consistent units and with the paper's own gains."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundstation.core.control import Gains, Law, bound_decrease, thrust_bound
from groundstation.core.control.backstepping import BacksteppingAxis, axis
from groundstation.core.control.certificate import virtual_control_sup
from groundstation.core.geometry import FLOATS

LAW = Law(sigma_slope=3.0, rho_slope=1.0, sigma_bound=1.5, rho_bound=1.0, b_bound=5.0)
SUP = virtual_control_sup(LAW)


def test_the_virtual_control_of_the_papers_gains_reaches_7_03_m_s2_per_axis() -> None:
    assert pytest.approx(7.03, abs=0.005) == SUP


@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))
def test_no_error_however_large_asks_for_more(z1: float, z1_dot: float) -> None:
    assert abs(BacksteppingAxis(*axis(FLOATS, LAW.shape, z1, z1_dot)).u_star) <= SUP * (1 + 1e-4)


@given(st.floats(-3.0, 3.0), st.floats(0.0, 6.0))
def test_nor_does_any_near_its_largest_value(z1: float, z1_dot: float) -> None:
    assert abs(BacksteppingAxis(*axis(FLOATS, LAW.shape, z1, z1_dot)).u_star) <= SUP * (1 + 1e-4)


def test_the_bound_is_its_terms_and_negative_for_the_papers_gains() -> None:
    bound = thrust_bound(LAW, acceleration_sup=0.75, v_start=2.0)
    assert bound.bound == pytest.approx(9.81 - 5.5 - 0.75 - math.sqrt(3.0) * SUP - 2.0)
    assert bound.bound < 0.0


def test_softer_gains_and_a_smaller_disturbance_make_it_positive() -> None:
    soft = Law(k2=0.3, sigma_bound=0.5, sigma_slope=0.6, rho_bound=0.5, b_bound=1.0, epsilon=0.2)
    assert thrust_bound(soft, acceleration_sup=0.2, v_start=0.1).bound > 0.0


@pytest.mark.parametrize(
    ("gains", "expected"),
    [
        (Gains(), "composite"),
        (Gains(composite="off"), "paper"),
        (Gains(composite="raw"), "none: the raw form"),
        (Gains(kb=2.0), "none: the proof needs"),
        (Gains(kappa=130.0), "none: the proof needs"),
        (Gains(kb=0.0), "none: adaptation is off"),
    ],
)
def test_the_certificate_names_the_bound_that_holds_for_the_gains_that_fly(gains: Gains, expected: str) -> None:
    assert bound_decrease(gains).startswith(expected)
