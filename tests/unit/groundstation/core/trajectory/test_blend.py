"""Blends: every derivative met at both ends, within limits, and no step where ways are joined."""

import math

import msgspec
import pytest
from hypothesis import given, strategies as st

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory import (
    Blend,
    Chain,
    LemniscateConfig,
    Limits,
    Reference,
    blend,
    run_in,
    stop,
)

LIMITS = Limits(0.5, 1.0)
EIGHT = LemniscateConfig(speed_m_s=0.5).build()


def vectors(most: float) -> st.SearchStrategy[Vec3]:
    return st.tuples(*(st.floats(-most, most),) * 3)


yaws, turns = st.floats(-3.1, 3.1), st.floats(-1.0, 1.0)
motions = st.builds(Reference, vectors(5.0), vectors(2.0), vectors(3.0), vectors(5.0), yaws, turns)


@given(motions, motions, st.floats(0.4, 20.0))
def test_a_bridge_meets_both_ends(start: Reference, end: Reference, duration_s: float) -> None:
    way = Blend(start, end, duration_s)
    for seen, end_ in ((way.at(1e-9), start), (way.at(duration_s * (1.0 - 1e-9)), end)):
        for one, other, rounding in (
            (seen.position_ned, end_.position_ned, 1e-6),
            (seen.velocity_ned, end_.velocity_ned, 1e-6),
            (seen.acceleration_ned, end_.acceleration_ned, 1e-4),
            (seen.jerk_ned, end_.jerk_ned, 1e-2),
        ):
            assert one == pytest.approx(other, abs=rounding)
        assert math.remainder(seen.yaw_rad - end_.yaw_rad, math.tau) == pytest.approx(0.0, abs=1e-6)


@given(motions, motions, st.floats(0.5, 10.0), st.floats(0.01, 0.99))
def test_its_derivatives_are_those_of_its_positions(
    start: Reference, end: Reference, duration_s: float, share: float
) -> None:
    way, t, h = Blend(start, end, duration_s), share * duration_s, 1e-5 * duration_s
    before, here, after = way.at(t - h), way.at(t), way.at(t + h)
    for axis in range(3):
        for lower, upper, of in (
            (before.position_ned, after.position_ned, here.velocity_ned),
            (before.velocity_ned, after.velocity_ned, here.acceleration_ned),
            (before.acceleration_ned, after.acceleration_ned, here.jerk_ned),
        ):
            slope = (upper[axis] - lower[axis]) / (2.0 * h)
            assert slope == pytest.approx(of[axis], rel=1e-4, abs=1e-2)


@given(vectors(5.0), vectors(5.0))
def test_from_rest_to_rest_it_keeps_the_limits_and_is_hardly_longer_than_it_must_be(
    a: Vec3, b: Vec3
) -> None:
    way = blend(Reference(a), Reference(b), LIMITS)
    length = math.dist(a, b)
    seen = [way.at(way.duration_s * i / 200) for i in range(201)]
    assert max(math.hypot(*r.velocity_ned) for r in seen) <= 1.01 * LIMITS.speed_m_s
    assert max(math.hypot(*r.acceleration_ned) for r in seen) <= 1.03 * LIMITS.acceleration_m_s2
    by_speed_s = 35.0 / 16.0 * length / LIMITS.speed_m_s
    by_acceleration_s = math.sqrt(7.513 * length / LIMITS.acceleration_m_s2)
    shortest = max(0.4, by_speed_s, by_acceleration_s)
    assert way.duration_s <= 1.08 * shortest + 1e-9


@given(st.floats(0.0, 10.0), st.sampled_from([0.5, 1.5]))
def test_stopping_and_running_in_are_no_faster_than_the_motion_that_they_meet(
    time_s: float, speed: float
) -> None:
    flown = LemniscateConfig(speed_m_s=speed).build().at(time_s)
    moving = msgspec.structs.replace(flown, yaw_rad=0.3, yaw_rate_rad_s=0.4)
    for way, rest, other in ((stop(moving, LIMITS), 1.0, 0.0), (run_in(moving, LIMITS), 0.0, 1.0)):
        stands = way.at(rest * way.duration_s)
        assert stands.velocity_ned == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
        turned = 0.3 + 0.2 * way.duration_s * (rest - other)
        assert math.remainder(stands.yaw_rad - turned, math.tau) == pytest.approx(0.0, abs=1e-9)
        assert way.at(other * way.duration_s).position_ned == pytest.approx(moving.position_ned)
        seen = [way.at(way.duration_s * i / 100) for i in range(101)]
        assert max(math.hypot(*r.velocity_ned) for r in seen) <= 1.25 * speed
        hardest = max(LIMITS.acceleration_m_s2, 3.0 * speed**2)  # of all the figure
        assert max(math.hypot(*r.acceleration_ned) for r in seen) <= 1.2 * hardest


def test_a_chain_goes_on_without_a_step_and_counts_time_from_its_last_way() -> None:
    first = blend(Reference((0.0, 0.0, 0.0)), Reference((1.0, 0.0, 0.0)), LIMITS)
    second = blend(Reference((1.0, 0.0, 0.0)), EIGHT.at(0.0), LIMITS)
    chain = Chain([first, second], EIGHT)
    assert chain.before_s == first.duration_s + second.duration_s
    assert chain.position_at(-chain.before_s) == pytest.approx((0.0, 0.0, 0.0))
    assert chain.at(3.0) == EIGHT.at(3.0)
    for joint in (-chain.before_s, -second.duration_s, 0.0):
        before, after = chain.at(joint - 1e-7), chain.at(joint + 1e-7)
        assert before.position_ned == pytest.approx(after.position_ned, abs=1e-6)
        assert before.velocity_ned == pytest.approx(after.velocity_ned, abs=1e-5)
        assert before.acceleration_ned == pytest.approx(after.acceleration_ned, abs=1e-4)
        assert before.jerk_ned == pytest.approx(after.jerk_ned, abs=1e-3)
