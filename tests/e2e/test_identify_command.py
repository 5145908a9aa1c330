"""`groundstation identify` as an operator runs it: the commands of the how-to, in a row; and files that are none."""

import base64
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from groundstation.analysis.identify.command import FIGURES
from groundstation.config import from_dict
from groundstation.settings import Config
from tests.e2e.test_readme import BLOCK, ROOT

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


def holds_every_fit(page: Path) -> None:
    """And needs nothing from elsewhere."""
    text = page.read_text("utf-8")
    for figure in FIGURES:
        picture = (page.parent / f"{figure.name}.png").read_bytes()
        assert picture.startswith(b"\x89PNG")
        assert len(picture) > 5000
        assert base64.b64encode(picture).decode() in text
    assert "https:" not in text
    assert "<script" not in text


@pytest.mark.matrix  # flight/test_identify.py finds the same figures; this is the page's order of commands
def test_the_commands_of_the_how_to_lead_from_a_flight_to_a_vehicle_file(tmp_path: Path) -> None:
    block = BLOCK.search(PAGE.read_text("utf-8"))
    assert block is not None
    lines = block["text"].splitlines()
    assert [line.split()[1] for line in lines] == ["trajectory", "fly", "identify", "config"]
    for line in lines:
        done = run(tmp_path, *shlex.split(line))
        assert (done.returncode, done.stderr) == (0, ""), line
    vehicle = from_dict({"vehicle": {"file": "found.toml"}}, Config, folder=tmp_path).vehicle
    assert vehicle.thrust_lag_s == pytest.approx(1.13 * 0.1061, rel=0.1)
    assert vehicle.rate_lag_s == pytest.approx(0.85 * 0.1061, rel=0.1)
    assert max(vehicle.command_delay_s, vehicle.rate_delay_s) < 0.003
    assert vehicle.thrust_delay_s < 0.007  # its own interval reaches to 11 ms
    holds_every_fit(tmp_path / "runs/fits/identification.html")
    again = run(tmp_path, *shlex.split(lines[2]))
    assert again.returncode == 2
    assert again.stderr == "groundstation: --out: found.toml is there already\n"


@pytest.mark.tried(1)  # kinds of garbage
@pytest.mark.parametrize("content", [b"", b"no recording", b"\x89MCAP0\r\n" + 300 * b"\x07"])
def test_garbage_is_refused_in_one_line(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(content)
    done = run(tmp_path, "groundstation", "identify", "log.mcap", "--json")
    assert (done.returncode, done.stdout) == (2, "")
    assert re.match(r"groundstation: LOG: log\.mcap is (no |damaged at byte 8)", done.stderr)
    assert done.stderr.count("\n") == 1
