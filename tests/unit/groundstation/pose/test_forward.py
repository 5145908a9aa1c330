"""Forwarded poses of an autopilot's own estimator: their rate, age, velocity and bytes."""

import math
from typing import Any

import pytest

from groundstation.core.geometry import so3
from groundstation.core.messages import Pose
from groundstation.pose.forward import Forward
from links.mavlink.protocol import (
    ARDUPILOT,
    PX4,
    ForwardConfig,
    MavlinkCodec,
    Odometry,
    encode_odometry,
)
from tests.external_poses import ExternalPoses, Fused


def pose(time_s: float, **more: Any) -> Pose:
    """A pose of a vehicle that flies north at 2 m/s, 1 m up."""
    more = {"attitude": so3.IDENTITY, **more}
    return Pose(round(1e3 * time_s), time_s, time_s + 0.01, (2.0 * time_s, 0.0, -1.0), **more)


def forwarded(times_s: list[float], age_s: float) -> list[float]:
    """The times of those poses that are forwarded [s], each taken at an age of ``age_s``."""
    forward = Forward(ForwardConfig(rate_hz=40.0, oldest_s=0.05), 0.0)
    poses = [pose(t, velocity_ned=(2.0, 0.0, 0.0)) for t in times_s]
    return [one.time_s for one in poses if forward.take(one, one.time_s + age_s) is not None]


@pytest.mark.parametrize(
    ("times_s", "age_s", "left_s"),
    [
        # every second of 80 a second at 40 a second
        ([0.0125 * n for n in range(9)], 0.01, [0.0, 0.025, 0.05, 0.075, 0.1]),
        # a tenth of the period early is in time, more is not
        ([0.0, 0.0226, 0.05, 0.0724, 0.0726], 0.01, [0.0, 0.0226, 0.05, 0.0726]),
        # after an outage the period begins anew: no burst makes up for what was missing
        ([0.0, 0.025, 0.09, 0.10, 0.115, 0.14], 0.01, [0.0, 0.025, 0.09, 0.115, 0.14]),
        ([0.0], 0.05, [0.0]),
        ([0.0], 0.051, []),  # too old
    ],
)
def test_the_rate_is_kept_by_the_time_of_the_poses_and_none_is_too_old(
    times_s: list[float], age_s: float, left_s: list[float]
) -> None:
    assert forwarded(times_s, age_s) == pytest.approx(left_s)


@pytest.mark.parametrize(
    ("before_s", "base_s"),
    [
        ([], None),
        ([0.99], None),  # 10 ms are too short
        ([0.979], 0.021),  # half the base suffices
        ([0.98 - 0.01 * n for n in range(5, -2, -1)], 0.04),  # the base, and no pose before it
        ([0.801], 0.199),
        ([0.799], None),  # an outage is no base
        ([1.01], None),  # nor is a clock that has run back
    ],
)
def test_velocity_is_measured_over_the_base_and_across_no_gap(
    before_s: list[float], base_s: float | None
) -> None:
    forward = Forward(ForwardConfig(rate_hz=200.0, oldest_s=1.0), 0.0)
    for time_s in before_s:
        forward.take(pose(time_s), time_s)
    found = forward.take(pose(1.0), 1.0)
    if base_s is None:
        assert found is None
        return
    assert found is not None and not found.measured_velocity
    assert found.velocity == pytest.approx((2.0, 0.0, 0.0))
    assert found.noise_m_s == pytest.approx(math.sqrt(2.0) * ForwardConfig().noise_m / base_s)


def test_an_origin_that_moves_is_counted_and_makes_no_velocity() -> None:
    forward = Forward(ForwardConfig(rate_hz=200.0), 0.5)
    poses = [pose(0.03 * n, reset_count=count) for n, count in enumerate([0, 0, 7, 7, 8])]
    taken = [forward.take(one, one.time_s) for one in poses]
    assert [one and one.resets for one in taken] == [None, 0, None, 1, None]
    second = taken[1]
    assert second and second.position == pytest.approx((0.06, 0.0, -1.5)), "above the floor"


def test_velocity_is_along_the_bodys_axes_and_the_poses_own_where_they_have_one() -> None:
    forward = Forward(ForwardConfig(rate_hz=200.0), 0.0)
    east = so3.from_euler_zyx(0.0, 0.0, math.pi / 2.0)
    last = [forward.take(pose(0.01 * n, attitude=east), 0.01 * n + 0.01) for n in range(30)][-1]
    assert last is not None
    assert last.velocity == pytest.approx((0.0, -2.0, 0.0), abs=1e-9)  # north is to its left
    measured = forward.take(pose(0.3, velocity_ned=(1.0, 0.0, 0.0)), 0.31)
    assert measured is not None and measured.measured_velocity
    assert measured.velocity == pytest.approx((1.0, 0.0, 0.0))


def test_the_bytes_hold_what_each_autopilot_wants() -> None:
    told = Odometry(
        12.5, (1.0, 2.0, -3.0), so3.IDENTITY, (0.1, 0.2, 0.3), False, 300, 0.01, 0.02, 0.5
    )
    codec = MavlinkCodec(245, 190)
    for kind, speed in ((PX4, None), (ARDUPILOT, (0.1, 0.2, 0.3))):
        frame = encode_odometry(codec, kind, told)
        (message,) = MavlinkCodec(1, 1).feed(frame)
        frame_id = 1 if kind == PX4 else 20  # MAV_FRAME_LOCAL_NED, _LOCAL_FRD
        frames = message.frame_id, message.child_frame_id, message.estimator_type
        assert frames == (frame_id, 12, 2)
        assert message.time_usec == 12_500_000
        assert message.reset_counter == 300 & 0xFF
        assert message.quality == 100
        assert all(map(math.isnan, (message.rollspeed, message.pitchspeed, message.yawspeed)))
        diagonal = [message.pose_covariance[n] for n in (0, 6, 11, 15, 18, 20)]
        assert diagonal == pytest.approx([1e-4] * 3 + [4e-4] * 3)
        assert sum(map(abs, message.pose_covariance)) == pytest.approx(sum(diagonal))
        external = ExternalPoses(kind)
        external.take(message, 0.0)
        (fused,) = external.fused
        assert isinstance(fused, Fused)
        assert fused.velocity_body == (None if speed is None else pytest.approx(speed))
        assert len(frame) <= 258
