"""Own poses of an autopilot whose clock runs slow, or which come late: TIMESYNC tells which."""

import asyncio
from typing import Any

import pytest

from groundstation.core.messages import Pose
from groundstation.pose.sources import MavlinkPoseConfig, MavlinkPoseSource
from tests.unit.links.mavlink.test_mavlink_link import D, Endpoint, accept, play_scene

SLOW = 0.008
"""As a simulated PX4 was seen to fall behind on a busy machine."""
LONG_S = 20.0


def flown(slow: float, late_s: float) -> tuple[list[Pose], list[float]]:
    """Poses at 50 Hz from a clock ``slow`` by that share, late from the middle on.

    And the lateness that their source tells in the middle and at the end [s].
    """
    poses: list[Pose] = []
    lateness: list[float] = []

    async def play(link: Any, autopilot: Endpoint) -> None:
        loop = asyncio.get_running_loop()
        begun = loop.time()

        def clock_s() -> float:
            return 7.0 + (loop.time() - begun) * (1.0 - slow)

        def say(message: Any) -> None:
            is_late = loop.time() - begun > 0.5 * LONG_S
            loop.call_later(late_s if is_late else 0.0, autopilot.say, message)

        def answer(message: Any) -> list[Any]:
            if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                say(D.MAVLink_timesync_message(int(clock_s() * 1e9), message.ts1))
            return accept(message)

        autopilot.answer = answer
        source = MavlinkPoseSource(MavlinkPoseConfig(latency_s=0.0), link)
        await source.start(poses.append)
        await link.connect()
        level, unknown = (1.0, 0.0, 0.0, 0.0), [float("nan")] * 21
        loop.call_later(0.5 * LONG_S, lambda: lateness.append(source.status.late_s))
        while loop.time() - begun < LONG_S:
            frames = (int(clock_s() * 1e6), 1, 1)
            motion = (loop.time(), 0.0, 0.0, level, *[0.0] * 6)
            say(D.MAVLink_odometry_message(*frames, *motion, unknown, unknown, 0, 8, 0))
            await asyncio.sleep(0.02)
        lateness.append(source.status.late_s)

    play_scene(play, connect=False)
    return poses, lateness


@pytest.mark.parametrize("slow", [0.0, SLOW])
def test_poses_of_a_clock_that_falls_behind_are_young_until_they_come_late_by_all_of_it(
    slow: float,
) -> None:
    poses, lateness = flown(slow, 0.2)
    # Each pose says where it is by when it was.
    errors = [pose.time_s - pose.position_ned[0] for pose in poses]
    assert max(errors) < 1e-3, "never younger"
    assert min(errors) > -0.012, "what it falls behind between two questions for the time"
    assert len(poses) > 900
    assert lateness == [0.0, pytest.approx(0.2, abs=0.012)]
