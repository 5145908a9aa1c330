"""links/mavlink/protocol/codec.py: bytes to messages, commands to frames."""

import math
import os
import struct
import subprocess
import sys

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from links.mavlink.protocol import ARM_DISARM, DO_SET_MODE, MOST_SENDERS, MavlinkCodec
from tests.mavlink_table import FRAMES, Golden, golden, same


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


def test_checksums_are_computed_by_fastcrc() -> None:
    # Without it pymavlink silently takes four times as long.
    assert mavlink.mcrf4xx is not None


def test_the_attitude_target_holds_thrust_and_rates_and_masks_the_attitude() -> None:
    frame = MavlinkCodec(245, 190).attitude_target(12.3456, 1, 1, 0.625, (0.5, -0.25, 3.0))
    message = read(frame)
    assert message.get_type() == "SET_ATTITUDE_TARGET"
    assert (message.get_srcSystem(), message.get_srcComponent()) == (245, 190)
    assert (message.target_system, message.target_component, message.type_mask) == (1, 1, 128)
    assert (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate) == (0.5, -0.25, 3.0)
    assert message.thrust == 0.625
    assert message.q == [1.0, 0.0, 0.0, 0.0]
    assert message.time_boot_ms == 12345


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


def test_a_clock_that_runs_for_months_still_fits_into_the_stamp() -> None:
    frame = MavlinkCodec(245, 190).attitude_target(5e6, 1, 1, 0.5, (0.0, 0.0, 0.0))
    assert read(frame).time_boot_ms == 5_000_000_000 % 2**32


def test_a_rate_beyond_32_bit_floats_is_an_error_and_no_frame() -> None:
    with pytest.raises(OverflowError):
        MavlinkCodec(245, 190).attitude_target(0.0, 1, 1, 0.5, (1e39, 0.0, 0.0))


def test_a_heartbeat_says_that_we_are_a_ground_station() -> None:
    message = read(MavlinkCodec(245, 190).heartbeat())
    assert (message.get_type(), message.type, message.autopilot, message.base_mode) == ("HEARTBEAT", 6, 8, 0)


def test_a_command_carries_its_parameters_and_its_repetition() -> None:
    message = read(MavlinkCodec(245, 190).command(1, 1, DO_SET_MODE, 1.0, 6.0, confirmation=2))
    assert message.get_type() == "COMMAND_LONG"
    assert (message.target_system, message.target_component, message.command) == (1, 1, 176)
    assert [getattr(message, f"param{n}") for n in range(1, 8)] == [1.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert message.confirmation == 2


def test_a_question_for_the_time_is_answered_with_it_and_our_own() -> None:
    codec = MavlinkCodec(245, 190)
    (question,) = codec.feed(golden("TIMESYNC").frame)
    answer = read(codec.timesync_reply(question, 1.25))
    assert (answer.get_type(), answer.tc1, answer.ts1) == ("TIMESYNC", 1_250_000_000, question.ts1)


def test_an_answer_at_time_zero_is_still_no_question() -> None:
    codec = MavlinkCodec(245, 190)
    (question,) = codec.feed(golden("TIMESYNC").frame)
    assert read(codec.timesync_reply(question, 0.0)).tc1 == 1


def test_frames_are_numbered_one_after_the_other_across_all_kinds() -> None:
    codec = MavlinkCodec(245, 190)
    frames = [
        codec.heartbeat(),
        codec.attitude_target(0.0, 1, 1, 0.5, (0.0, 0.0, 0.0)),
        codec.command(1, 1, ARM_DISARM, 1.0),
        codec.parameter_request(1, 1, "GUID_OPTIONS"),
        codec.attitude_target(0.0, 1, 1, 0.5, (0.0, 0.0, 0.0)),
    ]
    assert [read(frame).get_seq() for frame in frames] == [0, 1, 2, 3, 4]


def test_a_datagram_may_hold_several_frames() -> None:
    codec = MavlinkCodec(245, 190)
    messages = codec.feed(b"".join(g.frame for g in FRAMES))
    assert [message.get_type() for message in messages] == [g.message for g in FRAMES]
    assert codec.dropped == {}


def test_a_signed_frame_is_read_its_signature_ignored() -> None:
    sender = mavlink.MAVLink(None, 1, 1)
    sender.signing.secret_key = bytes(32)
    sender.signing.sign_outgoing = True
    frame = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(sender)
    codec = MavlinkCodec(245, 190)
    assert [m.get_type() for m in codec.feed(frame + golden("HEARTBEAT").frame)] == ["HEARTBEAT", "HEARTBEAT"]


def test_a_frame_of_mavlink_1_is_read() -> None:
    sender = mavlink.MAVLink(None, 1, 1)
    frame = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(sender, force_mavlink1=True)
    codec = MavlinkCodec(245, 190)
    assert [m.autopilot for m in codec.feed(frame)] == [12]


ODOMETRY = golden("ODOMETRY").frame
HEARTBEAT = golden("HEARTBEAT").frame
BROKEN = HEARTBEAT[:-1] + bytes([HEARTBEAT[-1] ^ 1])
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
        (UNKNOWN + HEARTBEAT, 1, {"unknown": 1}),
        (LATER_REVISION, 0, {"garbage": len(LATER_REVISION)}),
        (b"", 0, {}),
    ],
)
def test_a_bad_datagram_is_counted_by_reason(datagram: bytes, read_: int, dropped: dict[str, int]) -> None:
    codec = MavlinkCodec(245, 190)
    assert len(codec.feed(datagram, BRIDGE)) == read_
    assert codec.dropped == dropped


@pytest.mark.parametrize("piece", [ODOMETRY[:100], ODOMETRY[:2], b"\xfe", HEARTBEAT + ODOMETRY[:-1]])
def test_a_frame_whose_rest_does_not_come_is_counted_and_does_not_hold_up_the_next_datagram(piece: bytes) -> None:
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
def test_frames_that_a_bridge_cuts_over_datagrams_arrive_whole(block: int, first: int) -> None:
    codec = MavlinkCodec(245, 190)
    messages = [m for piece in cut_at(STREAM, block, first) for m in codec.feed(piece, BRIDGE)]
    assert [m.get_type() for m in messages] == [g.message for g in FRAMES]
    assert codec.dropped == {}


@pytest.mark.parametrize("cut", range(1, len(ODOMETRY)))
def test_a_frame_cut_at_any_byte_arrives_while_another_sender_speaks_between(cut: int) -> None:
    codec = MavlinkCodec(245, 190)
    assert codec.feed(ODOMETRY[:cut], BRIDGE) == []
    assert [m.get_type() for m in codec.feed(HEARTBEAT, OTHER)] == ["HEARTBEAT"]
    assert [m.get_type() for m in codec.feed(ODOMETRY[cut:], BRIDGE)] == ["ODOMETRY"]
    assert codec.dropped == {}


@pytest.mark.parametrize("stray", [b"\x00", b"\xfd", b"\xfd\x08\x00", b"radio:\xfe\x03ok"])
@pytest.mark.parametrize("cut", [1, 11, 100])
def test_stray_bytes_between_cut_frames_cost_none_of_the_frames_behind(stray: bytes, cut: int) -> None:
    codec = MavlinkCodec(245, 190)
    pieces = [ODOMETRY[:cut], ODOMETRY[cut:] + stray + ODOMETRY[:cut], ODOMETRY[cut:], HEARTBEAT]
    assert [m.get_type() for piece in pieces for m in codec.feed(piece, BRIDGE)] == [
        "ODOMETRY",
        "ODOMETRY",
        "HEARTBEAT",
    ]


def test_unfinished_frames_are_kept_of_so_many_senders_and_no_more() -> None:
    codec = MavlinkCodec(245, 190)
    for port in range(MOST_SENDERS + 1):
        codec.feed(HEARTBEAT[:10], ("192.168.1.7", port))
    assert codec.dropped == {"truncated": 1}
    assert codec.feed(HEARTBEAT[10:], ("192.168.1.7", 0)) == []
    assert len(codec.feed(HEARTBEAT[10:], ("192.168.1.7", 1))) == 1


def test_what_was_unfinished_is_forgotten_with_its_wire() -> None:
    codec = MavlinkCodec(245, 190)
    codec.feed(HEARTBEAT[:10])
    codec.forget()
    assert len(codec.feed(HEARTBEAT)) == 1
    assert codec.dropped == {}


def test_a_bad_checksum_is_refused_whatever_the_environment_says() -> None:
    # pymavlink accepts bad checksums where MAV_IGNORE_CRC is set.
    program = (
        "from links.mavlink.protocol import MavlinkCodec; codec = MavlinkCodec(245, 190); "
        f"assert codec.feed(bytes.fromhex('{BROKEN.hex()}')) == [], codec.dropped"
    )
    subprocess.run([sys.executable, "-c", program], env={**os.environ, "MAV_IGNORE_CRC": "1"}, check=True)


def test_the_dialect_is_imported_where_a_codec_is_made_and_not_before() -> None:
    program = (
        "import sys, links.mavlink.link, groundstation.settings, groundstation.pose.sources.mavlink; "
        "from links.mavlink.protocol import MavlinkCodec, frame_end; "
        "assert not [name for name in sys.modules if name.startswith('pymavlink')]"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_no_garbage_collection_looks_through_the_dialect() -> None:
    program = (
        "import gc, links.mavlink.link; from links.mavlink.protocol import MavlinkCodec; "
        "codec = MavlinkCodec(245, 190); assert gc.isenabled(); "
        "assert not any(one is codec.dialect.__dict__ for one in gc.get_objects())"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_number_that_does_not_fit_its_field_is_an_error_and_no_frame() -> None:
    codec = MavlinkCodec(3, 4)
    with pytest.raises(struct.error):
        codec.pack(codec.dialect.MAVLink_heartbeat_message(256, 0, 0, 0, 0, 3))
    assert read(codec.heartbeat()).get_seq() == 0


def test_a_payload_longer_than_the_definition_is_read_without_what_came_later() -> None:
    body = bytes([44, 0, 0, 7, 3, 4, 30, 0, 0]) + bytes(range(1, 45))
    frame = b"\xfd" + body + mavlink.mcrf4xx(body + bytes([mavlink.mavlink_map[30].crc_extra])).to_bytes(2, "little")
    (message,) = MavlinkCodec(3, 4).feed(frame)
    assert message.yawspeed == struct.unpack("<f", bytes(range(25, 29)))[0]


def test_in_a_stream_a_frame_behind_garbage_and_behind_a_false_start_is_found() -> None:
    codec = MavlinkCodec(245, 190)
    false_start = bytes([0xFD, 3, 0, 0, 0, 1, 1, 0, 0, 0])  # a header whose frame would end within the next one
    messages = codec.feed(b"garbage" + false_start + HEARTBEAT + BROKEN + HEARTBEAT)
    assert len(messages) == 2
    assert codec.dropped["bad_crc"] == 2
    assert codec.dropped["garbage"] == len(b"garbage") + len(false_start) - 1 + len(BROKEN) - 1


def test_a_result_is_told_in_words_with_mavlinks_own_name() -> None:
    codec = MavlinkCodec(245, 190)
    denied = "not allowed in its present state, or not with these values, MAV_RESULT_DENIED"
    assert codec.describe_result(2) == denied
    assert codec.describe_result(77) == "an answer that nobody here knows, MAV_RESULT 77"
    for result in mavlink.enums["MAV_RESULT"]:
        words = codec.describe_result(result)
        assert words.split(", MAV_RESULT")[0].replace(" ", "").replace(",", "").isalpha() or "COMMAND_" in words
        assert "ENUM_END" not in words


def test_nan_fields_survive() -> None:
    (message,) = MavlinkCodec(245, 190).feed(ODOMETRY)
    assert math.isnan(message.pose_covariance[1])
