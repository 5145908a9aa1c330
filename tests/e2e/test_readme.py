"""Every command that the documents show works as shown.

A block of commands that can't be run here is preceded by ``<!-- not tested: why -->``.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"(?P<marker><!-- not tested: (?P<why>[^>]+?) -->\s*\n)?^```sh\n(?P<text>.*?)^```$", re.M | re.S)
OURS = ("groundstation", "groundstation-sim")


class Shown(NamedTuple):
    """A command as a document shows it."""

    document: str
    line: str

    @property
    def words(self) -> list[str]:
        """The command's words, as a shell reads them."""
        return shlex.split(self.line, comments=True)


def shown_in(text: str, document: str) -> list[Shown]:
    """The commands of the blocks that are to be tested; a backslash at a line's end continues it."""
    blocks = [match["text"] for match in BLOCK.finditer(text) if not match["marker"]]
    lines = [line.strip().removeprefix("$ ") for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [Shown(document, line) for line in lines if line and not line.startswith("#")]


SHOWN = [command for path in DOCUMENTS for command in shown_in(path.read_text("utf-8"), str(path.relative_to(ROOT)))]
ONCE = list({command.line: command for command in reversed(SHOWN)}.values())[::-1]
"""Each command where it is shown first."""


def test_a_marked_block_is_left_out_and_an_unmarked_one_is_not() -> None:
    marked = "<!-- not tested: needs a vehicle -->\n```sh\na\n```\n"
    text = marked + "\n```sh\n# remark\n$ b --c \\\n  d\n```\n```toml\ne\n```\n"
    assert [command.words for command in shown_in(text, "")] == [["b", "--c", "d"]]


def test_the_readme_shows_both_make_targets_first() -> None:
    assert [command.line for command in SHOWN if command.document == "README.md"][:2] == ["make fly", "make test"]


@pytest.mark.parametrize("command", ONCE, ids=lambda command: command.line)
def test_a_command_in_the_documents_works(command: Shown, tmp_path: Path) -> None:
    program, *arguments = command.words
    if program == "make":
        makefile = (ROOT / "Makefile").read_text("utf-8")
        assert [target for target in arguments if not re.search(rf"^{target}:", makefile, re.M)] == []
        return
    assert program in OURS, f"{command.document}: mark the block with <!-- not tested: why -->, or show only {OURS}"
    if program == "groundstation-sim" and arguments[:1] == ["fly"] and "--duration" not in arguments:
        arguments += ["--duration", "5"]
    for name in ("examples", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    done = subprocess.run(
        [Path(sys.executable).with_name(program), *arguments],
        cwd=tmp_path,
        env=os.environ | {"NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout
