"""tests/matrix.py and tests/progress.py: which cases are tried, and what is said of them while they run."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.matrix import spread


@pytest.mark.parametrize(
    ("tried", "cases", "numbers"),
    [(0, 5, set()), (1, 5, {0}), (2, 5, {0, 4}), (3, 5, {0, 2, 4}), (5, 5, {0, 1, 2, 3, 4}), (9, 3, {0, 1, 2})],
)
def test_the_cases_that_are_tried_are_spread(tried: int, cases: int, numbers: set[int]) -> None:
    assert spread(tried, cases) == numbers


RUN = """
import time

def test_good():
    time.sleep(2.0)

def test_bad():
    assert "this" == "that"
"""


@pytest.mark.matrix  # of what runs the tests
def test_what_runs_and_each_failure_are_said_at_once(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(RUN)
    options = ["-q", "-p", "no:cacheprovider", "-p", "no:hypothesispytest", "-p", "tests.progress", "-n", "2"]
    command = [sys.executable, "-m", "pytest", *options, "--progress", "some"]
    done = subprocess.run(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True, check=False)
    said = done.stdout
    assert re.search(r"^some: \d of 2.*; runs: .*test_it.py::test_good \(\d s\)", said, re.M)
    assert said.count('>       assert "this" == "that"') == 1, "and not once more at the end"
    assert re.search(r"^some: FAILED test_it.py::test_bad \(call\)", said, re.M)
    assert re.search(r"^some: 2 of 2, 1 FAILED$", said, re.M)
    assert done.returncode == 1
