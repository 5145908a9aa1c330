"""The documents: links lead somewhere, configurations are some, the site has no warning.

Beside configurations there are the fleet file of several-vehicles.md, the bridge's file of rf.md,
and what is preceded by ``<!-- not tested: where it is read -->``.
"""

import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest

from groundstation.config import load
from groundstation.core.trajectory import parse_course
from groundstation.flight.preflight import examine_trajectory
from groundstation.lab import read_fleet
from groundstation.settings import Config
from links.bridge import BridgeConfig
from tests.e2e.stations import program, run_command

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
LINK = re.compile(r"\[[^\]]*\]\((?P<target>[^)\s]+)\)")
FENCED = re.compile(r"^```.*?^```$", re.M | re.S)


def anchors(text: str) -> set[str]:
    """The anchors of a document's headings, as they are made from words."""
    heads = re.findall(r"^#+ (.+)$", FENCED.sub("", text), re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


def broken(path: Path) -> list[str]:
    """The links in ``path`` that lead nowhere."""
    found = []
    for match in LINK.finditer(FENCED.sub("", path.read_text("utf-8"))):
        target, _, anchor = match["target"].partition("#")
        if "://" in target:
            continue
        there = (path.parent / target).resolve() if target else path
        inside = there == ROOT or ROOT in there.parents
        if (
            not inside
            or not there.exists()
            or (
                anchor and there.suffix == ".md" and anchor not in anchors(there.read_text("utf-8"))
            )
        ):
            found.append(match["target"])
    return found


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_of_a_document_leads_somewhere(path: Path) -> None:
    assert broken(path) == []


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_test_that_a_document_names_is_there(path: Path) -> None:
    named = re.findall(r"(?<![\w/])tests/[\w/]+(?:\.\w+)?", path.read_text("utf-8"))
    assert [name for name in named if not (ROOT / name).exists()] == []


@pytest.mark.parametrize(
    "picture", sorted((ROOT / "docs").rglob("*.svg")), ids=lambda path: path.name
)
def test_a_picture_is_xml_as_strict_browsers_want_it(picture: Path) -> None:
    assert ElementTree.parse(picture).getroot().tag == "{http://www.w3.org/2000/svg}svg"


@pytest.mark.matrix  # `make docs` builds it; the tests before follow each link
def test_every_page_is_in_the_site_and_it_is_built_without_a_warning(tmp_path: Path) -> None:
    told = ("--config-file", ROOT / ".mkdocs.yml", "--site-dir", tmp_path / "site")
    done = run_command(program("mkdocs", "build", "--strict", *told))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "tutorial" / "first-flight.html").exists()
    assert (tmp_path / "site" / "images" / "frames.svg").exists()


# ---- configurations

BLOCK = re.compile(r"(?<! -->\n)^```toml\n(.*?)^```$", re.M | re.S)
BLOCKS = [
    (page.name, block) for page in DOCUMENTS for block in BLOCK.findall(page.read_text("utf-8"))
]


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
