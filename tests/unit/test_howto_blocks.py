"""Every configuration that the documents show is one.

Beside configurations there are the fleet file of several-vehicles.md, the bridge's file of rf.md,
and what is preceded by ``<!-- not tested: where it is read -->``.
"""

import re
import shutil
from pathlib import Path

import pytest

from groundstation.config import load
from groundstation.core.trajectory import parse_course
from groundstation.flight.preflight import examine_trajectory
from groundstation.lab import read_fleet
from groundstation.settings import Config
from links.bridge import BridgeConfig

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"(?<! -->\n)^```toml\n(.*?)^```$", re.M | re.S)
BLOCKS = [(page.name, block) for page in PAGES for block in BLOCK.findall(page.read_text("utf-8"))]


@pytest.mark.parametrize(
    ("page", "block"), BLOCKS, ids=[f"{page}, block {i}" for i, (page, _) in enumerate(BLOCKS)]
)
def test_a_block_is_a_configuration_that_may_fly(page: str, block: str, tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    shutil.copytree(ROOT / "examples", lab)
    shown = lab / "shown.toml"
    shown.write_text(block, "utf-8")
    if "[[vehicles]]" in block:
        assert read_fleet(shown).members
    elif block.startswith("listen"):
        assert load(shown, BridgeConfig).link.kind == "dsm"
    else:
        assert examine_trajectory(load(shown, Config)).ok


def test_the_course_that_is_shown_is_one() -> None:
    page = ROOT / "docs/how-to/trajectories.md"
    (course,) = re.findall(r"^```\n(t_s,.*?)^```$", page.read_text("utf-8"), re.M | re.S)
    assert len(parse_course(course)["points_ned"]) == 2


@pytest.mark.parametrize(
    "example", sorted((ROOT / "examples").glob("*.toml")), ids=lambda path: path.name
)
def test_an_example_is_a_configuration_that_may_fly(example: Path) -> None:
    if example.name == "fleet.toml":
        assert all(examine_trajectory(member.lab).ok for member in read_fleet(example).members)
    elif example.name != "vehicle.toml":  # that one is a part of another
        assert examine_trajectory(load(example, Config)).ok
