"""``check --watch`` towards simulated trackers in virtual time, with every byte that it sends."""

import asyncio
import math
from collections import Counter
from functools import cache

import pytest

from groundstation.lab.pose_monitor import listen, summary_rows
from groundstation.lab.pose_stream import PoseStreamSummary
from links.mavlink.protocol import MavlinkCodec
from sim.runs import Stage
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop
from tests.known import known
from tests.loops import in_virtual_time, running

SOURCES = ["vicon", "natnet", "qualisys", "odometry", "vision", "json"]
AUTOPILOT_ADDRESS = 14540


@cache
def watched(
    source: str, *overrides: str, seconds: float = 6.0, told: tuple[str, ...] = ()
) -> tuple[PoseStreamSummary, Counter[str]]:
    """Summary of the held vehicle of ``paper``, and the MAVLink messages that we sent."""
    world, config = prepare(SCENARIOS["paper"], list(overrides), source=source)
    _, config_told = prepare(SCENARIOS["paper"], [*overrides, *told], source=source)
    reader, sent = MavlinkCodec(255, 1), Counter[str]()

    def tap(_time_s: float, a: tuple[str, int], b: tuple[str, int], data: bytes) -> None:
        if a[1] == AUTOPILOT_ADDRESS:
            sent.update(message.get_type() for message in reader.feed(data))

    async def main() -> PoseStreamSummary:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.tap = tap
        async with running(Stage(world, config, seed=2)):
            return await listen(config_told, seconds)

    return in_virtual_time(main)(), sent


@pytest.mark.parametrize("source", SOURCES)
def test_every_source_is_seen_as_it_is(source: str) -> None:
    seen, sent = watched(source)
    assert seen.ok
    assert seen.rate_hz == pytest.approx(50.0, rel=0.02)
    assert 0.01 < known(seen.age_s) < 0.05
    assert seen.latency_s == pytest.approx(0.02, abs=0.008)
    assert seen.jitter_s < 0.005
    assert seen.gaps == seen.clock_steps == 0
    assert seen.position_ned == pytest.approx((0.8, -0.8, 0.0), abs=0.005)
    assert seen.roll_pitch_yaw_deg == pytest.approx((0.0, 0.0, 0.0), abs=1.0)
    assert seen.at_rest
    assert seen.noise_m == pytest.approx((3e-4,) * 3, rel=0.3)
    assert seen.noise_deg == pytest.approx((math.degrees(2e-3),) * 3, rel=0.3)
    if source == "odometry":
        assert set(sent) <= {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"}
        # To be sent the poses; nothing else is asked of the autopilot.
        assert sent["COMMAND_LONG"] <= 4
    else:
        assert not sent, "no command link is opened"


def test_a_wrong_name_shows_the_names_that_are_there() -> None:
    for source, key in (("vicon", "object"), ("natnet", "name"), ("qualisys", "name")):
        seen, _ = watched(source, "sim.other_bodies=2", told=(f"pose.{key}=quadd",))
        assert not seen.ok
        assert {"quad", "other0", "other1"} <= set(seen.bodies)
        assert any(reason.startswith("no_such") for reason in seen.dropped)
        text = " ".join(" ".join(row) for row in summary_rows(seen))
        assert "is its name right" in text
        assert "other1" in text


def test_what_goes_wrong_with_poses_is_shown() -> None:
    mishaps = ("sim.occlusion_s=0.4", "sim.swap_s=0.1", "sim.mishap_period_s=2")
    seen, _ = watched("json", *mishaps, "sim.other_bodies=1")
    assert {"not_tracked", "jump"} <= set(seen.dropped)
    assert not seen.at_rest or seen.noise_m is not None
    words = "\n".join(seen.events)
    assert "poses are lost" in words
    assert "poses are back" in words
    assert seen.longest_s > 0.4


def test_a_tracker_whose_north_lies_east_of_ours_shows_a_turned_room() -> None:
    seen, _ = watched("json", "sim.tracker_yaw_deg=90")
    assert seen.position_ned == pytest.approx((-0.8, -0.8, 0.0), abs=0.005)
    assert seen.roll_pitch_yaw_deg == pytest.approx((0.0, 0.0, -90.0), abs=1.0)


def test_too_few_poses_are_no_good_source() -> None:
    seen, _ = watched("vicon", "sim.pose_loss=0.94")
    assert not seen.ok
    assert 0.0 < seen.rate_hz < 20.0
    assert "at least 20 are needed" in seen.advice


def test_silence_is_told_with_what_to_look_at() -> None:
    seen, _ = watched("vicon", "pose.listen=127.0.0.1:51001", told=("pose.listen=127.0.0.1:51077",))
    assert not seen.ok
    assert "firewall" in summary_rows(seen)[-1][1]
