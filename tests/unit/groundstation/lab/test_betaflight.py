"""Betaflight without its firmware: what is said where something is missing, what a board is told, and its own port."""

from pathlib import Path
from typing import Any

import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.lab.doctor import BoardVisit
from groundstation.lab.doctor_advice import EMPTY_SLOT, Setting, judge
from groundstation.settings import Config
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
