"""groundstation/pose/recorded_codec.py and registry.py: recorded flights."""

import asyncio
import pathlib
import struct
from typing import Any

import pytest

from groundstation.core.messages import Pose, SourceError
from groundstation.pose import TlogConfig, TlogReader, pose_decoder
from groundstation.pose.registry import TlogSource
from groundstation.pose.sources import LocalPositionDecoder, OdometryDecoder
from links.mavlink.protocol import MavlinkCodec
from sim.time import VirtualTimeLoop
from tests.mavlink_table import FRAMES, golden

START_US = 1_790_000_000_000_000
CODEC = MavlinkCodec(1, 1)
D = CODEC.dialect


def tlog(*records: tuple[int, bytes]) -> bytes:
    """A file of (microseconds after the start, frame)."""
    return b"".join(struct.pack(">Q", START_US + us) + frame for us, frame in records)


def odometry(time_us: int, x: float, sender: MavlinkCodec = CODEC) -> bytes:
    nothing = [0.0] * 21
    message = D.MAVLink_odometry_message(
        time_us, 1, 1, x, 0.0, -1.0, (1.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, nothing, nothing, 0, 8, 0
    )
    return sender.pack(message)


def test_every_record_comes_with_its_time_and_its_sender() -> None:
    reader = TlogReader(tlog(*((1000 * n, g.frame) for n, g in enumerate(FRAMES))))
    records = list(reader)
    assert [r.message.get_type() for r in records] == [g.message for g in FRAMES]
    assert [r.message.get_srcSystem() for r in records] == [g.system for g in FRAMES]
    assert [r.time_s - START_US * 1e-6 for r in records] == pytest.approx(
        [0.001 * n for n in range(len(FRAMES))], abs=1e-6
    )
    assert reader.dropped == {}
    assert len(list(reader)) == len(FRAMES)  # a second time, too


def test_records_behind_a_damaged_one_are_found() -> None:
    good = golden("HEARTBEAT").frame
    damaged = good[:12] + b"\x55" + good[13:]
    reader = TlogReader(tlog((0, good), (1000, damaged), (2000, good)))
    assert [round((r.time_s - START_US * 1e-6) * 1e3) for r in reader] == [0, 2]
    assert reader.dropped["bad_crc"] == 1


def test_what_looks_like_a_frame_behind_damage_hides_no_record() -> None:
    good = golden("HEARTBEAT").frame
    unknown = bytes.fromhex("fd140000000101ffff00")  # its length reaches into the next record
    cut_off = bytes.fromhex("fdff0000000101000000")  # its length reaches beyond the end
    reader = TlogReader(
        tlog((0, good)) + b"x" * 9 + unknown + tlog((1000, good)) + b"x" * 9 + cut_off + tlog((2000, good))
    )
    assert [round((r.time_s - START_US * 1e-6) * 1e3) for r in reader] == [0, 1, 2]


def test_odometry_is_preferred_where_it_is_there() -> None:
    both = list(TlogReader(tlog(*((n, g.frame) for n, g in enumerate(FRAMES)))))
    assert isinstance(pose_decoder(both, 0.0), OdometryDecoder)
    assert isinstance(pose_decoder([r for r in both if r.message.get_type() != "ODOMETRY"], 0.0), LocalPositionDecoder)
    assert pose_decoder(both[:3], 0.0) is None


def play(path: pathlib.Path, until_s: float, **options: Any) -> tuple[list[tuple[float, Pose]], TlogSource]:
    delivered: list[tuple[float, Pose]] = []
    source = TlogSource(TlogConfig(path=str(path), **options))

    async def run() -> None:
        loop = asyncio.get_running_loop()
        await source.start(lambda pose: delivered.append((loop.time(), pose)))
        await asyncio.sleep(until_s)
        await source.close()
        await asyncio.sleep(5.0)

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        runner.run(run())
    return delivered, source


def test_a_recording_is_played_at_its_own_pace_and_stops_when_closed(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(
        tlog(*((20_000 * n + (3_000 if n == 2 else 0), odometry(20_000 * n, float(n))) for n in range(100)))
    )
    delivered, source = play(path, until_s=1.01, latency_s=0.005)
    assert len(delivered) == 51
    assert [s for s, _ in delivered[:4]] == pytest.approx([0.0, 0.02, 0.043, 0.06])
    poses = [pose for _, pose in delivered]
    assert [pose.position_ned[0] for pose in poses] == [float(n) for n in range(51)]
    assert [pose.time_s for pose in poses[:4]] == pytest.approx([-0.005, 0.015, 0.035, 0.055], abs=3e-4)
    assert all(pose.arrival_s == s for s, pose in delivered)
    assert source.status.accepted == 51


def test_only_the_vehicle_that_is_asked_for_makes_poses(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "flight.tlog"
    path.write_bytes(tlog((0, odometry(0, 0.0))))
    with pytest.raises(SourceError, match=r"flight\.tlog holds no poses .* of system 1.*check pose\.system_id"):
        play(path, until_s=1.0, system_id=2)


def test_only_the_autopilot_makes_poses_or_the_component_that_is_asked_for(tmp_path: pathlib.Path) -> None:
    bridge = MavlinkCodec(1, 197)
    path = tmp_path / "flight.tlog"
    both = [(20_000 * n, odometry(20_000 * n, 1.0)) for n in range(50)]
    both += [(us + 9_000, odometry(us + 9_000, 5.0, bridge)) for us, _ in both]
    path.write_bytes(tlog(*sorted(both)))
    for component_id, x in ((None, 1.0), (1, 1.0), (197, 5.0)):
        delivered, _ = play(path, until_s=2.0, component_id=component_id)
        assert {pose.position_ned[0] for _, pose in delivered} == {x}
        assert len(delivered) == 50
    with pytest.raises(SourceError, match=r"component 3 of system 1, got ODOMETRY of system 1, component 1 and of"):
        play(path, until_s=1.0, component_id=3)


def test_a_missing_recording_is_named(tmp_path: pathlib.Path) -> None:
    with pytest.raises(SourceError, match=r"^pose\.path: cannot read .*nowhere\.tlog: No such file"):
        play(tmp_path / "nowhere.tlog", until_s=1.0)
