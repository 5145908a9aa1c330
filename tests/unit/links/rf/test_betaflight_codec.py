"""Frames of MSP and answers of the command line of a Betaflight board, byte for byte."""

import pytest
from hypothesis import given, strategies as st

from links.rf import (
    CrsfLinkConfig,
    MspReader,
    describe_change,
    describe_pulses,
    encode_request,
    find_settings,
    is_armed,
)
from links.rf.betaflight_codec import MspAnswer, MspCommand, find_refusal
from links.rf.channel_map import ArmSwitch, ChannelMap, Stick, Throttle

ARMED = bytes.fromhex("7d00000021000100000000")
MSP = [
    (b"$M<\x00\x02\x02", 2, b"", None),
    (b"$M>\x04\x02BTFL\x1a", 2, b"BTFL", True),
    (b"$M>\x03\x03\x04\x06\x00\x02", 3, bytes((4, 6, 0)), True),
    (b"$M>\x0b\x65" + ARMED + b"\x33", MspCommand.STATUS, ARMED, True),
    (b"$M!\x00\xff\xff", 255, b"", False),
]
"""Frame by the document, command, payload, whether the board knows it; None of a frame of ours."""


@pytest.mark.parametrize(("frame", "command", "payload", "known"), MSP)
def test_frames_of_msp_are_written_and_read_as_their_document_says(
    frame: bytes, command: int, payload: bytes, known: bool | None
) -> None:
    assert encode_request(command, payload)[3:] == frame[3:]
    reader = MspReader()
    heard = reader.feed(b"x$M" + frame) + reader.feed(b"$M>\x00\x02\x03" + frame)
    assert heard == ([] if known is None else [MspAnswer(command, payload, known)] * 2)
    assert reader.dropped["not_a_frame"] >= 3
    assert reader.dropped["bad_checksum"] == 1


def test_a_status_tells_whether_it_is_armed_and_a_short_one_does_not() -> None:
    assert is_armed(ARMED)
    assert not is_armed(bytes.fromhex("7d00000021000600000000"))
    with pytest.raises(ValueError, match="at least 10 bytes"):
        is_armed(bytes(9))


@given(st.text("abdfilmnprxgeu _=#.-0123456789\r\n", max_size=120))
def test_whatever_a_command_line_says_what_is_found_can_be_said_again(said: str) -> None:
    for name, value in find_settings(said).items():
        assert name in describe_change(name, value)


def test_settings_are_found_in_what_the_command_line_says() -> None:
    said = (
        "get rates_type\r\nrates_type = ACTUAL\r\nAllowed values: BETAFLIGHT, RACEFLIGHT, KISS, "
        "ACTUAL, QUICK\r\nDefault value: BETAFLIGHT\r\naux 3 1 0 900 2100 0 0\r\nrxrange 2 988 "
        "2012\r\nmap AETR1234\r\n\r\nrxfail 3 a\r\nrxfail 4 s 1000\r\nrxfail 5 h\r\nthr_mid = "
        "50\r\nboard_name = nan\r\n# "
    )
    assert find_settings(said) == {
        "rates_type": "ACTUAL", "thr_mid": 50.0, "board_name": "nan", "aux 3": "1 0 900 2100 0 0",
        "rxrange 2": "988 2012", "map": "AETR1234", "rxfail 3": "a", "rxfail 4": "s 1000",
        "rxfail 5": "h",
    }  # fmt: skip


def test_a_board_s_map_follows_ours() -> None:
    roll, pitch, yaw = (Stick(channel=channel) for channel in (6, 2, 3))
    swapped = ChannelMap(thrust=Throttle(channel=1), roll=roll, pitch=pitch, yaw=yaw)
    assert describe_pulses(CrsfLinkConfig(map=swapped)) == (512.0, "TER12A34")
    beyond = ChannelMap(roll=Stick(channel=9), arm=ArmSwitch(channel=5))
    with pytest.raises(ValueError, match="channels 1 to 8"):
        describe_pulses(CrsfLinkConfig(map=beyond))


def test_a_request_has_these_bytes_and_at_most_255_of_payload() -> None:
    assert encode_request(MspCommand.UID) == b"$M<\x00\xa0\xa0"
    assert encode_request(2, bytes(range(255)))[:5] == b"$M<\xff\x02"
    assert len(encode_request(2, bytes(255))) == 255 + 6
    with pytest.raises(ValueError, match="must be in range"):
        encode_request(2, bytes(256))


def test_a_frame_with_any_byte_wrong_is_dropped_and_the_one_behind_it_is_read() -> None:
    good = b"$M>\x04\x02BTFL\x1a"
    for at in range(len(good)):
        if at == 3:  # its length: the frame then waits for more, or ends early
            continue
        reader = MspReader()
        wrong = good[:at] + bytes((good[at] ^ 0x10,)) + good[at + 1 :]
        answers = reader.feed(wrong + good)
        assert answers == [MspAnswer(2, b"BTFL", True)], f"byte {at}"
        assert reader.dropped.total() == len(good), "each of its bytes is counted once"


@pytest.mark.parametrize(
    ("answer", "refusal"),
    [
        ("set x = 1\r\n###ERROR IN set: INVALID###\r\n# ", "###ERROR IN set: INVALID###"),
        ("set x = 900\r\nInvalid value. Allowed: 0 - 100\r\n", "Invalid value. Allowed: 0 - 100"),
        ("bogus\r\nUnknown command, try 'help'\r\n", "Unknown command, try 'help'"),
        ("invalid\r\nx set to 1\r\n", None),  # the echo is ours
        ("set x = 1\r\nx set to 1\r\n# ", None),
    ],
)
def test_a_refusal_is_a_line_behind_the_echo(answer: str, refusal: str | None) -> None:
    assert find_refusal(answer) == refusal


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("thr_mid", 50.0, "set thr_mid = 50"),
        ("rates_type", "ACTUAL", "set rates_type = ACTUAL"),
        ("aux 0", "0 0 1700 2100 0 0", "aux 0 0 0 1700 2100 0 0"),
        ("map", "AETR1234", "map AETR1234"),
    ],
)
def test_a_setting_is_changed_by_the_line_that_its_kind_has(
    name: str, value: float | str, line: str
) -> None:
    assert describe_change(name, value) == line
