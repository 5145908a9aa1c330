"""links/mavlink/protocol/codec.py: bytes to messages, commands to frames."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from links.mavlink.protocol import MavCommand, MavlinkCodec
from tests.mavlink_table import FRAMES, Golden, golden, same

# By their numbers: a limit that the test took from the code would bear out any value.
MOST_SENDERS = 16


def ids(g: Golden) -> str:
    return f"{g.message} {g.sequence} from {g.sender}"


def read(frame: bytes) -> mavlink.MAVLink_message:
    """By pymavlink's own stream parser, the independent reader."""
    (message,) = mavlink.MAVLink(None).parse_buffer(frame)
    return message


@pytest.mark.parametrize("g", FRAMES, ids=ids)
def test_a_frame_of_a_real_autopilot_is_read_to_the_last_number(g: Golden) -> None:
    codec = MavlinkCodec(245, 190)
    (message,) = codec.feed(g.frame)
    assert message.get_type() == g.message
    assert (message.get_srcSystem(), message.get_srcComponent()) == (g.system, g.component)
    for name, value in g.fields.items():
        assert same(getattr(message, name), value), name
    assert (codec.received, codec.dropped) == (1, {})


def test_the_attitude_target_equals_pymavlinks_own_byte_for_byte() -> None:
    codec = MavlinkCodec(245, 190)
    peer = mavlink.MAVLink(None, 245, 190)
    for n in range(600):  # the sequence number wraps at 256
        rates = (0.1 * n, -0.2, 0.3)
        ours = codec.attitude_target(100.0 * n, 7, 2, n / 600, rates)
        theirs = mavlink.MAVLink_set_attitude_target_message(
            int(1e5 * n) & 0xFFFFFFFF, 7, 2, 128, (1.0, 0.0, 0.0, 0.0), *rates, n / 600
        ).pack(peer)
        peer.seq = (peer.seq + 1) % 256
        assert ours == theirs


def test_the_attitude_target_has_these_bytes() -> None:
    assert MavlinkCodec(245, 190).attitude_target(1.5, 1, 1, 0.5, (0.1, 0.2, 0.3)).hex() == (
        "fd27000000f5be520000dc0500000000803f000000000000000000000000cdcccc3dcdcc4c3e9a99993e0000003f010180b176"
    )


def test_our_heartbeat_is_an_active_ground_stations() -> None:
    (beat,) = MavlinkCodec(1, 1).feed(MavlinkCodec(245, 190).heartbeat())
    # MAV_TYPE_GCS, MAV_AUTOPILOT_INVALID, no mode, MAV_STATE_ACTIVE, MAVLink 2.0
    assert (beat.type, beat.autopilot, beat.base_mode, beat.custom_mode) == (6, 8, 0, 0)
    assert (beat.system_status, beat.mavlink_version) == (4, 3)


def test_frames_are_numbered_one_after_the_other_across_all_kinds() -> None:
    codec = MavlinkCodec(245, 190)
    frames = [
        codec.heartbeat(),
        codec.attitude_target(0.0, 1, 1, 0.5, (0.0, 0.0, 0.0)),
        codec.command(1, 1, MavCommand.ARM_DISARM, 1.0),
        codec.parameter_request(1, 1, "GUID_OPTIONS"),
        codec.attitude_target(0.0, 1, 1, 0.5, (0.0, 0.0, 0.0)),
    ]
    assert [read(frame).get_seq() for frame in frames] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("signed", "form"), [(True, {}), (False, {"force_mavlink1": True})])
def test_a_signed_frame_is_read_its_signature_ignored_and_one_of_mavlink_1(
    signed: bool, form: dict[str, bool]
) -> None:
    sender = mavlink.MAVLink(None, 1, 1)
    sender.signing.secret_key = bytes(32)
    sender.signing.sign_outgoing = signed
    frame = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(sender, **form)
    told = MavlinkCodec(245, 190).feed(frame + golden("HEARTBEAT").frame)
    assert [(m.get_type(), m.autopilot) for m in told] == [("HEARTBEAT", 12)] * 2


ODOMETRY = golden("ODOMETRY").frame
HEARTBEAT = golden("HEARTBEAT").frame
BROKEN = HEARTBEAT[:-1] + bytes([HEARTBEAT[-1] ^ 1])
FALSE_START = bytes([0xFD, 3, 0, 0, 0, 1, 1, 0, 0, 0])
UNKNOWN = bytes.fromhex("fd010000000101ffff00000000")  # message 65535
LATER_REVISION = bytes.fromhex("fd010200000101000000000000")  # an incompatible flag
BRIDGE, OTHER = ("192.168.1.7", 14550), ("192.168.1.8", 14550)


@pytest.mark.parametrize(
    ("datagram", "read_", "dropped"),
    [
        (b"hello", 0, {"garbage": 5}),
        (b"\x00" + HEARTBEAT, 1, {"garbage": 1}),
        (BROKEN, 0, {"bad_crc": 1, "garbage": len(BROKEN) - 1}),
        (BROKEN + HEARTBEAT, 1, {"bad_crc": 1, "garbage": len(BROKEN) - 1}),
        # A header whose frame would end within the next one.
        (FALSE_START + HEARTBEAT, 1, {"bad_crc": 1, "garbage": len(FALSE_START) - 1}),
        (UNKNOWN + HEARTBEAT, 1, {"unknown": 1}),
        (LATER_REVISION, 0, {"garbage": len(LATER_REVISION)}),
        (b"", 0, {}),
    ],
)
def test_a_bad_datagram_is_counted_by_reason(
    datagram: bytes, read_: int, dropped: dict[str, int]
) -> None:
    codec = MavlinkCodec(245, 190)
    assert len(codec.feed(datagram, BRIDGE)) == read_
    assert codec.dropped == dropped


@pytest.mark.parametrize(
    "piece", [ODOMETRY[:100], ODOMETRY[:2], b"\xfe", HEARTBEAT + ODOMETRY[:-1]]
)
def test_a_frame_whose_rest_does_not_come_is_counted_and_does_not_hold_up_the_next_datagram(
    piece: bytes,
) -> None:
    codec = MavlinkCodec(245, 190)
    before = len(codec.feed(piece, BRIDGE))
    assert codec.dropped == {}  # the rest may be on its way
    assert len(codec.feed(HEARTBEAT, BRIDGE)) == 1
    assert codec.dropped == {"truncated": 1}
    assert codec.received == before + 1


def cut_at(stream: bytes, every: int, first: int) -> list[bytes]:
    """``stream`` in pieces: ``first`` bytes, then ``every`` bytes each."""
    edges = [0, *range(first, len(stream), every), len(stream)]
    return [stream[a:b] for a, b in zip(edges, edges[1:], strict=False) if a < b]


STREAM = b"".join(g.frame for g in FRAMES)


@pytest.mark.parametrize("block", [1, 7, 16, 20, 64, 128, 200])
@pytest.mark.parametrize("first", [0, 1, 5])
def test_frames_that_a_bridge_cuts_arrive_whole_while_another_sender_speaks_between(
    block: int, first: int
) -> None:
    codec = MavlinkCodec(245, 190)
    read = []
    for piece in cut_at(STREAM, block, first):
        read += [m.get_type() for m in codec.feed(piece, BRIDGE)]
        assert [m.get_type() for m in codec.feed(HEARTBEAT, OTHER)] == ["HEARTBEAT"]
    assert read == [g.message for g in FRAMES]
    assert codec.dropped == {}


@pytest.mark.parametrize("stray", [b"\x00", b"\xfd", b"\xfd\x08\x00", b"radio:\xfe\x03ok"])
@pytest.mark.parametrize("cut", [1, 11, 100])
def test_stray_bytes_between_cut_frames_cost_none_of_the_frames_behind(
    stray: bytes, cut: int
) -> None:
    codec = MavlinkCodec(245, 190)
    pieces = [ODOMETRY[:cut], ODOMETRY[cut:] + stray + ODOMETRY[:cut], ODOMETRY[cut:], HEARTBEAT]
    read = [m.get_type() for piece in pieces for m in codec.feed(piece, BRIDGE)]
    assert read == ["ODOMETRY", "ODOMETRY", "HEARTBEAT"]


def test_unfinished_frames_are_kept_of_so_many_senders_and_no_more() -> None:
    codec = MavlinkCodec(245, 190)
    for port in range(MOST_SENDERS + 1):
        codec.feed(HEARTBEAT[:10], ("192.168.1.7", port))
    assert codec.dropped == {"truncated": 1}
    assert codec.feed(HEARTBEAT[10:], ("192.168.1.7", 0)) == []
    assert len(codec.feed(HEARTBEAT[10:], ("192.168.1.7", 1))) == 1


def test_a_bad_checksum_is_refused_whatever_the_environment_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # As pymavlink does where MAV_IGNORE_CRC is set.
    monkeypatch.setattr(mavlink, "MAVLINK_IGNORE_CRC", 1)
    codec = MavlinkCodec(245, 190)
    assert codec.feed(BROKEN) == []
    assert codec.dropped["bad_crc"] == 1


def test_a_result_is_told_in_words_with_mavlinks_own_name() -> None:
    codec = MavlinkCodec(245, 190)
    denied = "not allowed in its present state, or not with these values, MAV_RESULT_DENIED"
    assert codec.describe_result(2) == denied
    assert codec.describe_result(77) == "an answer that nobody here knows, MAV_RESULT 77"
    assert not any("ENUM_END" in codec.describe_result(n) for n in mavlink.enums["MAV_RESULT"])
