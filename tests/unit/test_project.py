"""What must hold of the project as a whole, whoever clones it and wherever."""

import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from groundstation import __version__
from tests.seeded_faults import CONCERNED, FAULTS, PACKAGES, copy_checkout, file_of

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
COMMANDS: dict[str, str] = PROJECT["project"]["scripts"]


@cache
def lock() -> dict[str, Any]:
    return tomllib.loads((ROOT / "uv.lock").read_text("utf-8"))


def foreign_addresses(lock: dict[str, Any]) -> Iterator[str]:
    """Every source or file in the lock that another machine may not reach."""
    for package in lock["package"]:
        own = package["name"] == PROJECT["project"]["name"]
        expected = {"editable": "."} if own else {"registry": "https://pypi.org/simple"}
        if package["source"] != expected:
            yield f"{package['name']}: {package['source']}"
        files = [*package.get("wheels", []), *([package["sdist"]] if "sdist" in package else [])]
        if not own and not files:
            yield f"{package['name']}: no files"
        for file in files:
            if not str(file.get("url", "")).startswith("https://files.pythonhosted.org/packages/"):
                yield f"{package['name']}: {file}"


def test_the_lock_resolves_on_any_machine() -> None:
    assert list(foreign_addresses(lock())) == []


def test_the_lock_knows_every_dependency_in_pyproject() -> None:
    own = next(
        package for package in lock()["package"] if package["name"] == PROJECT["project"]["name"]
    )
    names = {
        re.split(r"[<>=!~\[; ]", dependency)[0] for dependency in PROJECT["project"]["dependencies"]
    }
    assert {dependency["name"] for dependency in own["dependencies"]} == names


def test_every_dependency_has_a_stated_reason() -> None:
    decision = (ROOT / "docs/decisions/0001-dependencies.md").read_text("utf-8")
    groups = PROJECT["dependency-groups"].values()
    dependencies = [
        *PROJECT["project"]["dependencies"],
        *(d for group in groups for d in group if isinstance(d, str)),
    ]
    names = [re.split(r"[<>=!~\[; ]", dependency)[0] for dependency in dependencies]
    assert [name for name in names if f"| {name} |" not in decision] == []


def test_the_changelog_has_this_version() -> None:
    assert f"## {PROJECT['project']['version']}" in (ROOT / "CHANGELOG.md").read_text("utf-8")


def test_every_codec_is_under_the_purity_contract() -> None:
    contracts = PROJECT["tool"]["importlinter"]["contracts"]
    pure = {
        module
        for contract in contracts
        if contract["type"] == "forbidden"
        for module in contract["source_modules"]
    }
    files = [
        file
        for package in ("links", "groundstation", "sim")
        for file in (ROOT / package).rglob("*_codec.py")
    ]
    codecs = {".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files}
    assert codecs != set()
    assert {
        codec for codec in codecs if not any(f"{codec}.".startswith(f"{name}.") for name in pure)
    } == set()


@pytest.mark.parametrize("command", COMMANDS)
def test_both_programs_say_their_version(command: str) -> None:
    assert __version__ == PROJECT["project"]["version"]
    script = Path(sys.executable).with_name(command)
    said = subprocess.run([script, "--version"], capture_output=True, text=True, check=True)
    assert said.stdout == f"{command} {__version__}\n"


def test_each_seeded_fault_has_its_line_in_a_copy_that_lacks_no_module(tmp_path: Path) -> None:
    copy = tmp_path / "checkout"
    copy_checkout(copy)
    for package in (*PACKAGES, "tests"):
        ours, theirs = (
            {path.relative_to(at) for path in (at / package).rglob("*.py")} for at in (ROOT, copy)
        )
        assert ours == theirs
    assert {file_of(copy, fault).name for fault in FAULTS} == {
        Path(name).name for name in CONCERNED
    }
    assert all(
        (copy / "tests" / test).exists() for tests in CONCERNED.values() for test in tests.split()
    )
