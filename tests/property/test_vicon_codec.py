import math
import struct

from hypothesis import given, strategies as st

from groundstation.core.geometry import so3
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.vicon_codec import (
    ViconObject,
    ViconReader,
    decode,
    encode,
    euler_xyz_from_quaternion,
    quaternion_from_euler_xyz,
)
from tests.pose_tables import OURS, VICON

any_double = (
    st.binary(min_size=8, max_size=8).map(lambda bits: float(struct.unpack("<d", bits)[0]))
    | st.floats()
)
any_name = st.text(
    st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=24
).filter(lambda name: len(name.encode()) <= 24)
any_object = st.builds(
    ViconObject,
    any_name,
    st.tuples(any_double, any_double, any_double),
    st.tuples(any_double, any_double, any_double),
)
angle = st.floats(-math.pi, math.pi)
golden = st.sampled_from([row.datagram for row in VICON.readable + VICON.dropped])


def packed(item: ViconObject) -> tuple[str, bytes]:
    return item.name, struct.pack("<6d", *item.translation_mm, *item.rotation_rad)


@given(st.integers(0, 2**32 - 1), st.lists(any_object, max_size=13))
def test_every_double_survives_the_wire_to_the_last_bit(
    frame_number: int, objects: list[ViconObject]
) -> None:
    frame = decode(encode(frame_number, objects, 1024))
    assert not isinstance(frame, str)
    number, read = frame
    assert (number, list(map(packed, read))) == (frame_number, list(map(packed, objects)))


def assert_counted_or_sound(datagram: bytes) -> None:
    reader = ViconReader(OURS, Intake(0.0, frame_s=0.02), drop_frozen=False)
    poses = reader.read(datagram, 0.0)
    assert len(poses) + sum(reader.status.dropped.values()) == 1
    for pose in poses:
        assert all(abs(x) <= 1000.0 for x in pose.position_ned)
        assert math.isclose(math.hypot(*pose.attitude), 1.0, abs_tol=1e-14)


@given(
    golden,
    st.lists(st.tuples(st.integers(0, 1100), st.integers(0, 255)), max_size=8),
    st.integers(0, 1100),
)
def test_a_damaged_datagram_is_dropped_or_still_sound(
    datagram: bytes, damage: list[tuple[int, int]], size: int
) -> None:
    damaged = bytearray(datagram)
    for place, value in damage:
        if place < len(damaged):
            damaged[place] = value
    assert_counted_or_sound(bytes(damaged[:size]))


@given(angle, angle, angle)
def test_the_rotation_is_the_product_of_three_turns_about_x_then_new_y_then_new_z(
    rx: float, ry: float, rz: float
) -> None:
    sx, sy, sz = map(math.sin, (rx, ry, rz))
    cx, cy, cz = map(math.cos, (rx, ry, rz))
    x = so3.from_matrix(((1.0, 0.0, 0.0), (0.0, cx, -sx), (0.0, sx, cx)))
    y = so3.from_matrix(((cy, 0.0, sy), (0.0, 1.0, 0.0), (-sy, 0.0, cy)))
    z = so3.from_matrix(((cz, -sz, 0.0), (sz, cz, 0.0), (0.0, 0.0, 1.0)))
    expected = so3.multiply(x, so3.multiply(y, z))
    got = quaternion_from_euler_xyz((rx, ry, rz))
    alike = sum(one * other for one, other in zip(got, expected, strict=True))
    assert math.isclose(abs(alike), 1.0, abs_tol=1e-14)


@given(
    angle,
    st.one_of(angle, st.sampled_from([math.pi / 2, -math.pi / 2, 1.5707963, -1.5707963])),
    angle,
)
def test_a_quaternion_survives_its_angles_even_where_y_is_a_quarter_turn(
    rx: float, ry: float, rz: float
) -> None:
    attitude = quaternion_from_euler_xyz((rx, ry, rz))
    angles = euler_xyz_from_quaternion(attitude)
    assert abs(angles[0]) <= math.pi
    assert abs(angles[1]) <= math.pi / 2
    assert abs(angles[2]) <= math.pi
    back = quaternion_from_euler_xyz(angles)
    turn = so3.rotation_vector(so3.multiply(so3.conjugate(attitude), back))
    assert math.hypot(*turn) < 1e-14
