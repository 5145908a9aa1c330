"""groundstation/machine/recordings.py: names, and what is tidied away; and the list of flights."""

import fcntl
import json
import os
from pathlib import Path

import pytest

from groundstation.analysis import logs_command
from groundstation.machine import (
    RecordingConfig,
    folder_of,
    free_name,
    is_being_written,
    list_recordings,
    make_folder,
    tidy,
)
from groundstation.recording.channels import MissionMessage
from groundstation.recording.headline import HeadlineCounter

NOW = 1_800_000_000.0
DAY = 86400.0


def kept(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_in_the_place_of_the_folder_is_told_as_one(tmp_path: Path) -> None:
    (tmp_path / "flights").write_text("mine")
    with pytest.raises(NotADirectoryError, match=r"it is a file, not a folder: .*flights"):
        make_folder(RecordingConfig(folder=str(tmp_path / "flights")))


def flight(folder: Path, day: int, size: int = 1000, *, tlog: bool = False) -> Path:
    """A file called as a recording of that day of January."""
    path = folder / f"202701{day:02}-120000-mqx.mcap"
    path.write_bytes(b"x" * size)
    os.utime(path, (NOW - DAY * (31 - day), NOW - DAY * (31 - day)))
    if tlog:
        path.with_suffix(".tlog").write_bytes(b"y" * size)
    return path


def config(folder: Path, *, gb: float | None = None, days: float | None = None) -> RecordingConfig:
    return RecordingConfig(folder=str(folder), keep_gb=gb, keep_days=days)


def test_recordings_are_kept_in_the_users_own_state_unless_told_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/somewhere")
    assert folder_of(RecordingConfig()) == Path("/somewhere/groundstation/flights")
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", "/home-of")
    assert folder_of(RecordingConfig()) == Path("/home-of/.local/state/groundstation/flights")
    assert folder_of(RecordingConfig(folder="here")) == Path("here")


def test_two_flights_in_one_second_get_two_names(tmp_path: Path) -> None:
    first = free_name(tmp_path, "20270101-120000", "mqx")
    first.touch()
    second = free_name(tmp_path, "20270101-120000", "mqx")
    assert (first.name, second.name) == ("20270101-120000-mqx.mcap", "20270101-120000-mqx-2.mcap")
    second.touch()
    assert set(list_recordings(tmp_path)) == {first, second}


def test_the_oldest_go_when_all_take_too_much_their_tlogs_with_them_and_those_that_are_too_old(
    tmp_path: Path,
) -> None:
    for day in range(1, 6):
        flight(tmp_path, day, tlog=True)
    removed = tidy(config(tmp_path, gb=6.5e-6), NOW)
    assert [path.name[6:8] for path in removed] == ["01", "02"]
    assert len(kept(tmp_path)) == 6
    removed = tidy(config(tmp_path, days=26.5), NOW)
    assert [path.name[6:8] for path in removed] == ["03", "04"], "however small"


def test_the_newest_a_running_one_and_files_of_others_always_stay(tmp_path: Path) -> None:
    running, newest = flight(tmp_path, 1), flight(tmp_path, 2)
    for name in ("notes.txt", "flight.mcap", "20270101-mine.mcap"):
        (tmp_path / name).write_bytes(b"z" * 5000)
    with running.open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert is_being_written(running)
        assert tidy(config(tmp_path, gb=1e-9, days=1e-6), NOW) == []
    assert tidy(config(tmp_path, gb=1e-9, days=1e-6), NOW) == [running]
    assert newest.exists()
    assert len(kept(tmp_path)) == 4


def test_a_file_that_is_no_recording_spoils_no_list(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight(tmp_path, 1)
    assert logs_command(tmp_path, as_json=True) == 0
    (row,) = json.loads(capsys.readouterr().out)["flights"]
    assert row["error"] == f"{tmp_path / row['file']} is no MCAP file"


def test_why_a_flight_ended_is_what_led_to_its_last_state_and_not_what_was_told_after() -> None:
    count = HeadlineCounter()
    for state, text in (
        ("landing", "told by tui 7"),
        ("landed", "landed and disarmed"),
        ("landed", "tui 7 has gone, and held control: nobody does now"),
    ):
        count.add(MissionMessage(0.0, state, text))
    assert (count.headline().state, count.headline().reason) == ("landed", "landed and disarmed")
    count.end_flight("landed", "flown to the end")
    assert count.headline().reason == "flown to the end"
