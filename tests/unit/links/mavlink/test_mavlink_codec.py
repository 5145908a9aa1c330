"""links/mavlink/protocol/codec.py: bytes to messages, commands to frames."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from links.mavlink.protocol import ARM_DISARM, DO_SET_MODE, MavlinkCodec
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
    (message,) = codec.feed_datagram(g.frame)
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
    (question,) = codec.feed_datagram(golden("TIMESYNC").frame)
    answer = read(codec.timesync_reply(question, 1.25))
    assert (answer.get_type(), answer.tc1, answer.ts1) == ("TIMESYNC", 1_250_000_000, question.ts1)


def test_an_answer_at_time_zero_is_still_no_question() -> None:
    codec = MavlinkCodec(245, 190)
    (question,) = codec.feed_datagram(golden("TIMESYNC").frame)
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
    messages = codec.feed_datagram(b"".join(g.frame for g in FRAMES))
    assert [message.get_type() for message in messages] == [g.message for g in FRAMES]
    assert codec.dropped == {}


def test_a_signed_frame_is_read_its_signature_ignored() -> None:
    sender = mavlink.MAVLink(None, 1, 1)
    sender.signing.secret_key = bytes(32)
    sender.signing.sign_outgoing = True
    frame = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3).pack(sender)
    codec = MavlinkCodec(245, 190)
    assert [m.get_type() for m in codec.feed_datagram(frame + golden("HEARTBEAT").frame)] == ["HEARTBEAT", "HEARTBEAT"]


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


@pytest.mark.parametrize(
    ("datagram", "read_", "dropped"),
    [
        (ODOMETRY[:100], 0, {"truncated": 1}),
        (ODOMETRY[:2], 0, {"truncated": 1}),
        (b"\xfe", 0, {"truncated": 1}),
        (HEARTBEAT + ODOMETRY[:-1], 1, {"truncated": 1}),
        (b"hello", 0, {"garbage": 5}),
        (b"\x00" + HEARTBEAT, 0, {"garbage": 1 + len(HEARTBEAT)}),
        (BROKEN, 0, {"bad_crc": 1}),
        (BROKEN + HEARTBEAT, 1, {"bad_crc": 1}),
        (UNKNOWN + HEARTBEAT, 1, {"unknown": 1}),
        (LATER_REVISION, 0, {"garbage": len(LATER_REVISION)}),
        (b"", 0, {}),
    ],
)
def test_a_bad_datagram_is_counted_by_reason(datagram: bytes, read_: int, dropped: dict[str, int]) -> None:
    codec = MavlinkCodec(245, 190)
    assert len(codec.feed_datagram(datagram)) == read_
    assert codec.dropped == dropped


def test_a_truncated_datagram_does_not_hold_up_the_next() -> None:
    codec = MavlinkCodec(245, 190)
    codec.feed_datagram(ODOMETRY[:20])
    assert len(codec.feed_datagram(HEARTBEAT)) == 1


def test_in_a_stream_a_frame_behind_garbage_and_behind_a_false_start_is_found() -> None:
    codec = MavlinkCodec(245, 190)
    false_start = bytes([0xFD, 3, 0, 0, 0, 1, 1, 0, 0, 0])  # a header whose frame would end within the next one
    messages = codec.feed(b"garbage" + false_start + HEARTBEAT + BROKEN + HEARTBEAT)
    assert len(messages) == 2
    assert codec.dropped["bad_crc"] == 2
    assert codec.dropped["garbage"] == len(b"garbage") + len(false_start) - 1 + len(BROKEN) - 1


def test_the_name_of_a_result_is_mavlinks_own() -> None:
    codec = MavlinkCodec(245, 190)
    assert codec.result_name(2) == "MAV_RESULT_DENIED"
    assert codec.result_name(77) == "MAV_RESULT 77"


def test_nan_fields_survive() -> None:
    (message,) = MavlinkCodec(245, 190).feed_datagram(ODOMETRY)
    assert math.isnan(message.pose_covariance[1])
