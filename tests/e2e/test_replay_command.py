"""`groundstation replay` as an operator runs it."""

import json
import subprocess
from pathlib import Path

import pytest

from groundstation.__main__ import main
from tests.e2e.stations import run_here

GOLDEN = Path(__file__).parents[1] / "golden"
PX4, ARDUPILOT = GOLDEN / "px4_takeoff.tlog", GOLDEN / "ardupilot_landing.tlog"


def replay(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return run_here(main, "replay", *arguments)


def test_json_is_one_object_with_the_figures() -> None:
    done = replay(ARDUPILOT, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    (found,) = json.loads(done.stdout)["flights"]
    assert (found["name"], found["source"]) == ("ardupilot_landing", "autopilot")
    assert found["poses"] == 1750
    assert found["pose_hz"] == pytest.approx(50.0, rel=0.01)
    assert found["flown_s"] > 28.0


def test_the_text_is_the_page_of_evidence_with_a_configuration_too(tmp_path: Path) -> None:
    config = tmp_path / "config.toml"
    config.write_text(
        '[vehicle]\nname = "x"\nmass_kg = 1.0\nthrust_max_n = 19.6\n[link]\nkind = "mavlink"\n'
    )
    done = replay(PX4, "--config", config)
    assert (done.returncode, done.stderr) == (0, "")
    assert "px4_takeoff (autopilot): 17.1 s in the air" in done.stdout
    assert "its own velocity is 0.193 m/s RMS from that of its positions" in done.stdout


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "flight.tlog: No such file"),
        (b"", "flight.tlog: empty"),
        (b"hello " * 40, "is it a .tlog"),
    ],
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
