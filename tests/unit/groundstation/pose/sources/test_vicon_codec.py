"""Vicon's bytes: the golden table, what of a stream is new, and what is told of a port in use."""

import math

import pytest

from groundstation.pose.sources import ViconConfig, describe_drop
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.vicon_codec import (
    ViconObject,
    ViconReader,
    decode,
    encode,
    pose_of,
    quaternion_from_euler_xyz,
)
from tests.loops import free_address, in_real_time
from tests.pose_tables import OURS, VICON, ViconDropped, ViconReadable

readable = pytest.mark.parametrize("row", VICON.readable, ids=lambda row: row.about)
dropped = pytest.mark.parametrize("row", VICON.dropped, ids=lambda row: row.about)


@readable
def test_the_reader_finds_what_the_golden_datagram_says(row: ViconReadable) -> None:
    assert decode(row.datagram) == (row.frame_number, row.objects)


@readable
def test_the_writer_gives_the_golden_datagram_byte_for_byte(row: ViconReadable) -> None:
    assert encode(row.frame_number, row.objects, row.size) == row.datagram


@readable
def test_a_decoder_gives_its_own_object_in_metres_and_as_a_quaternion(row: ViconReadable) -> None:
    (own,) = (item for item in row.objects if item.name == OURS)
    # The table's mqx is at (1234.5, -250.25, 1000) mm in every row.
    attitude = quaternion_from_euler_xyz((0.0625, -0.125, 1.5))
    assert pose_of(own) == ((1.2345, -0.25025, 1.0), attitude)


@dropped
def test_a_datagram_of_no_use_is_counted_by_reason_and_dropped(row: ViconDropped) -> None:
    reader = ViconReader(OURS, Intake(0.0, frame_s=0.02))
    for count in (1, 2):
        assert reader.read(row.datagram, 0.0) == ()
        assert reader.status.dropped == {row.reason: count}


def frame(number: int, north_mm: float = 0.0) -> bytes:
    place, turn = (north_mm, -2000.0, 1000.0), (0.0, 0.0, -math.pi / 2.0)
    return encode(number, [ViconObject(OURS, place, turn)])


@pytest.mark.parametrize(
    ("frames", "ids", "dropped"),
    [
        (((10, 0.0), (11, 1.0), (11, 1.0), (10, 0.0), (13, 3.0), (12, 2.0)), [10, 11, 13],
         {"duplicate": 1, "out_of_order": 2}),
        (((5000, 0.0), (100, 9.0), (5001, 1.0), (101, 8.0)), [5000, 5001], {"out_of_order": 2}),
        # two trackers at once
        (((1, 1.0), (2, 1.0), (3, 1.0), (4, math.nextafter(1.0, 2.0))), [1, 4], {"frozen": 2}),
    ],
    ids=["each frame counts once and never backwards", "only the one ahead",
        "the same to the last bit"],
)  # fmt: skip
def test_of_frames_only_new_measurements_make_poses(
    frames: tuple[tuple[int, float], ...], ids: list[int], dropped: dict[str, int]
) -> None:
    reader = ViconReader(OURS, Intake(0.0, frame_s=0.02))
    taken: list[int] = []
    for n, (number, north_mm) in enumerate(frames):
        for pose in reader.read(frame(number, north_mm), 0.5 * n):
            assert pose.id == len(taken)
            assert pose.position_ned[0] == pytest.approx(1e-3 * north_mm)
            taken.append(number)
    assert taken == ids
    assert reader.status.dropped == dropped


@pytest.mark.real_time
@in_real_time
async def test_a_port_in_use_is_named_with_what_to_do() -> None:
    config = ViconConfig(object=OURS, listen=await free_address())
    first, second = config.build(), config.build()
    await first.start(lambda pose: None)
    with pytest.raises(OSError, match=r"cannot listen for Vicon poses on 127\.0\.0\.1:") as refused:
        await second.start(lambda pose: None)
    assert "holds this port, and `ss -lunp` names it: end it" in str(refused.value)
    await first.close()


def test_a_misspelt_name_shows_the_names_that_are_there() -> None:
    reader = ViconReader("mqX", Intake(0.0, frame_s=0.02))
    assert reader.read(VICON.readable[1].datagram, 0.0) == ()
    assert reader.names == ("wand", "mqx")


def test_text_on_the_port_is_told_as_perhaps_of_another_program() -> None:
    reader = ViconReader(OURS, Intake(0.0, frame_s=0.02))
    assert reader.read(b"hello world" * 20, 0.0) == ()
    (reason,) = reader.status.dropped
    assert "something else sends to this port" in str(describe_drop(reason))


def test_a_hidden_body_is_told_with_what_to_do_and_the_key_of_this_source() -> None:
    reader = ViconReader(OURS, Intake(0.0, frame_s=0.02))
    for number in (1, 2):
        reader.read(frame(number, 1.0), 0.02 * number)
    (reason,) = reader.status.dropped
    told = str(describe_drop(reason))
    assert "look for hidden markers; where the tracker rounds, pose.drop_frozen = false" in told
