"""The reference pages say what the code says."""

from pathlib import Path

import pytest

from groundstation.interfaces.mqtt.command import schemas
from sim.studies.campaign import COLUMNS
from tests.proving.reference import PAGES, SCHEMAS, page, reference_command

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "reference"


@pytest.mark.parametrize("name", [name for name in PAGES if not name.startswith("rooms")])
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


def test_pages_are_written_where_they_are_wanted(tmp_path: Path) -> None:
    assert len(reference_command(tmp_path).splitlines()) == len(PAGES) + len(schemas())
    assert {path.name for path in tmp_path.iterdir()} == {*PAGES, SCHEMAS}
