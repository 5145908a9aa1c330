"""The documents: every link leads somewhere, pictures are XML, the site has no warning."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

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
    words = (
        "mkdocs",
        "build",
        "--strict",
        "--config-file",
        str(ROOT / ".mkdocs.yml"),
        "--site-dir",
    )
    done = run_command(program(*words, tmp_path / "site"))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "site" / "tutorial" / "first-flight.html").exists()
    assert (tmp_path / "site" / "images" / "frames.svg").exists()
