"""The a-priori thrust bound, in consistent units and with the paper's own gains."""

import math

import pytest

from groundstation.core.control import Gains, Law, bound_decrease, thrust_bound
from groundstation.core.control.certificate import virtual_control_sup

LAW = Law(sigma_slope=3.0, rho_slope=1.0, sigma_bound=1.5, rho_bound=1.0, b_bound=5.0)
SUP = virtual_control_sup(LAW)


def test_the_virtual_control_of_the_papers_gains_reaches_7_03_m_s2_per_axis() -> None:
    assert pytest.approx(7.03, abs=0.005) == SUP


def test_the_bound_is_its_terms_and_negative_for_the_papers_gains() -> None:
    bound = thrust_bound(LAW, acceleration_sup=0.75, v_start=2.0)
    assert bound.bound == pytest.approx(9.81 - 5.5 - 0.75 - math.sqrt(3.0) * SUP - 2.0)
    assert bound.bound < 0.0


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
