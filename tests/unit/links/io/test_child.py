"""Processes of our programs run our own modules, whatever else bears their names."""

import asyncio
import os
import re
import subprocess
from pathlib import Path

import pytest

from links.io import make_child_command, open_child, start_child

ROOT = Path(__file__).parents[4]
PACKAGES = ("groundstation", "links", "sim")
SOURCES = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]


def run(command: list[str], folder: Path, path: str) -> "subprocess.CompletedProcess[str]":
    environment = os.environ | {"PYTHONPATH": path}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


# Where PYTHONPATH puts it first, a `groundstation` of the user's is theirs:
# docs/decisions/0010-distribution.md.
@pytest.mark.parametrize(
    ("names", "path"), [(PACKAGES, ""), (("links", "sim"), ".")], ids=["here", "in PYTHONPATH"]
)
@pytest.mark.parametrize("module", ["groundstation", "sim"])
def test_a_module_of_the_users_with_the_name_of_ours_is_not_run(
    module: str, names: tuple[str, ...], path: str, tmp_path: Path
) -> None:
    for name in names:
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('not our {name}')", "utf-8")
    done = run(make_child_command(module, "--version"), tmp_path, path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("groundstation")


def test_no_program_of_ours_is_started_in_any_other_way() -> None:
    texts = {str(file.relative_to(ROOT)): file.read_text("utf-8") for file in SOURCES}
    theirs = {"groundstation/runtime/packages.py"}  # the advice that names pip
    starts = re.compile(r"(Popen|subprocess_exec)\(\s*(\*?make_child_command|command\b)")
    for found in (
        {name for name, text in texts.items() if '"-m"' in text} - theirs,
        {name for name, text in texts.items() if starts.search(text)},
    ):
        assert found == {"links/io/child.py"}


@pytest.mark.parametrize("apart", [True, False])
def test_a_child_is_in_a_session_of_its_own_unless_it_is_told_otherwise(
    apart: bool, tmp_path: Path
) -> None:
    (tmp_path / "tell.py").write_text(
        "import os, sys\nprint(os.getsid(0), repr(sys.stdin.read()), *sys.argv[1:])", "utf-8"
    )
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}

    async def opened() -> bytes:
        child = await open_child("tell", "a", "b", apart=apart, env=environment)
        return (await child.communicate())[0]

    started = start_child("tell", "a", "b", apart=apart, stdout=subprocess.PIPE, env=environment)
    for said in (started.communicate()[0], asyncio.run(opened())):
        session, *words = said.decode().split()
        assert words == ["''", "a", "b"]
        assert (int(session) != os.getsid(0)) is apart
