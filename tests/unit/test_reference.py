"""The reference pages say what the code says."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from msgspec import inspect as mi

from groundstation.config import field_descriptions, structs
from groundstation.settings import Config
from sim.studies.campaign import COLUMNS
from tests.proving.reference import PAGES, SCHEMAS, make_schemas, page, reference_command

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "reference"


@pytest.mark.parametrize("name", PAGES)
def test_a_page_that_was_made_from_the_code_is_as_the_code_is_now(name: str) -> None:
    assert (FOLDER / name).read_text("utf-8") == page(name), (
        "make it anew: groundstation-sim dev reference --write docs/reference"
    )


def configured(info: mi.Type) -> Iterator[mi.StructType]:
    """All structs that a configuration may hold."""
    for struct in structs(info):
        yield struct
        for field in struct.fields:
            yield from configured(field.type)


def test_every_key_of_the_configuration_has_a_description() -> None:
    found = {
        f"{struct.cls.__name__}.{field.encode_name}"
        for struct in configured(mi.type_info(Config))
        for field in struct.fields
        if not structs(field.type) and field.encode_name not in field_descriptions(struct.cls)
    }
    assert found == set()


def test_every_column_of_a_campaign_has_a_remark() -> None:
    rows = [line for line in page("campaign-columns.md").splitlines() if line.startswith("| `")]
    assert len(rows) == len(COLUMNS)
    assert [line for line in rows if line.endswith("|  |")] == []


def test_pages_are_written_where_they_are_wanted(tmp_path: Path) -> None:
    assert len(reference_command(tmp_path).splitlines()) == len(PAGES) + len(make_schemas())
    assert {path.name for path in tmp_path.iterdir()} == {*PAGES, SCHEMAS}
