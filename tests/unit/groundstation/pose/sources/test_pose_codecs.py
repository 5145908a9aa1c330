"""Readers and writers of the pose sources, on bytes that were put together by hand."""

import math
from collections.abc import Sequence

import msgspec
import pytest

from groundstation.core.geometry import Frames, Quat, so3
from groundstation.pose.sources import (
    Intake,
    NatNetReader,
    ViconConfig,
    VisionReader,
    describe_drop,
    mavlink_codec,
    natnet_codec,
    qualisys_codec,
)
from groundstation.pose.sources.natnet_codec import NatNetMessage
from groundstation.pose.sources.vicon_codec import (
    ViconObject,
    ViconReader,
    decode,
    encode,
    pose_of,
    quaternion_from_euler_xyz,
)
from links.mavlink.protocol import MavlinkCodec
from tests.loops import free_address, in_real_time
from tests.pose_tables import OURS, TABLES, VICON, Row, ViconDropped, ViconReadable, fresh_reader

ROWS = [
    pytest.param(name, row, id=f"{name}: {row.about}")
    for name, table in TABLES.items()
    for row in table.rows
]
NATNET = [name for name in TABLES if name.startswith("natnet")]
TURNED = so3.from_euler_zyx(0.0, 0.0, math.pi / 2.0)


def assert_same_turn(one: Quat, other: Quat) -> None:
    assert abs(sum(a * b for a, b in zip(one, other, strict=True))) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("name", "row"), ROWS)
def test_a_golden_datagram_makes_its_pose_or_is_dropped_for_its_reason(name: str, row: Row) -> None:
    reader = fresh_reader(name)
    poses = reader.read(row.datagram, 5.0)
    if row.pose is None:
        assert len(poses) == 0
        assert reader.status.accepted == 0
        if name == "vision":  # a stream: only the next datagram tells that this was no frame
            reader.read(TABLES[name].rows[0].datagram, 5.1)
            assert row.drop is not None
            assert reader.status.dropped[row.drop] == 1
        else:
            assert reader.status.dropped == {row.drop: 1}
    else:
        (pose,) = poses
        assert pose.position_ned == pytest.approx(row.pose.position_ned, abs=1e-6)
        assert_same_turn(pose.attitude, row.pose.attitude)
        assert (pose.id, pose.arrival_s) == (0, 5.0)
        assert reader.status.dropped == {}


@pytest.mark.parametrize("name", TABLES)
def test_every_cut_of_a_good_datagram_is_dropped(name: str) -> None:
    good = TABLES[name].rows[0].datagram
    for size in range(len(good)):
        reader = fresh_reader(name)
        assert not reader.read(good[:size], 5.0)
        assert len(reader.read(good, 5.1)) == 1
        assert sum(reader.status.dropped.values()) >= min(size, 1)


# ---- NatNet


@pytest.mark.parametrize("name", NATNET)
def test_natnets_writer_gives_the_golden_handshake_byte_for_byte(name: str) -> None:
    version = (3, 0) if name.endswith("3.0") else (4, 1)
    info = natnet_codec.ServerInfo("Motive", version, 10_000_000, 1511, False)
    models = natnet_codec.encode_models({"wand": 7, "quad": 2}, version)
    assert (natnet_codec.encode_server_info(info).hex(), models.hex()) == TABLES[name].prelude


def u32(number: int) -> bytes:
    return number.to_bytes(4, "little")


def test_descriptions_of_bodies_are_found_among_marker_sets_and_skeletons_with_markers() -> None:
    def described(name: bytes, number: int) -> bytes:
        place = bytes(4 + 12 + 16)  # parent, offset, quaternion
        return name + b"\0" + u32(number) + place + u32(2) + bytes(2 * 16) + b"m1\0m2\0"

    kinds = [
        (0, b"all\0" + u32(1) + b"m\0"),
        (1, described(b"quad", 3)),
        (2, b"Ann\0" + u32(1) + u32(1) + described(b"hip", 1)),
        (1, described(b"wand", 4)),
        (9, b"something new"),
        (1, described(b"behind it", 5)),
    ]
    payload = u32(len(kinds)) + b"".join(u32(kind) + u32(len(data)) + data for kind, data in kinds)
    found = natnet_codec.decode_models(payload, (4, 2))
    assert found == [("quad", 3), ("wand", 4), ("behind it", 5)]


def test_descriptions_that_do_not_tell_their_bytes_are_passed_over_by_their_parts() -> None:
    def described(name: bytes, number: int) -> bytes:
        return name + b"\0" + u32(number) + bytes(4 + 12) + bytes(4)  # parent, offset, no markers

    quad, hip, knee, wand = map(described, (b"quad", b"hip", b"knee", b"wand"), (3, 1, 2, 4))
    skeleton = u32(2) + b"Ann\0" + u32(1) + u32(2) + hip + knee
    payload = u32(3) + u32(1) + quad + skeleton + u32(1) + wand
    assert natnet_codec.decode_models(payload, (3, 0)) == [("quad", 3), ("wand", 4)]


def natnet_frame(*bodies: natnet_codec.RigidBody, **told: bool) -> bytes:
    frame = natnet_codec.NatNetFrame(78, bodies, 10_000_100_000, 10_000_150_000)
    return natnet_codec.encode_frame(msgspec.structs.replace(frame, **told), (4, 1))


def motive(*rows: int, heard: int = 2, **keys: bool) -> NatNetReader:
    """A reader after ``heard`` messages of the handshake, and these rows of the golden table."""
    reader, table = NatNetReader("quad", Intake(0.0), **keys), TABLES["natnet 4.1"]
    handshake = map(bytes.fromhex, table.prelude[:heard])
    for datagram in (*handshake, *(table.rows[row].datagram for row in rows)):
        reader.read(datagram, 0.0)
    return reader


QUAD = natnet_codec.RigidBody(2, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def test_a_frame_of_edit_mode_or_playback_is_never_flown_and_the_server_is_asked_again() -> None:
    reader = motive(0)
    reader.due()
    assert reader.read(natnet_frame(QUAD, live=False), 0.01) == ()
    assert reader.status.dropped == {"not_live": 1}
    assert NatNetMessage.CONNECT in ids(reader.due())


def test_a_changed_bit_stream_has_the_descriptions_asked_for_again() -> None:
    reader = motive(0)
    assert len(reader.read(natnet_frame(QUAD, bitstream_changed=True), 0.01)) == 1
    reader.read(natnet_frame(QUAD), 0.02)
    asks = [NatNetMessage.CONNECT, NatNetMessage.REQUEST_MODELDEF, NatNetMessage.KEEPALIVE]
    assert ids(reader.due()) == asks
    reader.read(bytes.fromhex(TABLES["natnet 4.1"].prelude[0]), 0.03)
    assert ids(reader.due()) == asks[1:]


def test_a_server_with_an_older_bit_stream_is_not_read_and_the_operator_told_what_to_set() -> None:
    reader = NatNetReader("quad", Intake(0.0))
    old = natnet_codec.ServerInfo("Motive", (2, 10), 10_000_000)
    reader.read(natnet_codec.encode_server_info(old), 0.0)
    assert reader.status.dropped == {"wrong_version": 1}
    assert "bit stream version" in str(describe_drop("wrong_version"))
    assert ids(reader.due()) == [NatNetMessage.CONNECT]


def ids(messages: Sequence[bytes]) -> list[int]:
    return [natnet_codec.split(message)[0] for message in messages]


def test_a_client_connects_then_asks_for_names_then_keeps_alive() -> None:
    silent, reader = motive(heard=0), motive()
    assert silent.due() == silent.due() == [bytes.fromhex("0000 0500") + b"Ping\0"]
    assert ids(motive(heard=1).due()) == [NatNetMessage.REQUEST_MODELDEF, NatNetMessage.KEEPALIVE]
    assert reader.names == ("wand", "quad")
    assert ids(reader.due()) == [NatNetMessage.KEEPALIVE]


def test_names_are_asked_for_again_where_the_models_change_and_poses_go_on() -> None:
    reader = motive(0, keep_alive=False)
    frame = natnet_frame(QUAD, models_changed=True)
    assert len(reader.read(frame, 0.01)) == 1
    assert ids(reader.due()) == [NatNetMessage.REQUEST_MODELDEF]
    assert ids(reader.due()) == [NatNetMessage.REQUEST_MODELDEF]
    reader.read(natnet_codec.encode_models({"quad": 3}, (4, 1)), 0.02)
    assert reader.due() == []
    assert reader.read(frame, 0.03) == ()
    assert reader.status.dropped == {"no_such_body": 1}


def test_a_pose_is_as_old_as_motive_says_and_the_networks_least_on_top() -> None:
    reader = NatNetReader("quad", Intake(0.001, Frames("nue", "fur")))
    for datagram in TABLES["natnet 4.1"].prelude:
        reader.read(bytes.fromhex(datagram), 0.0)
    (pose,) = reader.read(TABLES["natnet 4.1"].rows[0].datagram, 5.0)
    assert pose.time_s == pytest.approx(5.0 - 0.005 - 0.001, abs=1e-9)
    assert reader.status.latency_s == pytest.approx(0.006, abs=1e-9)


# ---- Qualisys


def test_qtms_own_package_reads_what_our_writer_writes() -> None:
    from qtm_rt.packet import QRTPacket

    attitude = so3.from_euler_zyx(0.1, -0.2, 0.3)
    packet = qualisys_codec.encode_data(1_234_567, 9, [((1.0, -2.0, 3.0), attitude), None])
    assert int.from_bytes(packet[:4], "little") == len(packet)
    read = QRTPacket(packet[8:])
    info, bodies = read.get_6d()
    assert (read.timestamp, read.framenumber, info.body_count) == (1_234_567, 9, 2)
    position, rotation = bodies[0]
    assert tuple(position) == (1000.0, -2000.0, 3000.0)
    columns = [number for column in zip(*so3.matrix(attitude), strict=True) for number in column]
    assert rotation.matrix == pytest.approx(columns, abs=1e-7)
    assert all(map(math.isnan, bodies[1][0]))


ENTITY = b'<!DOCTYPE x [<!ENTITY a "b">]><x>&a;</x>'


@pytest.mark.parametrize("xml", [b"", b"<a>", b"hello", b"\xff\xfe", ENTITY, b"x" * (1 << 21)])
def test_parameters_that_are_no_plain_xml_are_refused_in_words(xml: bytes) -> None:
    with pytest.raises(ValueError, match="the parameters are"):
        qualisys_codec.body_names(xml)


@pytest.mark.parametrize("header", [(0, 1), (7, 3), (1 << 31, 3), (20, 77)])
def test_a_size_or_a_type_that_no_packet_has_breaks_the_stream(header: tuple[int, int]) -> None:
    framer, good = qualisys_codec.Framer(), qualisys_codec.encode_data(1, 1, [None])
    assert framer.feed(good + b"".join(n.to_bytes(4, "little") for n in header)) == [good]
    assert framer.broken
    assert framer.feed(good) == []


# ---- JSON, vision


def test_visions_writer_gives_the_golden_frame_byte_for_byte() -> None:
    vision = mavlink_codec.VisionEstimate(1000.5, (0.5, 2.0, -1.0), TURNED)
    written = mavlink_codec.encode_vision(MavlinkCodec(1, 197), vision)
    assert written == TABLES["vision"].rows[0].datagram
    (read,) = VisionReader(Intake(0.0)).read(written, 1.0)
    assert read.position_ned == (0.5, 2.0, -1.0)


def test_another_system_or_component_is_not_believed_where_one_is_named() -> None:
    datagram = TABLES["vision"].rows[0].datagram
    (message,) = MavlinkCodec(255, 190).feed(datagram)
    own = message.get_srcComponent()
    assert len(VisionReader(Intake(0.0), component_id=own).read(datagram, 1.0)) == 1
    for reader, reason in (
        (VisionReader(Intake(0.0), system_id=2), "other_system"),
        (VisionReader(Intake(0.0), component_id=own % 255 + 1), "other_component"),
    ):
        assert not reader.read(datagram, 1.0)
        assert reader.status.dropped == {reason: 1}


# ---- Vicon

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
