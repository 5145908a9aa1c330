"""The dashboard looks as it did.

Where it shall look otherwise: python -m tests.tui_pictures, and look at them.
"""

import re

import pytest

from tests.tui_pictures import FOLDER, PICTURES, draw


def words(svg: str) -> str:
    """The text of a picture, for a failure that can be read."""
    return re.sub(r"<[^>]+>", "", svg.partition("-matrix")[2]).replace("&#160;", " ")


@pytest.mark.parametrize("name", PICTURES)
def test_a_page_looks_as_it_did(name: str) -> None:
    drawn, wanted = draw(name), (FOLDER / f"{name}.svg").read_text("utf-8")
    assert words(drawn) == words(wanted)
    assert drawn == wanted, f"the words are the same, the colours are not: look at {name}.svg"


def test_every_picture_is_compared() -> None:
    assert {path.stem for path in FOLDER.glob("*.svg")} == set(PICTURES)
