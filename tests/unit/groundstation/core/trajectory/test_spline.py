"""Shapes beyond what every trajectory must keep: splines, times of waypoints, and excitation."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory import ExcitationConfig, Trajectory
from groundstation.core.trajectory.shapes import Excitation, SamplesConfig, WaypointsConfig
from groundstation.core.trajectory.splines import fit_smoothest
from groundstation.flight.preflight import examine_trajectory
from groundstation.settings import Config

coordinate = st.integers(-50, 50).map(lambda n: n / 10.0)
courses = st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=2, max_size=7).filter(
    lambda points: all(a != b for a, b in itertools.pairwise(points))
)


def peaks(trajectory: Trajectory) -> tuple[float, float]:
    seen = [trajectory.at(trajectory.joints_s[-1] * i / 4000) for i in range(4000)]
    return max(math.hypot(*r.velocity_ned) for r in seen), max(
        math.hypot(*r.acceleration_ned) for r in seen
    )


def derivative(
    coefficients: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]", order: int, x: float
) -> float:
    factors = [math.perm(i, order) * x ** max(i - order, 0) for i in range(len(coefficients))]
    return float(np.dot(factors, coefficients))


@pytest.mark.parametrize(("order", "smooth"), [(3, 4), (4, 6)])
@pytest.mark.parametrize("given_speed", [False, True])
def test_derivatives_do_not_jump_at_knots_up_to_the_order_that_is_promised(
    order: int, smooth: int, given_speed: bool
) -> None:
    times = np.array([0.0, 0.7, 1.0, 2.5, 4.0])
    known = np.full((5, order, 1), np.nan)
    known[:, 0, 0] = [0.0, 1.0, -1.0, 3.0, 0.5]
    if given_speed:
        known[:, 1, 0] = [0.0, 1.0, 0.0, -2.0, 0.3]
        smooth -= 1
    found = fit_smoothest(times, known, order)[:, :, 0]
    spans = np.diff(times)
    for (before, h), (after, k) in itertools.pairwise(zip(found, spans, strict=True)):
        for n in range(smooth + 1):
            a, b = derivative(before, n, 1.0) / h**n, derivative(after, n, 0.0) / k**n
            assert a == pytest.approx(b, rel=1e-6, abs=1e-6)
        jump = derivative(before, smooth + 1, 1.0) / h ** (smooth + 1) - derivative(
            after, smooth + 1, 0.0
        ) / k ** (smooth + 1)
        assert abs(jump) > 1e-3  # no smoother than it says, so the loop above can fail


def test_the_snap_is_least_among_neighbours() -> None:
    times = np.array([0.0, 1.0, 1.8, 3.0])
    known = np.full((4, 4, 1), np.nan)
    known[:, 0, 0] = [0.0, 1.0, -1.0, 2.0]
    known[0, 1:] = known[-1, 1:] = 0.0

    def snap(rows: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> float:
        total = 0.0
        for span, h in zip(fit_smoothest(times, rows, 4)[:, :, 0], np.diff(times), strict=True):
            values = [derivative(span, 4, (i + 0.5) / 500) / h**4 for i in range(500)]
            total += h * sum(v * v for v in values) / 500
        return total

    best = snap(known)
    free = fit_smoothest(times, known, 4)
    for knot, order, change in itertools.product((1, 2), (1, 2, 3), (-0.2, 0.2)):
        h = times[knot + 1] - times[knot]
        other = known.copy()
        other[knot, order] = derivative(free[knot, :, 0], order, 0.0) / h**order + change
        assert snap(other) > best


@settings(max_examples=20)
@given(points=courses, speed=st.floats(0.1, 5.0), acceleration=st.floats(0.1, 5.0))
def test_times_that_are_found_keep_both_limits_and_reach_one(
    points: list[Vec3], speed: float, acceleration: float
) -> None:
    course = WaypointsConfig(
        points_ned=tuple(points), max_speed_m_s=speed, max_acceleration_m_s2=acceleration
    ).build()
    fastest, hardest = peaks(course)
    assert fastest <= speed * (1.0 + 1e-6)
    assert hardest <= acceleration * (1.0 + 1e-6)
    assert max(fastest / speed, math.sqrt(hardest / acceleration)) > 0.99
    for knot, point in zip(course.joints_s, points, strict=True):
        assert math.dist(course.position_at(knot), point) < 1e-8


FAR: Vec3 = (3.0, 0.0, -1.0)


@pytest.mark.parametrize(
    ("points", "duration_s"),
    [
        ([(0.0, 0.0, -1.0), (1.0, 0.0, -1.0), (1.0, 2.0, -1.5), (-1.0, 2.0, -1.0)], 6.34),
        ([(0.0, 0.0, -1.0), (0.3, 0.0, -1.0), FAR, (3.0, 0.4, -1.0), (0.0, 0.5, -2.0)], 8.01),
    ],
)
def test_uneven_legs_share_the_time_so_that_the_course_is_short(
    points: list[Vec3], duration_s: float
) -> None:
    course = WaypointsConfig(
        points_ned=tuple(points), max_speed_m_s=1.5, max_acceleration_m_s2=2.0
    ).build()
    assert course.joints_s[-1] == pytest.approx(duration_s, abs=0.02)


@pytest.mark.parametrize(("with_velocity", "worst"), [(False, 2e-3), (True, 5e-4)])
def test_samples_of_a_known_motion_give_its_derivatives_back(
    with_velocity: bool, worst: float
) -> None:
    times = tuple(0.05 * i for i in range(201))
    course = SamplesConfig(
        times_s=times,
        points_ned=tuple((math.sin(t), math.cos(t), -1.0) for t in times),
        velocities_ned=tuple((math.cos(t), -math.sin(t), 0.0) for t in times)
        if with_velocity
        else None,
    ).build()
    # Away from the ends, where nothing is known of what comes before and after.
    for i in range(100, 900):
        t = 0.01 * i
        there = course.at(t)
        assert math.dist(there.position_ned, (math.sin(t), math.cos(t), -1.0)) < 1e-9
        assert math.dist(there.acceleration_ned, (-math.sin(t), -math.cos(t), 0.0)) < 1e-5
        assert math.dist(there.jerk_ned, (-math.cos(t), math.sin(t), 0.0)) < worst
    for t in (0.0, 0.02, 9.98):
        assert math.dist(course.at(t).jerk_ned, (-math.cos(t), math.sin(t), 0.0)) < 0.2


CONFIG = ExcitationConfig()


def sampled() -> "np.ndarray[tuple[int, ...], np.dtype[np.float64]]":
    """Accelerations over one period, (4096, 3)."""
    motion = Excitation(CONFIG)
    times = CONFIG.period_s * np.arange(4096) / 4096
    return np.array([motion.at(t).acceleration_ned for t in times.tolist()])


def test_its_largest_acceleration_is_what_was_asked_for() -> None:
    peak = np.linalg.norm(sampled(), axis=1).max()
    assert peak == pytest.approx(CONFIG.acceleration_m_s2, rel=0.02)


def test_no_two_axes_share_a_frequency_and_all_lie_within_the_band() -> None:
    lines = [
        set(np.flatnonzero(np.abs(axis) > 1e-6 * np.abs(axis).max()).tolist())
        for axis in np.fft.rfft(sampled(), axis=0).T
    ]
    assert all(len(axis) >= 5 for axis in lines)
    assert lines[0].isdisjoint(lines[1])
    assert lines[0].isdisjoint(lines[2])
    assert lines[1].isdisjoint(lines[2])
    band = [line / CONFIG.period_s for axis in lines for line in axis]
    assert CONFIG.lowest_hz <= min(band)
    assert max(band) <= CONFIG.highest_hz


def test_it_begins_and_ends_at_rest_and_stays_close() -> None:
    flown = CONFIG.build()
    assert flown.duration_s == CONFIG.laps * CONFIG.period_s + CONFIG.ramp_s
    for time_s in (0.0, flown.duration_s):
        assert flown.at(time_s).velocity_ned == (0.0, 0.0, 0.0)
    report = examine_trajectory(Config(trajectory=CONFIG))
    assert all(abs(low + high - 2.0 * middle) < 0.4 and high - low < 0.4 for low, high,
        middle in zip(
        report.lowest_ned, report.highest_ned, CONFIG.position_ned, strict=True
    ))  # fmt: skip
