"""Recordings of an older version open, report, identify, export and replay."""

import hashlib
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.__main__ import main
from groundstation.analysis.replay import replay_facts, text_of
from groundstation.recording import Recording, quick_headline
from groundstation.settings import read_flown_config
from tests.e2e.stations import run_here

FOLDER = Path(__file__).parents[1] / "golden" / "recordings"
EXPECTED: dict[str, dict[str, Any]] = json.loads((FOLDER / "expected.json").read_text())
OLD_COMMIT = "936caf1489ad"


RECORDED = pytest.mark.parametrize("name", EXPECTED)


def call(*words: str | Path) -> dict[str, Any]:
    """What ``groundstation WORDS --json`` prints."""
    done = run_here(main, *words, "--json")
    assert done.returncode == 0, done.stderr
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


@RECORDED
def test_an_old_recording_opens_with_the_headline_that_its_own_version_gave(name: str) -> None:
    path = FOLDER / f"{name}.mcap"
    about, headline, whole = quick_headline(path)
    assert whole
    assert about["git"].startswith(OLD_COMMIT)
    assert msgspec.to_builtins(headline) == EXPECTED[name]["headline"]
    counted = Recording(path).headline()
    assert (counted.commands, counted.poses) == (headline.commands, headline.poses)


@RECORDED
def test_an_old_recording_reports_the_figures_that_its_own_version_gave(name: str) -> None:
    (flight,) = call("report", FOLDER / f"{name}.mcap")["flights"]
    for event in flight["events"]:
        del event["clock_s"]  # its own version did not tell the station's clock
    for key, value in EXPECTED[name]["report"].items():
        assert flight[key] == value, key


def test_an_old_recording_identifies_the_vehicle_that_its_own_version_found() -> None:
    found = call("identify", FOLDER / "excitation.mcap")["parameters"]
    for key, value in EXPECTED["excitation"]["identify"].items():
        wanted = None if value is None else pytest.approx(value, rel=0.02, abs=2e-4)
        assert found[key]["value"] == wanted, key


@RECORDED
def test_an_old_recording_exports_the_tables_that_its_own_version_wrote(
    name: str, tmp_path: Path
) -> None:
    tables = tmp_path / "tables"
    assert run_here(main, "export", FOLDER / f"{name}.mcap", "--out", tables).returncode == 0
    digests = {
        file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in tables.iterdir()
    }
    assert digests == EXPECTED[name]["csv_sha256"]


@RECORDED
def test_the_replay_of_an_old_recording_tells_versions_and_differences(name: str) -> None:
    facts = replay_facts(FOLDER / f"{name}.mcap")
    figures = EXPECTED[name]["headline"]
    assert (facts["commands"], facts["poses"]) == (figures["commands"], figures["poses"])
    assert facts["recorded_by"]["git"].startswith(OLD_COMMIT)
    # Poses come of the same bytes, and commands of the same poses; what limits them may have
    # changed.
    assert facts["differing"]["pose"] == 0
    assert facts["changes"]["thrust_n"]["rms"] < 0.2 * facts["changes"]["thrust_n"]["recorded_mean"]
    text = text_of(facts)
    assert f"recorded by version {facts['recorded_by']['version']} ({OLD_COMMIT})" in text
    assert f"replayed by version {facts['replayed_by']['version']}" in text
    largest_n = f"{facts['changes']['thrust_n']['max']:.2g}"
    assert f"the largest difference is {largest_n} N of thrust" in text


def test_settings_that_this_version_does_not_know_are_left_out_and_named() -> None:
    recording = Recording(FOLDER / "radio.mcap")
    known = read_flown_config(recording.about, recording.path)
    unknown = "[lost_section]\nkey = 1\n\n[vehicle]\nlost_key = 2"
    old = recording.about["config"].replace("[vehicle]", unknown, 1)
    recording.about["config"] = old.replace("coast_s =", "coast_s = -1 #", 1)
    config, left_out = read_flown_config(recording.about, recording.path, ["vehicle.mass_kg=0.1"])
    lost = {"lost_section", "vehicle.lost_key", "flight.coast_s"}
    assert set(left_out) - set(known.left_out) == lost
    assert config.vehicle.mass_kg == 0.1
    assert config.pose == known.config.pose
