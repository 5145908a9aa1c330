"""The motion of a vehicle between two poses: what is exact of it."""

import math

import pytest

from groundstation.core.geometry import IDENTITY, ZERO
from groundstation.core.vehicle import ActuatorResponse, Motion, integrate_motion

DRAG = 0.8
"""Linear drag [1/s]."""


@pytest.mark.parametrize("duration_s", [0.02, 0.1, 0.2])
@pytest.mark.parametrize(("speed_m_s", "push_m_s2"), [(2.0, 0.0), (0.0, 3.0), (-1.0, 5.0)])
def test_a_steady_push_against_drag_is_exact_but_for_the_third_order_of_the_time(
    duration_s: float, speed_m_s: float, push_m_s2: float
) -> None:
    motion = Motion(ZERO, (speed_m_s, 0.0, 0.0), IDENTITY, 0.0, ZERO)
    response = ActuatorResponse(IDENTITY, 0.0, ZERO, ZERO, ZERO)
    found = integrate_motion(motion, response, duration_s, 0.1, (push_m_s2, 0.0, 0.0), ZERO, DRAG)
    gone, final = 1.0 - math.exp(-DRAG * duration_s), push_m_s2 / DRAG
    way = final * duration_s + (speed_m_s - final) * gone / DRAG
    beyond = (abs(speed_m_s) / 6.0 + push_m_s2 * duration_s / 24.0) * DRAG**2 * duration_s**3
    assert found.position[0] == pytest.approx(way, abs=beyond)
    assert found.velocity[0] == pytest.approx(
        speed_m_s + (final - speed_m_s) * gone, abs=DRAG * beyond
    )
