"""A test left out for want of a program or a device is said loudly, also where several workers run the tests."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

CONFTEST = Path(__file__).parents[1] / "conftest.py"
TESTS = """
import pytest

@pytest.mark.parametrize("n", range(3))
def test_flown(needs_program, n):
    needs_program("no-such-program", "nor-this-one")

def test_seen(needs_program):
    needs_program("no-such-browser")

def test_held():
    pytest.skip("left out: the kernel has no such device")

def test_skipped_for_another_reason():
    pytest.skip("some other reason")
"""


def test_each_missing_program_or_device_has_one_line_with_its_tests(tmp_path: Path) -> None:
    shutil.copy(CONFTEST, tmp_path)
    (tmp_path / "test_it.py").write_text(TESTS)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-n", "1"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith(("not run:", "left out:"))]
    assert lines == [
        "left out: the kernel has no such device (1 test)",
        "not run: install no-such-browser (1 test)",
        "not run: install no-such-program (3 tests)",
    ]
    assert done.returncode == 0


def test_an_installed_program_is_found_by_any_of_its_names(needs_program: Callable[..., str]) -> None:
    assert Path(needs_program("no-such-program", "sh")).name == "sh"
