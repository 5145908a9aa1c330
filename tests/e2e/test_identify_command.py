"""`groundstation identify` as an operator runs it: the commands of the how-to, in a row; and files that are none."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.e2e.test_readme import ROOT

PAGE = ROOT / "docs/how-to/identify-a-vehicle.md"


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    program, *arguments = words
    return subprocess.run(
        [Path(sys.executable).with_name(program), *arguments],
        cwd=folder,
        env=os.environ | {"NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.tried(1)  # kinds of garbage
@pytest.mark.parametrize("content", [b"", b"no recording", b"\x89MCAP0\r\n" + 300 * b"\x07"])
def test_garbage_is_refused_in_one_line(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(content)
    done = run(tmp_path, "groundstation", "identify", "log.mcap", "--json")
    assert (done.returncode, done.stdout) == (2, "")
    assert re.match(r"groundstation: LOG: log\.mcap is (no |damaged at byte 8)", done.stderr)
    assert done.stderr.count("\n") == 1
