"""How late poses are is found by the vehicle's own attitude, and nothing else passes for it."""

import math
from typing import Any

import numpy as np
import pytest

from groundstation.core.geometry import Quat, multiply, scale, so3
from groundstation.core.health import PoseLatency, ResponseLatency
from groundstation.core.messages import Pose
from links.core import Attitude

NOISE_RAD = 0.002


def true(time_s: float, strength: float) -> tuple[Quat, tuple[float, float, float]]:
    """Attitude and body rates [rad/s] of a vehicle that turns about all axes."""

    def attitude(at_s: float) -> Quat:
        roll, pitch = strength * math.sin(2.0 * at_s), strength * math.cos(1.7 * at_s)
        return so3.from_euler_zyx(0.2 + roll, pitch - 0.1, 1.0 + 2.0 * strength * at_s)

    h = 1e-4
    turn = so3.turn_between(attitude(time_s - h), attitude(time_s + h))
    return attitude(time_s), scale(0.5 / h, turn)


def found(
    late_s: float, *, strength: float = 0.1, askew: Quat = so3.IDENTITY, seconds: float = 15.0
) -> float | None:
    """Latency of poses at 50 Hz stamped ``late_s`` too late, by attitudes at 20 Hz."""
    latency, rng = PoseLatency(), np.random.default_rng(1)
    told = 0
    for k in range(round(50 * seconds)):
        stamp = 0.02 * k
        while 0.05 * told + 0.003 <= stamp:
            at = 0.05 * told + 0.003
            latency.add_attitude(Attitude(at, *true(at, strength)))
            told += 1
        attitude, _ = true(stamp - late_s, strength)
        a, b, c = rng.normal(0.0, NOISE_RAD, 3).tolist()
        seen = so3.rotate(multiply(attitude, askew), (a, b, c))
        latency.add_pose(Pose(k, stamp, stamp, (0.0, 0.0, -1.0), seen))
    return latency.late_s


ASKEW = so3.from_euler_zyx(math.radians(4.0), math.radians(-3.0), 0.0)


@pytest.mark.parametrize(
    ("late_s", "more", "seen_s"),
    [
        *((late_s, {}, late_s) for late_s in (-0.015, 0.015, 0.03)),
        (0.0, {}, None),
        (0.004, {}, None),
        (0.03, {"strength": 0.0}, None),
        (0.03, {"seconds": 3.0}, None),
        (0.0, {"askew": ASKEW}, None),  # a body that is mounted askew is not late
        (0.02, {"askew": ASKEW}, 0.02),
    ],
)
def test_poses_that_are_stamped_wrong_are_found_while_the_vehicle_turns(
    late_s: float, more: dict[str, Any], seen_s: float | None
) -> None:
    assert found(late_s, **more) == (None if seen_s is None else pytest.approx(seen_s, abs=0.003))


def test_a_gap_and_a_clock_that_jumps_are_no_latency() -> None:
    latency = PoseLatency()
    for k in range(900):
        at = 0.02 * k
        clock = at - (5.0 if k > 300 else 0.0)
        if not 500 < k < 560:
            latency.add_attitude(Attitude(clock, *true(at, 0.1)))
        latency.add_pose(Pose(k, at, at, (0.0, 0.0, -1.0), true(at, 0.1)[0]))
    assert latency.late_s is None


def answered(
    late_s: float, *, seconds: float = 15.0, hz: int = 50, askew: Quat = so3.IDENTITY
) -> ResponseLatency:
    """Latency of poses alone, whose turns come ``late_s`` later than the commands' model."""
    response, rng = ResponseLatency(), np.random.default_rng(1)
    for k in range(1, round(hz * seconds)):
        stamp, dt = k / hz, 1.0 / hz
        a, b, c = rng.normal(0.0, NOISE_RAD, 3).tolist()
        seen = so3.rotate(multiply(true(stamp - late_s, 0.1)[0], askew), (a, b, c))
        turn = so3.turn_between(true(stamp - dt, 0.1)[0], true(stamp, 0.1)[0])
        response.add_pose(seen, turn, dt)
    return response


@pytest.mark.parametrize("hz", [50, 100, 240])
@pytest.mark.parametrize("late_s", [-0.015, 0.015, 0.03])
def test_a_vehicle_that_turns_later_than_told_is_found_by_poses_alone(
    late_s: float, hz: int
) -> None:
    for askew in (so3.IDENTITY, ASKEW):
        assert answered(late_s, hz=hz, askew=askew).late_s == pytest.approx(late_s, abs=0.003)


def test_nothing_is_said_of_a_response_that_is_as_told_or_was_seen_for_a_moment() -> None:
    assert answered(0.0).late_s is None
    assert answered(0.006).late_s is None
    assert answered(0.03, seconds=3.5, hz=240).late_s is None
    assert ResponseLatency().describe_news(None) is None


def test_it_is_said_once_and_the_poses_own_latency_is_not_said_again() -> None:
    response = answered(0.03)
    assert response.describe_news((0.025, 0.0)) is None
    told = response.describe_news(None)
    assert told is not None
    assert told.text.startswith(
        tuple(f"poses or the vehicle's turns are {late_ms} ms later" for late_ms in (29, 30))
    )
    assert response.describe_news(None) is None
    rates = answered(0.03).describe_news((0.0, 0.0))
    assert rates is not None and rates.text.startswith("the vehicle turns")


def test_a_latency_that_grows_is_told_where_it_is_half_as_large_again() -> None:
    """As of poses whose axes are turned: it was told at every 10 ms."""
    response, told = answered(0.02), 0
    for late_ms in range(20, 201, 2):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ResponseLatency, "late_s", 1e-3 * late_ms)
            told += response.describe_news(None) is not None
    assert 4 <= told <= 8
