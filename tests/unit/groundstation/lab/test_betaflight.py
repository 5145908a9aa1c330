"""Betaflight without its firmware: what is said where something is missing, what a board is told, and its own port."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from groundstation.config import ConfigError, from_dict
from groundstation.lab.doctor import BoardVisit
from groundstation.lab.doctor_advice import EMPTY_SLOT, Setting, judge
from groundstation.settings import Config
from links.rf import (
    CrsfLinkConfig,
    MspReader,
    describe_change,
    describe_pulses,
    encode_request,
    find_settings,
    is_armed,
)
from links.rf.betaflight_codec import MspAnswer, MspCommand
from links.rf.channel_map import ArmSwitch, ChannelMap, Stick, Throttle
from sim.__main__ import main
from sim.autopilots import BetaflightFirmware, betaflight


def test_a_missing_firmware_is_said_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(ConfigError, match="run `make firmware` in a checkout"):
        BetaflightFirmware()


def test_a_missing_compiler_is_said_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    binary = betaflight.cache_folder() / betaflight.BINARY
    binary.parent.mkdir(parents=True)
    binary.touch()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match="install gcc"):
        BetaflightFirmware()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--link", "mavlink"], "expected crsf, dsm or rf_bridge"),
        (["--config", "mine.toml"], "--config: Betaflight flies one vehicle of a scenario"),
    ],
)
def test_betaflight_flies_behind_a_receiver_only(
    options: list[str], says: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["groundstation-sim", "fly", "--autopilot", "betaflight", *options])
    assert main() == 2
    assert says in capsys.readouterr().err


# ---- a board's own port


MSP = [
    (b"$M<\x00\x02\x02", 2, b"", None),
    (b"$M>\x04\x02BTFL\x1a", 2, b"BTFL", True),
    (b"$M>\x03\x03\x04\x06\x00\x02", 3, bytes((4, 6, 0)), True),
    (
        b"$M>\x0b\x65\x7d\x00\x00\x00\x21\x00\x01\x00\x00\x00\x00\x33",
        MspCommand.STATUS,
        bytes.fromhex("7d00000021000100000000"),
        True,
    ),
    (b"$M!\x00\xff\xff", 255, b"", False),
]
"""Frame by the document, command, payload, and whether the board knows it; None where it is from us."""


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
    assert is_armed(bytes.fromhex("7d00000021000100000000"))
    assert not is_armed(bytes.fromhex("7d00000021000600000000"))
    with pytest.raises(ValueError, match="at least 10 bytes"):
        is_armed(bytes(9))


@given(st.text(max_size=200))
def test_whatever_a_command_line_says_what_is_found_can_be_said_again(said: str) -> None:
    for name, value in find_settings(said).items():
        assert name in describe_change(name, value)


def test_settings_are_found_in_what_the_command_line_says() -> None:
    said = (
        "get rates_type\r\nrates_type = ACTUAL\r\nAllowed values: BETAFLIGHT, RACEFLIGHT, KISS, ACTUAL, QUICK\r\n"
        "Default value: BETAFLIGHT\r\naux 3 1 0 900 2100 0 0\r\nrxrange 2 988 2012\r\nmap AETR1234\r\n\r\n"
        "rxfail 3 a\r\nrxfail 4 s 1000\r\nrxfail 5 h\r\n"
        "thr_mid = 50\r\nboard_name = nan\r\n# "
    )
    assert find_settings(said) == {
        "rates_type": "ACTUAL", "thr_mid": 50.0, "board_name": "nan", "aux 3": "1 0 900 2100 0 0",
        "rxrange 2": "988 2012", "map": "AETR1234", "rxfail 3": "a", "rxfail 4": "s 1000", "rxfail 5": "h",
    }  # fmt: skip


def test_a_board_s_map_follows_ours() -> None:
    swapped = ChannelMap(
        thrust=Throttle(channel=1), roll=Stick(channel=6), pitch=Stick(channel=2), yaw=Stick(channel=3)
    )
    assert describe_pulses(CrsfLinkConfig(map=swapped)) == (512.0, "TER12A34")
    with pytest.raises(ValueError, match="channels 1 to 8"):
        describe_pulses(CrsfLinkConfig(map=ChannelMap(roll=Stick(channel=9), arm=ArmSwitch(channel=5))))


def slot_verdicts(slots: dict[str, str], **link_map: Any) -> dict[str, str]:
    """What is said of a board's rows of modes, where arming is on channel 5."""
    config = from_dict({"link": {"kind": "crsf", "map": {"arm": {"channel": 5}, **link_map}}}, Config)
    visit = BoardVisit(config, "/dev/ttyACM0")
    visit.parameters = {name: Setting(name, row) for name, row in slots.items()}
    found = [judge(advice, visit.parameters) for advice in visit.advice if advice.names[0].startswith("aux")]
    for one in found:
        rules = [advice.rule for advice in visit.advice if advice.names == (one.name,)]
        assert one.recommended is None or rules[0].accepts(one.recommended)
    return {one.name: one.verdict for one in found}


ARM = "0 0 1700 2100 0 0"


@pytest.mark.parametrize(
    ("slots", "verdicts"),
    [
        ({"aux 0": ARM, "aux 1": EMPTY_SLOT}, {"aux 0": "ok"}),
        ({"aux 0": EMPTY_SLOT, "aux 1": ARM}, {"aux 1": "ok"}),
        ({"aux 0": EMPTY_SLOT}, {"aux 0": "must"}),
        ({"aux 0": "0 1 1700 2100 0 0"}, {"aux 0": "must"}),  # another channel
        ({"aux 0": "0 0 900 2100 0 0"}, {"aux 0": "must"}),  # always
        ({"aux 0": "0 0 900 1300 0 0"}, {"aux 0": "must"}),  # the wrong way round
        ({"aux 0": ARM, "aux 1": "0 3 1300 1700 0 0"}, {"aux 0": "ok", "aux 1": "must"}),  # arms twice
        ({"aux 0": ARM, "aux 1": "1 1 1300 1700 0 0"}, {"aux 0": "ok", "aux 1": "must"}),  # ANGLE where frames rest
        ({"aux 0": ARM, "aux 1": "1 1 1700 2100 0 0"}, {"aux 0": "ok", "aux 1": "ok"}),  # ANGLE by nobody
        ({"aux 0": ARM, "aux 1": "2 0 1700 2100 0 0"}, {"aux 0": "ok", "aux 1": "must"}),  # HORIZON while armed
        ({"aux 0": ARM, "aux 1": "13 1 900 2100 0 0"}, {"aux 0": "ok", "aux 1": "ok"}),  # a beeper
    ],
)
def test_arming_is_by_one_row_and_no_mode_that_our_frames_meet_takes_the_sticks(
    slots: dict[str, str], verdicts: dict[str, str]
) -> None:
    assert slot_verdicts(slots) == verdicts


@pytest.mark.parametrize(
    ("link", "port", "says"),
    [
        ({"kind": "crsf"}, None, "expected the flight controller's own port"),
        ({"kind": "crsf"}, "ttyACM0", "it has no port"),
        ({"kind": "dsm"}, "/dev/ttyACM0", "link.map.arm: Betaflight arms by a channel"),
        ({"kind": "crsf", "map": {"roll": {"channel": 1, "full_rate_deg_s": 205}}}, "/dev/ttyACM0", "whole tens"),
        ({"kind": "rf_bridge"}, "/dev/ttyACM0", "expected mavlink, dsm or crsf"),
    ],
)
def test_a_board_is_looked_at_by_its_own_port_and_a_map_that_it_can_have(
    link: dict[str, Any], port: str | None, says: str
) -> None:
    with pytest.raises(ConfigError, match=says):
        BoardVisit(from_dict({"link": link}, Config), port)
