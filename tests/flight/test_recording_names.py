"""Recordings by the names that ``groundstation logs`` lists, and the newest one."""

import json
import os
from pathlib import Path

import pytest

from groundstation.__main__ import main
from groundstation.core.messages import LEAST_JUDGED_S
from groundstation.machine import RecordingConfig, folder_of
from groundstation.recording import quick_headline
from groundstation.recording.__main__ import _tell_figures
from tests.e2e.stations import run_here
from tests.recordings import recorded

OLD, NEW = "20270101-120000-mqx.mcap", "20270101-110000-mqx.mcap"
"""The newest is the one that was written last, whatever its name says."""


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    folder = folder_of(RecordingConfig())
    (folder / "simulated").mkdir(parents=True)
    return folder


def put(path: Path, age_s: float) -> None:
    data, stamp = recorded()[0].read_bytes(), 1.8e9 - age_s
    path.write_bytes(data)
    os.utime(path, (stamp, stamp))


@pytest.mark.parametrize(
    ("command", "name", "ending"),
    [
        ("replay", OLD, ".mcap"),
        ("report --json", f"simulated/{OLD}", ""),
        ("identify", OLD, ""),
        ("export", f"simulated/{OLD}", ".mcap"),
        ("replay evidence", f"simulated/{OLD}", ""),
    ],
)
def test_a_listed_name_or_none_for_the_newest_is_taken(
    folder: Path, command: str, name: str, ending: str
) -> None:
    put(folder / name, 100.0)
    (listed,) = json.loads(run_here(main, "logs", "--json").stdout)["flights"]
    assert listed["file"] == name
    named = run_here(main, *command.split(), name.removesuffix(".mcap") + ending)
    assert "No such file" not in named.stderr and Path(name).stem in named.stdout + named.stderr
    put(folder / NEW, 0.0)
    newest = run_here(main, *command.split())
    assert newest.returncode == named.returncode
    assert newest.stderr.startswith(f"the newest recording: {folder / NEW}\n")


@pytest.mark.parametrize("command", ["replay", "report", "identify", "export", "view"])
def test_without_any_recording_it_is_said_where_they_would_be(folder: Path, command: str) -> None:
    done = run_here(main, command)
    assert done.returncode == 2
    assert f"no flight is recorded in {folder}" in done.stderr


def test_a_flight_ends_with_its_error_figures_and_the_path(
    capfd: pytest.CaptureFixture[str],
) -> None:
    path, _, _ = recorded()
    headline = quick_headline(path)[1]
    _tell_figures(path, headline, "recorded")
    sentence = json.loads(capfd.readouterr().out)
    told = sentence["text"]
    assert told.endswith(f"recorded in {path}") and sentence["severity"] == "info"
    assert sentence["id"].startswith("recording.") and sentence["numbers"]["path"] == str(path)
    assert headline.rms_m is None
    assert told.startswith(f"no error figures, which take {LEAST_JUDGED_S:g} s on the trajectory")
