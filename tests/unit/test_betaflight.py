"""Betaflight without its firmware: what is said where something is missing, and what a board would be told."""

from pathlib import Path

import pytest

from groundstation.config import ConfigError
from sim.__main__ import main
from sim.autopilots import Firmware, betaflight


def test_a_missing_firmware_is_said_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(ConfigError, match="run `make firmware` in a checkout"):
        Firmware()


def test_a_missing_compiler_is_said_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    binary = betaflight.cache_folder() / betaflight.BINARY
    binary.parent.mkdir(parents=True)
    binary.touch()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match="install gcc"):
        Firmware()


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
