"""Codecs on any bytes and values: MAVLink, RF modules, Vicon, simulator interfaces."""

import json
import math
import struct
from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.core.geometry import Vec3, so3
from groundstation.pose.sources import LocalPositionDecoder, OdometryDecoder
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.vicon_codec import (
    ViconObject,
    ViconReader,
    decode,
    encode,
    euler_xyz_from_quaternion,
    quaternion_from_euler_xyz,
)
from links.mavlink.protocol import AutopilotTexts, MavlinkCodec
from links.rf import CrsfLinkConfig, DsmLinkConfig
from links.rf.codec import RfCodec
from sim.autopilots import AUTOPILOTS, SimulatedAutopilot
from sim.autopilots.ardupilot import read_servos, write_state
from sim.autopilots.px4 import SimulatorCodec
from sim.world import TrueState
from tests.airframe_double import Brick
from tests.mavlink_table import FRAMES
from tests.pose_tables import OURS, VICON
from tests.rf_table import CODECS, ROWS, of_kind

frames = st.sampled_from([g.frame for g in FRAMES])


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    """A real frame with some bytes changed, cut out or put in."""
    frame = bytearray(draw(frames))
    for _ in range(draw(st.integers(0, 3))):
        at = draw(st.integers(0, len(frame)))
        frame[at : at + draw(st.integers(0, 4))] = draw(st.binary(max_size=4))
    return bytes(frame)


streams = st.lists(st.one_of(frames, damaged(), st.binary(max_size=60)), max_size=6).map(b"".join)


def told(messages: list[Any]) -> list[str]:
    return [repr((m.get_seq(), m.get_srcSystem(), str(m))) for m in messages]


@given(streams, st.lists(st.integers(0, 400), max_size=8))
def test_a_stream_cut_anywhere_reads_as_if_it_came_at_once(data: bytes, cuts: list[int]) -> None:
    whole, pieces, single = (MavlinkCodec(245, 190) for _ in range(3))
    expected = told(whole.feed(data))
    assert len(expected) == whole.received
    assert all(count > 0 for count in whole.dropped.values())
    edges = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    got = [m for a, b in zip(edges, edges[1:], strict=False) for m in pieces.feed(data[a:b])]
    assert told(got) == expected
    assert told([m for byte in data for m in single.feed(bytes([byte]))]) == expected
    assert whole.dropped == pieces.dropped == single.dropped


@given(st.lists(streams, max_size=20))
def test_the_reader_keeps_less_than_one_frame(chunks: list[bytes]) -> None:
    codec = MavlinkCodec(245, 190)
    for chunk in chunks:
        codec.feed(chunk)
        assert sum(map(len, codec._unfinished.values())) <= 293


@given(
    st.lists(frames, min_size=1, max_size=4),
    st.binary(max_size=20).filter(lambda b: not {0xFD, 0xFE} & set(b)),
)
def test_whole_frames_are_all_found_between_garbage(real: list[bytes], garbage: bytes) -> None:
    codec = MavlinkCodec(245, 190)
    assert len(codec.feed(garbage + garbage.join(real))) == len(real)
    assert codec.dropped["garbage"] == len(garbage) * len(real)


@given(st.lists(st.one_of(frames, damaged()), max_size=6), st.floats(0.0, 1e6))
def test_no_message_makes_a_pose_decoder_or_the_words_raise(
    datagrams: list[bytes], now_s: float
) -> None:
    codec, words = MavlinkCodec(245, 190), AutopilotTexts()
    decoders = (OdometryDecoder(0.0), LocalPositionDecoder(0.0))
    for data in datagrams:
        for message in codec.feed(data):
            if message.get_type() == "STATUSTEXT":
                words.take_message(message)
            for decoder in decoders:
                decoder.decode(message, now_s)


numbers = st.floats(width=32)


@pytest.mark.parametrize("make", AUTOPILOTS.values(), ids=AUTOPILOTS)
@given(
    requests=st.lists(
        st.one_of(
            st.tuples(st.sampled_from([21, 176, 400, 511, 16]), numbers, numbers, numbers),
            st.tuples(st.integers(0, 255), numbers, numbers, numbers, numbers),
            st.tuples(st.sampled_from(["GUID_OPTIONS", "COM_RCL_EXCEPT", "GUID_TIMEOUT"]), numbers),
        ),
        max_size=8,
    )
)
def test_no_command_and_no_set_point_makes_the_simulated_autopilot_raise(
    make: type[SimulatedAutopilot], requests: list[tuple[Any, ...]]
) -> None:
    sender = MavlinkCodec(245, 190)
    autopilot = make(Brick())
    autopilot.poll(0.0)
    # Whatever else is asked of it happens in the air.
    for number, mode in ((176, (1.0, 4.0)), (400, (1.0,))):
        autopilot.receive(sender.command(1, 1, number, *mode), 0.0)
    for n, (first, *rest) in enumerate(requests):
        if len(rest) == 1:
            frame = sender.parameter_set(1, 1, first, rest[0], 6) + sender.parameter_request(
                1, 1, first
            )
        elif len(rest) == 3:
            frame = sender.command(1, 1, first, *rest)
        else:
            message = sender.dialect.MAVLink_set_attitude_target_message(
                0, 1, 1, first, [rest[3]] * 4, *rest
            )
            frame = sender.pack(message)
        autopilot.receive(frame, 0.1 * n)
        autopilot.poll(0.1 * n)
        assert autopilot.next_due_s > 0.1 * n


# ---- RF modules

kind = pytest.mark.parametrize("kind", list(CODECS))
positions = st.lists(st.floats(-1.0, 1.0), min_size=16, max_size=16)
STEPS = {"dsm": 832, "crsf": 1639}
"""Counts from -1 to 1."""


def decoded(codec: RfCodec, frame: bytes) -> tuple[float, ...]:
    (heard,) = codec.decoder().feed(frame)
    assert heard.positions is not None
    return heard.positions


@kind
@given(positions)
def test_positions_come_back_within_half_a_count_and_are_written_again_to_the_last_bit(
    kind: str, positions: list[float]
) -> None:
    codec = CODECS[kind]
    frame = codec.encode(positions[: codec.channels])
    back = decoded(codec, frame)
    assert len(back) == codec.channels
    assert all(abs(a - b) <= 1.0001 / STEPS[kind] for a, b in zip(positions, back, strict=False))
    assert codec.encode(back) == frame


@given(
    st.lists(st.integers(0, 1023), min_size=6, max_size=6),
    st.integers(0, 1022),
    st.integers(1, 1023),
)
def test_every_dsm_count_is_reached_with_every_range(
    counts: list[int], low: int, span: int
) -> None:
    codec = DsmLinkConfig(low=low, high=min(low + span, 1023)).codec()
    raw = bytes((0x18, 0)) + b"".join(
        bytes((i << 2 | count >> 8, count & 255)) for i, count in enumerate(counts)
    )
    assert codec.encode(decoded(codec, raw)) == raw


@given(st.lists(st.integers(0, 1984), min_size=16, max_size=16))
def test_every_crsf_count_is_reached(counts: list[int]) -> None:
    codec = CrsfLinkConfig().codec()
    frame = codec.encode([(2 * count - 172 - 1811) / 1639 for count in counts])
    packed = int.from_bytes(frame[3:25], "little")
    assert [packed >> 11 * i & 2047 for i in range(16)] == counts


@kind
@given(st.data())
def test_a_damaged_frame_does_not_keep_the_next_ones_from_being_found(
    kind: str, draw: st.DataObject
) -> None:
    frames = [row.frame for row in of_kind(kind)]
    broken = bytearray(draw.draw(st.sampled_from(frames)))
    for at, value in draw.draw(
        st.lists(st.tuples(st.integers(0, 13), st.integers(0, 255)), min_size=1, max_size=4)
    ):
        broken[at % len(broken)] = value
    good = next(row for row in ROWS if row.codec is of_kind(kind)[0].codec)
    heard = CODECS[kind].decoder().feed(bytes(broken) + 4 * good.frame)
    assert good.positions in [h.positions for h in heard]


# ---- Vicon

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


# ---- simulator interfaces of PX4 and ArduPilot

vectors = st.tuples(*[st.floats(-1e4, 1e4)] * 3)
any_float = st.floats(width=32)


def frame(controls: list[float]) -> bytes:
    codec = MavlinkCodec(1, 1)
    return codec.pack(codec.dialect.MAVLink_hil_actuator_controls_message(4000, controls, 129, 1))


outputs = st.lists(any_float, min_size=16, max_size=16).map(frame)


@given(st.lists(st.one_of(outputs, st.binary(max_size=100)), max_size=5), st.integers(1, 50))
def test_no_bytes_from_px4_turn_a_rotor_beyond_its_limits(chunks: list[bytes], cut: int) -> None:
    codec, data = SimulatorCodec(), b"".join(chunks)
    for at in range(0, len(data), cut):
        for one in codec.feed(data[at : at + cut]):
            assert all(0.0 <= motor <= 1.0 for motor in one.motors)


@given(
    st.one_of(
        st.binary(max_size=80),
        st.binary(min_size=38, max_size=38).map(lambda tail: b"\x1a\x48" + tail),
    )
)
def test_no_packet_from_ardupilot_turns_a_rotor_beyond_its_limits(packet: bytes) -> None:
    servos = read_servos(packet)
    if servos is not None:
        assert all(0.0 <= motor <= 1.0 for motor in servos.motors)
        assert len(servos.pulses_us) == (32 if packet[:2] == (29569).to_bytes(2, "little") else 16)


@given(st.floats(0.0, 1e6), vectors, vectors, vectors, vectors)
def test_a_state_for_ardupilot_loses_nothing(
    time_s: float, position: Vec3, velocity: Vec3, rates: Vec3, force: Vec3
) -> None:
    state = TrueState(time_s, position, velocity, (1.0, 0.0, 0.0, 0.0), rates, 0.0, on_ground=False)
    line = write_state(time_s, state, force)
    assert line.count(b"\n") == 2
    read = json.loads(line)
    assert read["timestamp"] == time_s
    assert [tuple(read[key]) for key in ("position", "velocity")] == [position, velocity]
    assert [tuple(read["imu"][key]) for key in ("gyro", "accel_body")] == [rates, force]
