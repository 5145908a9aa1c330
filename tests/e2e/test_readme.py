"""Every command that the documents show works as shown.

A block of commands that can't be run here is preceded by ``<!-- not tested: why -->``: of it the
programs must know all options. One that needs what the block above it leaves behind is preceded by
``<!-- after the block above -->``.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from groundstation.__main__ import parser
from sim.__main__ import parser as sim_parser
from tests.e2e.stations import run_command

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
MARK = r"(?:<!-- (?:not tested: (?P<why>[^>]+?)|(?P<after>after the block above)) -->\s*\n)?"
BLOCK = re.compile(MARK + r"^```sh\n(?P<text>.*?)^```$", re.M | re.S)
OURS = {"groundstation": parser, "groundstation-sim": sim_parser}


class Shown(NamedTuple):
    """Commands as a document shows them: of one block, or of several that need each other."""

    document: str
    lines: list[str]
    tested: bool


def shown_in(text: str, document: str) -> list[Shown]:
    """The commands of its blocks; a backslash at a line's end continues it."""
    found: list[Shown] = []
    for block in BLOCK.finditer(text):
        told = [
            line.strip().removeprefix("$ ")
            for line in block["text"].replace("\\\n", " ").splitlines()
        ]
        lines = [line for line in told if line and not line.startswith("#")]
        if block["after"]:
            found[-1].lines.extend(lines)
        else:
            found.append(Shown(document, lines, not block["why"]))
    return found


SHOWN = [
    block
    for path in DOCUMENTS
    for block in shown_in(path.read_text("utf-8"), str(path.relative_to(ROOT)))
]
FIRST = {line: block for block in reversed(SHOWN) if block.tested for line in block.lines}
"""The first block that shows a line; no later one runs it again."""
TESTED = [
    block._replace(lines=lines)
    for block in SHOWN
    if block.tested and (lines := [line for line in block.lines if FIRST[line] is block])
]
OTHERS = list(
    {line: block.document for block in SHOWN if not block.tested for line in block.lines}.items()
)


@pytest.mark.parametrize(("line", "document"), OTHERS, ids=[line for line, _ in OTHERS])
def test_a_command_that_can_not_be_run_here_is_one_that_the_program_takes(
    line: str, document: str, capsys: pytest.CaptureFixture[str]
) -> None:
    program, *arguments = shlex.split(re.split(r" [|&]", line)[0], comments=True)
    try:
        if program in OURS:
            OURS[program]().parse_args(arguments)
    except SystemExit as end:
        assert not end.code, f"{document}: {capsys.readouterr().err}"


@pytest.mark.tried(5)  # every seventh
@pytest.mark.parametrize("block", TESTED, ids=lambda block: block.lines[0])
def test_the_commands_of_a_block_in_the_documents_work(block: Shown, tmp_path: Path) -> None:
    for name in ("examples", "tests"):
        (tmp_path / name).symlink_to(ROOT / name)
    for line in block.lines:
        program, *arguments = shlex.split(line, comments=True)
        if program == "make":
            makefile = (ROOT / "Makefile").read_text("utf-8")
            assert [
                target for target in arguments if not re.search(rf"^{target}:", makefile, re.M)
            ] == []
            continue
        assert program in OURS, (
            f"{block.document}: mark the block with <!-- not tested: why -->, or show {list(OURS)}"
        )
        if program == "groundstation-sim" and arguments[0] in ("fly", "mission"):
            arguments += ["--duration", "5"]  # in the place of what is told
        command = [str(Path(sys.executable).with_name(program)), *arguments]
        plain = os.environ | {"NO_COLOR": "1"}
        done = run_command(command, cwd=tmp_path, env=plain, stderr=subprocess.STDOUT)
        assert done.returncode == 0, f"{line}\n{done.stdout}"
