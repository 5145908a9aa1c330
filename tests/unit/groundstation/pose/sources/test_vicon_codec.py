"""Vicon's bytes: the golden table, what of a stream is new, and what is told of a port in use."""

import math
import os

import pytest

from groundstation.core.geometry import Vec3, so3
from groundstation.pose.sources import ViconConfig
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.vicon_codec import (
    ViconObject,
    ViconReader,
    decode,
    encode,
    euler_xyz_from_quaternion,
    pose_of,
    quaternion_from_euler_xyz,
)
from tests.loops import free_address, in_real_time
from tests.vicon_table import OURS, TABLE, Dropped, Readable

readable = pytest.mark.parametrize("row", TABLE.readable, ids=lambda row: row.about)
dropped = pytest.mark.parametrize("row", TABLE.dropped, ids=lambda row: row.about)


@readable
def test_the_reader_finds_what_the_golden_datagram_says(row: Readable) -> None:
    assert decode(row.datagram) == (row.frame_number, row.objects)


@readable
def test_the_writer_gives_the_golden_datagram_byte_for_byte(row: Readable) -> None:
    assert encode(row.frame_number, row.objects, row.size) == row.datagram


@readable
def test_a_decoder_gives_its_own_object_in_metres_and_as_a_quaternion(row: Readable) -> None:
    (own,) = (item for item in row.objects if item.name == OURS)
    # The table's mqx is at (1234.5, -250.25, 1000) mm in every row.
    assert pose_of(own) == ((1.2345, -0.25025, 1.0), quaternion_from_euler_xyz((0.0625, -0.125, 1.5)))


@dropped
def test_a_datagram_of_no_use_is_counted_by_reason_and_dropped(row: Dropped) -> None:
    reader = ViconReader(OURS, Intake(0.0, frame_s=0.02))
    for count in (1, 2):
        assert reader.read(row.datagram, 0.0) == ()
        assert reader.status.dropped == {row.reason: count}


def frame(number: int, north_mm: float = 0.0) -> bytes:
    return encode(number, [ViconObject(OURS, (north_mm, -2000.0, 1000.0), (0.0, 0.0, -math.pi / 2.0))])


@pytest.mark.parametrize(
    ("frames", "ids", "dropped"),
    [
        (((10, 0.0), (11, 1.0), (11, 1.0), (10, 0.0), (13, 3.0), (12, 2.0)), [10, 11, 13],
         {"duplicate": 1, "out_of_order": 2}),
        (((5000, 0.0), (100, 9.0), (5001, 1.0), (101, 8.0)), [5000, 5001], {"out_of_order": 2}),  # two trackers at once
        (((1, 1.0), (2, 1.0), (3, 1.0), (4, math.nextafter(1.0, 2.0))), [1, 4], {"frozen": 2}),
    ],
    ids=["each frame counts once and never backwards", "only the one ahead", "the same to the last bit"],
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
    assert f"(process {os.getpid()}) holds this port: end it" in str(refused.value)
    await first.close()


def test_a_misspelt_name_shows_the_names_that_are_there() -> None:
    reader = ViconReader("mqX", Intake(0.0, frame_s=0.02))
    assert reader.read(TABLE.readable[1].datagram, 0.0) == ()
    assert reader.names == ("wand", "mqx")


# In the lab's z-up frame with the object's axes forward, left, up.
S, C = math.sin(math.radians(10.0)), math.cos(math.radians(10.0))
QUARTER = math.pi / 2.0


@pytest.mark.parametrize(
    ("rotation", "forward", "left"),
    [
        # Nose up is a left-handed turn about y, which points left.
        ((0.0, math.radians(-10.0), 0.0), (C, 0.0, S), (0.0, 1.0, 0.0)),
        # Rolled right lifts the left side.
        ((math.radians(10.0), 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, C, S)),
        # Turned left, seen from above.
        ((0.0, 0.0, math.radians(10.0)), (C, S, 0.0), (-S, C, 0.0)),
        # Two quarter turns tell the order: z acts first, so forward goes to y, and x then lifts y to z.
        ((QUARTER, 0.0, QUARTER), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
        # y acts before x: forward goes down to -z, and x then carries -z to y.
        ((QUARTER, QUARTER, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    ],
)
def test_the_angles_turn_the_object_the_way_they_should(rotation: Vec3, forward: Vec3, left: Vec3) -> None:
    attitude = quaternion_from_euler_xyz(rotation)
    assert so3.to_world(attitude, (1.0, 0.0, 0.0)) == pytest.approx(forward, abs=1e-15)
    assert so3.to_world(attitude, (0.0, 1.0, 0.0)) == pytest.approx(left, abs=1e-15)
    assert euler_xyz_from_quaternion(attitude) == pytest.approx(rotation, abs=1e-15) or abs(rotation[1]) == QUARTER
