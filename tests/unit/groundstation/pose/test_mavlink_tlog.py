"""groundstation/pose/recorded_codec.py: the records of a .tlog."""

import struct

from groundstation.pose import TlogReader, pose_decoder
from groundstation.pose.sources import LocalPositionDecoder, OdometryDecoder
from tests.mavlink_table import FRAMES, golden

START_US = 1_790_000_000_000_000


def tlog(*records: tuple[int, bytes]) -> bytes:
    """A file of (microseconds after the start, frame)."""
    return b"".join(struct.pack(">Q", START_US + us) + frame for us, frame in records)


def milliseconds(reader: TlogReader) -> list[int]:
    """When each record was logged, after the start [ms]."""
    return [round(1e3 * (record.time_s - START_US * 1e-6)) for record in reader]


def test_every_record_comes_with_its_time_and_its_sender() -> None:
    reader = TlogReader(tlog(*((1000 * n, g.frame) for n, g in enumerate(FRAMES))))
    records = list(reader)
    assert [r.message.get_type() for r in records] == [g.message for g in FRAMES]
    assert [r.message.get_srcSystem() for r in records] == [g.system for g in FRAMES]
    assert reader.dropped == {}
    assert milliseconds(reader) == list(range(len(FRAMES))), "a second time, too"


def test_records_behind_a_damaged_one_are_found() -> None:
    good = golden("HEARTBEAT").frame
    damaged = good[:12] + b"\x55" + good[13:]
    reader = TlogReader(tlog((0, good), (1000, damaged), (2000, good)))
    assert milliseconds(reader) == [0, 2]
    assert reader.dropped["bad_crc"] == 1


def test_what_looks_like_a_frame_behind_damage_hides_no_record() -> None:
    good = golden("HEARTBEAT").frame
    unknown = bytes.fromhex("fd140000000101ffff00")  # its length reaches into the next record
    cut_off = bytes.fromhex("fdff0000000101000000")  # its length reaches beyond the end
    records, garbage = [tlog((1000 * n, good)) for n in range(3)], b"x" * 9
    damage = records[0] + garbage + unknown + records[1] + garbage + cut_off + records[2]
    assert milliseconds(TlogReader(damage)) == [0, 1, 2]


def test_odometry_is_preferred_where_it_is_there() -> None:
    both = list(TlogReader(tlog(*((n, g.frame) for n, g in enumerate(FRAMES)))))
    assert isinstance(pose_decoder(both, 0.0), OdometryDecoder)
    without = [r for r in both if r.message.get_type() != "ODOMETRY"]
    assert isinstance(pose_decoder(without, 0.0), LocalPositionDecoder)
    assert pose_decoder(both[:3], 0.0) is None


def test_a_file_is_a_tlog_by_the_share_of_its_records() -> None:
    """Records that fill 90 % of a file make it one; frames without stamps do not."""
    records, size = tlog(*((n, golden("HEARTBEAT").frame) for n in range(100))), 29
    for garbage_share, fits in ((0.0, True), (0.09, True), (0.11, False)):
        garbage = round(garbage_share * size * 100 / (1.0 - garbage_share))
        reader = TlogReader(records + b"x" * garbage)
        assert len(list(reader)) == 100
        assert (reader.find_fault() == "") is fits, garbage_share
    raw = TlogReader(golden("HEARTBEAT").frame * 100)
    list(raw)
    assert "with 8 bytes of time before each frame" in raw.find_fault()
