"""The reference pages say what the code says."""

import ast
import re
from pathlib import Path

import msgspec
import pytest

from groundstation import _MODULES
from groundstation.config import presets
from groundstation.core.control import CALM, Gains
from groundstation.core.vehicle import Vehicle
from groundstation.interfaces.mqtt.command import schemas
from groundstation.settings import Config
from sim.studies.campaign import COLUMNS
from tests.proving.reference import PAGES, SCHEMAS, page, reference_command, remarks

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "reference"


@pytest.mark.parametrize("name", PAGES)
def test_a_page_that_was_made_from_the_code_is_as_the_code_is_now(name: str) -> None:
    assert (FOLDER / name).read_text("utf-8") == page(name), (
        "make it anew: groundstation-sim reference --write docs/reference"
    )


def test_every_key_of_the_configuration_has_a_remark() -> None:
    text = page("configuration.md")
    assert [line for line in text.splitlines() if line.startswith("| `") and line.endswith("|  |")] == []


def test_every_column_of_a_campaign_has_a_remark() -> None:
    rows = [line for line in page("campaign-columns.md").splitlines() if line.startswith("| `")]
    assert len(rows) == len(COLUMNS)
    assert [line for line in rows if line.endswith("|  |")] == []


def test_every_section_of_the_configuration_is_there() -> None:
    text = page("configuration.md")
    for field in msgspec.structs.fields(Config):
        assert f"## `[{field.encode_name}]`" in text


def test_every_command_of_both_programs_is_there() -> None:
    text = page("commands.md")
    for command in (
        "groundstation fly",
        "groundstation config show",
        "groundstation-sim fly",
        "groundstation-sim tune",
    ):
        assert f"`{command}`" in text


def test_a_remark_is_found_below_its_field_and_in_base_classes() -> None:
    found = remarks(Vehicle)
    assert found["mass_kg"] == "With battery and markers [kg]."
    assert "preset" in found
    assert presets(Vehicle)


def test_pages_are_written_where_they_are_wanted(tmp_path: Path) -> None:
    assert len(reference_command(tmp_path).splitlines()) == len(PAGES) + len(schemas())
    assert {path.name for path in tmp_path.iterdir()} == {*PAGES, SCHEMAS}


def split_words(name: str) -> list[str]:
    """``RawReceived`` → raw, received; without what only says of what kind a class is."""
    plain = re.sub(r"(Config|Message|Kind)$", "", name)
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", plain).lower().split()


def test_what_a_user_meets_stands_in_the_glossary() -> None:
    """Sections of a configuration, what ``groundstation`` hands on, and every class that a page names."""
    defined = {
        node.name
        for top in ("groundstation", "links", "sim")
        for path in (ROOT / top).rglob("*.py")
        for node in ast.parse(path.read_text("utf-8")).body
        if isinstance(node, ast.ClassDef)
    } - {"FrameTransform", "PoseInFrame"}  # Foxglove's own
    pages = [*(ROOT / "docs").rglob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    told = "\n".join(page.read_text("utf-8") for page in pages if page.parent.name != "decisions")
    met = defined & set(re.findall(r"\b[A-Z][a-z]+(?:[A-Z][A-Za-z0-9]*)+\b", told))
    met |= {name for name in _MODULES if name[0].isupper()}
    met |= set(Config.__struct_fields__)
    glossary = (ROOT / "docs/reference/glossary.md").read_text("utf-8")
    rows = ", ".join(re.findall(r"^\| ([^|]+) \|", glossary, re.MULTILINE)).lower().replace("-", "").replace("'s", "")
    nouns = set(rows.split(", "))

    def is_told(name: str) -> bool:
        words = split_words(name)
        return any({one, one.rstrip("s")} & nouns for i in range(len(words)) for one in [" ".join(words[i:])])

    assert sorted(name for name in met if not is_told(name)) == []


def test_the_page_says_how_large_the_gains_are_at_most_off_the_figure() -> None:
    said = remarks(Gains)
    for name, most in CALM.items():
        assert re.search(rf"[Oo]ff the figure.* at most {most:g}\.", said[name]), name
