"""``make release`` refuses what is not ready, before it builds anything."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def project(needs_program: Callable[..., str], tmp_path: Path) -> Path:
    """A repository with what the release script looks at first, ready to be released as 0.1.0."""
    needs_program("git")
    needs_program("bash")
    shutil.copytree(ROOT / ".ci", tmp_path / ".ci")
    (tmp_path / ".venv").symlink_to(ROOT / ".venv")
    (tmp_path / ".gitignore").write_text(".venv\n", "utf-8")
    (tmp_path / "pyproject.toml").write_text(
        '[project]\nname = "quadrotor-groundstation"\nversion = "0.1.0"\n', "utf-8"
    )
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## 0.1.0 (unreleased)\n\n- It flies.\n", "utf-8")
    git(tmp_path, "init", "--quiet")
    commit(tmp_path)
    return tmp_path


def git(folder: Path, *words: str) -> str:
    who = ("-c", "user.name=Ann", "-c", "user.email=ann@example.org")
    return subprocess.run(["git", *who, *words], cwd=folder, capture_output=True, text=True, check=True).stdout


def commit(folder: Path) -> None:
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", "All")


def refused(folder: Path) -> str:
    """Why the release was refused; nothing has been built or tagged."""
    tags = git(folder, "tag")
    done = subprocess.run(
        ["bash", ".ci/release"], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1, done.stderr
    assert git(folder, "tag") == tags
    assert not (folder / "dist").exists()
    return done.stderr


def test_changes_that_are_not_committed(project: Path) -> None:
    (project / "CHANGELOG.md").write_text("", "utf-8")
    assert refused(project) == "no release of 0.1.0: there are changes that are not committed\n"


def test_a_version_that_is_tagged(project: Path) -> None:
    git(project, "tag", "v0.1.0")
    assert "the tag v0.1.0 exists" in refused(project)


@pytest.mark.parametrize(
    "text", ["## 0.1.0 (2026-01-01)\n\n- It flies.\n", "## 0.1.0 (unreleased)\n\n## 0.0.9\n\n- No.\n"]
)
def test_a_changelog_that_says_nothing_of_it(text: str, project: Path) -> None:
    (project / "CHANGELOG.md").write_text(text, "utf-8")
    commit(project)
    assert "CHANGELOG.md has no '## 0.1.0 (unreleased)'" in refused(project)
