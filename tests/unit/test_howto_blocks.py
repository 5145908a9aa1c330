"""Every configuration that the how-tos of trajectories, vehicles and identification show is one."""

import re
import shutil
from pathlib import Path

import pytest

from groundstation.config import load
from groundstation.core.trajectory import parse_course
from groundstation.flight import examine_trajectory
from groundstation.lab import read_fleet
from groundstation.settings import Config

ROOT = Path(__file__).parents[2]
NAMES = ("trajectories.md", "vehicles.md", "identify-a-vehicle.md", "mqtt.md")
PAGES = [ROOT / "docs/how-to" / name for name in NAMES]
BLOCKS = [
    block for page in PAGES for block in re.findall(r"^```toml\n(.*?)^```$", page.read_text("utf-8"), re.M | re.S)
]


@pytest.mark.parametrize("block", range(len(BLOCKS)))
def test_a_block_is_a_configuration_that_may_fly(block: int, tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    shutil.copytree(ROOT / "examples", lab)
    (lab / "shown.toml").write_text(BLOCKS[block], "utf-8")
    assert examine_trajectory(load(lab / "shown.toml", Config)).ok


def test_the_course_that_is_shown_is_one() -> None:
    (course,) = re.findall(r"^```\n(t_s,.*?)^```$", PAGES[0].read_text("utf-8"), re.M | re.S)
    assert len(parse_course(course)["points_ned"]) == 2


@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.toml")), ids=lambda path: path.name)
def test_an_example_is_a_configuration_that_may_fly(example: Path) -> None:
    if example.name == "fleet.toml":
        assert all(examine_trajectory(member.lab).ok for member in read_fleet(example).members)
    elif example.name != "vehicle.toml":  # that one is a part of another
        assert examine_trajectory(load(example, Config)).ok
