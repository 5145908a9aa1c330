"""What nobody reads any more ends a program without a traceback."""

import json
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from groundstation import load


@pytest.mark.tried(2)  # commands
@pytest.mark.parametrize(
    "words",
    [
        ("groundstation", "config", "show"),
        ("sim", "dev", "states"),
        ("groundstation", "mqtt", "topics"),
        ("sim", "scenarios", "--json"),
        ("sim", "fly", "--duration", "1"),
    ],
    ids=" ".join,
)
def test_a_reader_that_has_gone_ends_a_command_without_a_traceback(words: tuple[str, ...]) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    process.stdout.close()
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (1, "")


def test_a_full_disk_is_told_of_in_one_line() -> None:
    with open("/dev/full", "w") as full:  # noqa: PTH123  # a device
        words = [sys.executable, "-m", "groundstation", "config", "show"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (1, "the output cannot be written: No space left on device\n")


def test_help_that_finds_the_disk_full_leaves_no_trace_of_python() -> None:
    with open("/dev/full", "w") as full:  # noqa: PTH123  # a device
        words = [sys.executable, "-m", "groundstation", "--version"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    assert done.returncode in (0, 1) and "Exception" not in done.stderr


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&- <&-"])
def test_a_program_that_is_started_without_standard_streams_flies_and_records(closed: str, tmp_path: Path) -> None:
    flight = shlex.join([sys.executable, "-m", "sim", "fly", "--duration", "1", "--out", str(tmp_path)])
    done = subprocess.run(["sh", "-c", f"{flight} {closed}"], timeout=60, check=False)
    assert done.returncode == 0
    assert json.loads((tmp_path / "summary.json").read_text())["completed"]
    assert load(tmp_path / "flight.mcap").time.size > 0
