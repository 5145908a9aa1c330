"""`groundstation replay` as an operator runs it."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from groundstation.__main__ import main
from tests.e2e.stations import run_here

GOLDEN = Path(__file__).parents[1] / "golden"
PX4, ARDUPILOT = GOLDEN / "px4_takeoff.tlog", GOLDEN / "ardupilot_landing.tlog"


def replay(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return run_here(main, "replay", *arguments)


def test_json_is_one_object_with_the_figures_and_the_verdict() -> None:
    done = replay(ARDUPILOT, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    found: dict[str, Any] = json.loads(done.stdout)
    assert found["file"] == str(ARDUPILOT)
    assert found["autopilot"] == "ArduPilot"
    assert found["pose_source"] == "LOCAL_POSITION_NED and ATTITUDE_QUATERNION"
    assert found["poses"] == 1750
    assert found["rate_hz"] == pytest.approx(50.0, rel=0.01)
    assert found["gaps"]["count"] == 0
    assert found["resets"] == 0
    assert found["flight_s"] > 28.0
    assert found["velocity_rms_m_s"] < 0.1
    assert found["commands"]["compared"] > 1000
    assert found["commands"]["thrust_n"].keys() >= {"sent_mean", "shadow_mean", "difference_rms", "correlation"}
    assert found["verdict"] == "fit"
    assert found["reasons"] != []


def test_the_text_names_the_verdict_and_its_reasons() -> None:
    done = subprocess.run(
        [Path(sys.executable).with_name("groundstation"), "replay", PX4],
        env=os.environ | {"NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "PX4, poses from ODOMETRY" in done.stdout
    assert "FIT WITH CARE TO FLY ON" in done.stdout
    assert "the source reset its estimate" in done.stdout
    assert "positions and velocity of the autopilot disagree by 0." in done.stdout


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "cannot read the recording: No such file"), (b"", "the recording is empty"), (b"hello " * 40, "a .tlog?")],
    ids=["missing", "empty", "no recording"],
)
def test_a_file_that_can_not_be_replayed_is_named_in_one_line(
    tmp_path: Path, content: bytes | None, words: str
) -> None:
    file = tmp_path / "flight.tlog"
    if content is not None:
        file.write_bytes(content)
    done = replay(file)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert str(file) in done.stderr and words in done.stderr
