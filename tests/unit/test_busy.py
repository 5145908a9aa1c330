"""tests/busy.py: a test in real time that fails runs once more; it is left out only where the machine is busy."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.busy import LATE_S, Sleeper, retried, share


def attempts(*succeed: bool) -> Callable[[], bool]:
    left = list(succeed)
    return lambda: left.pop(0)


def words(*said: str) -> Callable[[], str]:
    left = list(said)
    return lambda: left.pop(0)


@pytest.mark.parametrize(
    ("attempt", "too_busy", "counts", "says"),
    [
        (attempts(True), words(), True, ""),
        (attempts(False, False), words("", ""), True, "failed, failed when tried again (with enough of it)"),
        (attempts(False, True), words(""), True, "failed, passed when tried again"),
        (attempts(False, True), words("40 %"), True, "machine too busy (40 %), passed when tried again"),
        (attempts(False, False), words("40 %", ""), True, "failed when tried again (with enough of it)"),
        (attempts(False, False), words("40 %", "50 %"), False, "failed when tried again (50 %)"),
    ],
    ids=[
        "succeeds",
        "fails on a free machine",
        "fails once on it",
        "succeeds in the end",
        "fails on a machine that is free then",
        "busy",
    ],
)
def test_a_failure_is_tried_again_and_told_and_left_out_only_on_a_busy_machine(
    attempt: Callable[[], bool], too_busy: Callable[[], str], counts: bool, says: str
) -> None:
    found, said = retried(attempt, too_busy, lambda: None)
    assert found is counts
    assert says in said
    assert bool(said) == bool(says)


@pytest.fixture
def sleeper() -> Iterator[Sleeper]:
    made = Sleeper(min(os.sched_getaffinity(0)))
    yield made
    made.end()


def test_who_sleeps_tells_how_late_it_was_woken(sleeper: Sleeper) -> None:
    begun = time.monotonic()
    time.sleep(0.3)
    os.kill(sleeper._process.pid, signal.SIGSTOP)
    time.sleep(10.0 * LATE_S)
    os.kill(sleeper._process.pid, signal.SIGCONT)
    while sleeper.late_s(begun) < 5.0 * LATE_S:
        time.sleep(0.01)
    assert sleeper.late_s(time.monotonic()) == 0.0


def test_the_share_of_a_processor_is_a_share() -> None:
    assert 0.0 < share() < 1.1


TESTS = """
import pytest
from tests import busy

pytestmark = pytest.mark.real_time
busy.PATIENCE_S = 0.0
runs = []

def got(share):
    busy.share, busy.LATE_S = lambda: share, 1e9
    runs.append(share)

def test_late_once():
    got(0.1)
    assert len(runs) == 2

def test_late_again():
    got(0.1)
    assert False

def test_wrong():
    got(1.0)
    assert False
"""


def test_a_run_of_tests_passes_leaves_out_or_fails_what_was_late(tmp_path: Path) -> None:
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = real_time")
    (tmp_path / "test_it.py").write_text(TESTS)
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-rsf",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-p",
        "tests.busy",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "1 failed, 1 passed, 1 skipped" in done.stdout
    assert "FAILED test_it.py::test_wrong" in done.stdout
    assert "left out: machine too busy" in done.stdout
