"""The wheel, installed where there is no clone, works wherever its user stands."""

import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
UV = Path(sys.executable).with_name("uv")


def run(*words: str | Path) -> None:
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the programs of a clean environment: the wheel, and what else this one has."""
    folder = tmp_path_factory.mktemp("a clean one")
    cache = ("--offline", "--quiet", "--cache-dir", folder / "cache")
    run(UV, "build", *cache, "--wheel", "--out-dir", folder, ROOT)
    (wheel,) = folder.glob("quadrotor_groundstation-*.whl")
    environment = folder / "venv"
    run(sys.executable, "-m", "venv", "--without-pip", environment)
    run(UV, "pip", "install", *cache, "--no-deps", "--python", environment / "bin/python", wheel)
    (packages,) = environment.glob("lib/python3*/site-packages")
    # A folder named by a .pth comes last, and the .pth in it, which leads to this clone, is not read.
    (packages / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"] + "\n", "utf-8")
    return environment / "bin"


@pytest.mark.matrix  # as the next
def test_it_is_the_wheel_that_runs(programs: Path) -> None:
    code = "import groundstation.runtime.launch, sim, sys; sys.exit(not sim.__file__.startswith(sys.prefix))"
    run(programs / "python", "-P", "-c", code)


@pytest.mark.matrix  # unit/links/io/test_child.py has files of the user; `make release` checks each wheel so
def test_the_programs_need_no_clone_and_take_no_file_of_the_user_for_a_module_of_theirs(programs: Path) -> None:
    run("sh", ROOT / ".ci/check-installed", programs)
