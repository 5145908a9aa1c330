"""Poses out of MAVLink messages: frames, stamps, and what is dropped."""

import math
from typing import Any

import pytest

from groundstation.core.geometry import Vec3, so3
from groundstation.core.messages import Pose
from groundstation.pose.sources import LocalPositionDecoder, OdometryDecoder, PoseDecoder
from groundstation.pose.sources.intake import SourceClock
from links.mavlink.protocol import MavlinkCodec

CODEC = MavlinkCodec(1, 1)
D = CODEC.dialect
NOSE_UP = so3.from_euler_zyx(0.0, math.radians(10.0), 0.0)


def sent(message: Any) -> Any:
    """``message`` as it comes out of the wire."""
    (received,) = CODEC.feed(CODEC.pack(message))
    return received


def odometry(time_s: float, **changes: Any) -> Any:
    fields: dict[str, Any] = {
        "time_usec": int(time_s * 1e6), "frame_id": 1, "child_frame_id": 1,
        "x": 1.0, "y": -2.0, "z": -3.0, "q": (1.0, 0.0, 0.0, 0.0),
        "vx": 0.5, "vy": 0.25, "vz": -0.125, "rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.0,
        "pose_covariance": [math.nan] * 21, "velocity_covariance": [math.nan] * 21,
        "reset_counter": 0, "estimator_type": 8, "quality": 0,
    }  # fmt: skip
    return sent(D.MAVLink_odometry_message(**(fields | changes)))


def position(time_ms: int, x: float = 1.0) -> Any:
    return sent(D.MAVLink_local_position_ned_message(time_ms, x, -2.0, -3.0, 0.5, 0.25, -0.125))


def attitude(time_ms: int, q: Any = (1.0, 0.0, 0.0, 0.0), rates: Any = (0.0, 0.0, 0.0)) -> Any:
    return sent(D.MAVLink_attitude_quaternion_message(time_ms, *q, *rates))


def decode(decoder: PoseDecoder, message: Any, arrival_s: float) -> Pose:
    pose = decoder.decode(message, arrival_s)
    assert pose is not None, decoder.intake.dropped
    return pose


@pytest.mark.parametrize(("quality", "taken"), [(-1, 0), (-128, 0), (0, 1), (1, 1), (100, 1)])
def test_odometry_that_says_that_it_has_failed_is_not_taken(quality: int, taken: int) -> None:
    decoder = OdometryDecoder(0.0)
    decoder.decode(odometry(1.0, quality=quality), 1.0)
    assert decoder.intake.accepted == taken
    assert decoder.intake.dropped == ({} if taken else {"failed": 1})


AHEAD = (1.0, 0.25, 0.0)
CLIMB = (math.cos(math.radians(10.0)), 0.25, -math.sin(math.radians(10.0)))
"""The same with the nose 10° up."""


@pytest.mark.parametrize(
    ("frame", "child", "velocity"),
    [(1, 1, AHEAD), (20, 20, AHEAD), (1, 12, CLIMB), (20, 12, CLIMB), (1, 8, CLIMB)],
)
def test_velocity_in_the_body_frame_is_turned_into_the_world(
    frame: int, child: int, velocity: Vec3
) -> None:
    message = odometry(1.0, q=NOSE_UP, frame_id=frame, child_frame_id=child, vx=1.0, vz=0.0)
    pose = decode(OdometryDecoder(0.0), message, 1.0)
    assert pose.velocity_ned == pytest.approx(velocity, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"x": math.nan}, "not_finite"),
        ({"q": (math.nan, 0.0, 0.0, 0.0)}, "not_finite"),
        ({"z": math.inf}, "not_finite"),
        ({"q": (0.0, 0.0, 0.0, 0.0)}, "not_unit"),
        ({"q": (1.1, 0.0, 0.0, 0.0)}, "not_unit"),
        ({"frame_id": 4}, "wrong_frame"),
        ({"frame_id": 21}, "wrong_frame"),
        ({"child_frame_id": 21}, "wrong_frame"),
        ({"frame_id": 1, "child_frame_id": 20}, "wrong_frame"),
    ],
)
def test_odometry_that_makes_no_pose_is_dropped_and_counted(
    changes: dict[str, Any], reason: str
) -> None:
    decoder = OdometryDecoder(0.0)
    assert decoder.decode(odometry(1.0, **changes), 1.0) is None
    assert (decoder.intake.accepted, decoder.intake.dropped) == (0, {reason: 1})
    assert decode(decoder, odometry(1.01), 1.01).id == 0


def test_a_velocity_that_is_not_a_number_is_no_velocity() -> None:
    assert decode(OdometryDecoder(0.0), odometry(1.0, vy=math.nan), 1.0).velocity_ned is None


def test_a_reset_of_the_estimate_changes_the_count() -> None:
    decoder = OdometryDecoder(0.0)
    messages = [odometry(1.0 + 0.01 * n, reset_counter=n // 2) for n in range(4)]
    assert [decode(decoder, one, 1.0).reset_count for one in messages] == [0, 0, 1, 1]


@pytest.mark.parametrize(("attitude_ms", "rates", "position_ms", "angles"), [
    (1000, (0.0, 1.0, 0.0), 1020, (0.0, 0.02, 0.0)),
    (1010, (2.0, 0.0, 0.0), 1000, (-0.02, 0.0, 0.0)),
])  # fmt: skip
def test_an_attitude_a_little_older_or_newer_is_turned_by_its_own_rates(
    attitude_ms: int, rates: Vec3, position_ms: int, angles: Vec3
) -> None:
    decoder = LocalPositionDecoder(0.0)
    decoder.decode(attitude(attitude_ms, rates=rates), 1.0)
    pose = decode(decoder, position(position_ms), 1e-3 * position_ms)
    assert so3.euler_zyx(pose.attitude) == pytest.approx(angles, abs=1e-6)


def test_a_position_without_an_attitude_near_it_is_dropped() -> None:
    decoder = LocalPositionDecoder(0.0)
    assert decoder.decode(position(1000), 1.0) is None
    decoder.decode(attitude(1000), 1.0)
    assert decoder.decode(position(1051), 1.1) is None
    assert (decoder.intake.accepted, decoder.intake.dropped) == (0, {"no_attitude": 2})
    decoder.decode(attitude(1100, q=(math.nan, 0.0, 0.0, 0.0)), 1.1)
    assert decoder.decode(position(1110), 1.1) is None
    assert decoder.intake.dropped["not_finite"] == 1


@pytest.mark.parametrize("drift", [0.0, 3e-5, -3e-5, 0.001, -0.001])
def test_jitter_of_the_arrival_does_not_reach_the_time(drift: float) -> None:
    clock = SourceClock()
    errors = []
    for n in range(1000):
        true_s = 0.01 * n * (1.0 + drift)  # our clock when the source's shows 0.01 n
        arrival_s = true_s + (0.0, 0.006, 0.003, 0.009, 0.001)[n % 5]
        assert clock.stale(0.01 * n, arrival_s) == ""
        errors.append(clock.time_s(0.01 * n, arrival_s) - true_s)
    assert max(map(abs, errors[100:])) < 0.0012
