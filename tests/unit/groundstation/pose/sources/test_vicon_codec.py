import math
import struct

import pytest

from groundstation.core.geometry import Vec3, so3
from groundstation.pose.sources.vicon_codec import (
    ViconDecoder,
    ViconFrame,
    ViconObject,
    ViconPose,
    decode,
    encode,
    euler_xyz_from_quaternion,
    quaternion_from_euler_xyz,
)
from tests.vicon_table import OURS, TABLE, Dropped, Readable

readable = pytest.mark.parametrize("row", TABLE.readable, ids=lambda row: row.about)
dropped = pytest.mark.parametrize("row", TABLE.dropped, ids=lambda row: row.about)


@readable
def test_the_reader_finds_what_the_golden_datagram_says(row: Readable) -> None:
    assert decode(row.datagram) == ViconFrame(row.frame_number, row.objects)


@readable
def test_the_writer_gives_the_golden_datagram_byte_for_byte(row: Readable) -> None:
    assert encode(row.frame_number, row.objects, row.size) == row.datagram


def test_the_golden_bytes_lie_at_the_documented_offsets() -> None:
    row = TABLE.readable[1]
    first, second = row.objects
    data = row.datagram
    assert struct.unpack_from("<I", data, 0) == (row.frame_number,)
    assert data[4] == 2
    assert data[5] == 0
    assert struct.unpack_from("<H", data, 6) == (72,)
    assert data[8:32] == first.name.encode().ljust(24, b"\0")
    assert struct.unpack_from("<3d", data, 32) == first.translation_mm
    assert struct.unpack_from("<3d", data, 56) == first.rotation_rad
    assert data[80] == 0
    assert data[83:107] == second.name.encode().ljust(24, b"\0")
    assert struct.unpack_from("<3d", data, 107) == second.translation_mm


@readable
def test_a_decoder_gives_its_own_object_in_metres_and_as_a_quaternion(row: Readable) -> None:
    decoder = ViconDecoder(OURS)
    pose = decoder.decode(row.datagram)
    assert isinstance(pose, ViconPose)
    assert pose.frame_number == row.frame_number
    # The table's mqx stands at (1234.5, -250.25, 1000) mm in every row.
    assert pose.position_m == (1.2345, -0.25025, 1.0)
    assert pose.attitude == quaternion_from_euler_xyz((0.0625, -0.125, 1.5))
    assert not decoder.dropped


@dropped
def test_a_datagram_of_no_use_is_counted_by_reason_and_dropped(row: Dropped) -> None:
    decoder = ViconDecoder(OURS)
    assert decoder.decode(row.datagram) is None
    assert decoder.dropped == {row.reason: 1}
    assert decoder.decode(row.datagram) is None
    assert decoder.dropped == {row.reason: 2}


def test_every_cut_of_a_full_datagram_is_truncated() -> None:
    full = TABLE.readable[2].datagram
    decoder = ViconDecoder(OURS)
    needed = 5 + 3 * 75
    for size in range(needed):
        assert decoder.decode(full[:size]) is None
    assert decoder.dropped == {"truncated": needed}
    assert decoder.decode(full[:needed]) is not None


def test_another_object_full_of_nan_does_not_cost_us_ours() -> None:
    nan = (math.nan, math.nan, math.nan)
    ours = ViconObject(OURS, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
    assert ViconDecoder(OURS).decode(encode(1, [ViconObject("hidden", nan, nan), ours])) is not None


def test_a_misspelt_name_shows_the_names_that_are_there() -> None:
    decoder = ViconDecoder("mqX")
    assert decoder.decode(TABLE.readable[1].datagram) is None
    assert decoder.names == ("wand", "mqx")


def test_bytes_after_the_nul_of_a_name_do_not_matter() -> None:
    datagram = bytearray(TABLE.readable[0].datagram)
    datagram[8:32] = b"mqx\0rest of an older name"[:24]
    assert ViconDecoder(OURS).decode(bytes(datagram)) is not None


@pytest.mark.parametrize("name", ["", "x" * 25, "é" * 13, "a\0b"])
def test_a_name_that_no_object_can_have_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="1 to 24 bytes"):
        ViconDecoder(name)


def test_the_writer_refuses_what_does_not_fit() -> None:
    item = TABLE.readable[0].objects[0]
    with pytest.raises(ValueError, match="4 Vicon objects do not fit into 256 bytes"):
        encode(1, [item] * 4)
    with pytest.raises(ValueError, match=r"expected one of \[256, 512, 1024\], got 300"):
        encode(1, [item], 300)


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
