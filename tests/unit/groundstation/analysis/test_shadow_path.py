"""groundstation/analysis/evidence/shadow.py: the flown path with its derivatives."""

import math

import numpy as np
import pytest

from groundstation.analysis.evidence.shadow import FlownPath
from groundstation.core.geometry import so3
from groundstation.core.messages import Pose

COEFFICIENTS = np.array([[0.3, -1.0, 2.0], [0.5, 0.2, -0.1], [-0.4, 0.3, 0.2], [0.2, -0.1, 0.3], [0.05, 0.1, -0.2]])


def pose(time_s: float, x: float, y: float, z: float, yaw: float = 0.0, resets: int = 0) -> Pose:
    return Pose(0, time_s, time_s, (x, y, z), so3.from_euler_zyx(0.0, 0.0, yaw), None, resets)


def uneven_times(count: int) -> list[float]:
    """Steps of 8 and 16 ms, as PX4 stamps them."""
    steps = [0.008, 0.016, 0.008, 0.008]
    times = [0.0]
    for i in range(count - 1):
        times.append(times[-1] + steps[i % 4])
    return times


def test_a_polynomial_of_fourth_degree_is_found_exactly_at_uneven_stamps() -> None:
    times = uneven_times(200)
    path = FlownPath([pose(t, *(np.vander([t], 5, increasing=True) @ COEFFICIENTS)[0]) for t in times])
    for t in (times[0], 0.7, 1.0, times[-1]):
        reference = path.at(t)
        assert reference is not None
        derivatives = (
            reference.position_ned,
            reference.velocity_ned,
            reference.acceleration_ned,
            reference.jerk_ned,
        )
        for order, found in enumerate(derivatives):
            powers = [math.perm(k, order) * t ** max(k - order, 0) for k in range(5)]
            assert found == pytest.approx(np.array(powers) @ COEFFICIENTS, abs=1e-6 * 10**order)


def test_a_circle_is_followed_with_its_derivatives_and_the_heading_across_south() -> None:
    w = 1.5
    times = [0.01 * k for k in range(400)]
    path = FlownPath([pose(t, math.cos(w * t), math.sin(w * t), -1.0, w * t) for t in times])
    for t in (1.0, 2.0, math.pi / w, 3.0):
        reference = path.at(t)
        assert reference is not None
        c, s = math.cos(w * t), math.sin(w * t)
        assert reference.position_ned == pytest.approx((c, s, -1.0), abs=1e-3)
        assert reference.velocity_ned == pytest.approx((-w * s, w * c, 0.0), abs=5e-3)
        assert reference.acceleration_ned == pytest.approx((-w * w * c, -w * w * s, 0.0), abs=0.05)
        assert reference.jerk_ned == pytest.approx((w**3 * s, -(w**3) * c, 0.0), abs=0.3)
        assert reference.yaw_rate_rad_s == pytest.approx(w, abs=1e-6)


@pytest.mark.parametrize("why", ["reset", "gap"])
def test_the_path_breaks_at_a_reset_and_at_a_gap_instead_of_smoothing_over_it(why: str) -> None:
    late = 0.5 if why == "gap" else 0.0
    poses = [pose(0.01 * k, 0.0, 0.0, 0.0) for k in range(100)]
    poses += [pose(1.0 + late + 0.01 * k, 5.0, 0.0, 0.0, resets=int(why == "reset")) for k in range(100)]
    path = FlownPath(poses)
    before, after = path.at(0.99), path.at(1.0 + late)
    assert before is not None and after is not None
    assert (before.position_ned[0], after.position_ned[0]) == pytest.approx((0.0, 5.0), abs=1e-9)
    assert (before.velocity_ned[0], after.velocity_ned[0]) == pytest.approx((0.0, 0.0), abs=1e-6)
    if why == "gap":
        assert path.at(1.25) is None
