"""A recording of somebody else's: nothing in it runs, and nothing in it steers the screen."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation import __main__ as program
from groundstation.analysis import replay_command
from groundstation.analysis.replay import replay_facts
from groundstation.analysis.report import figures
from groundstation.config import ConfigError
from groundstation.interfaces.tui.app import Tape
from tests.e2e.stations import run_here
from tests.recordings import recorded, rewrite

MODULE = """import pathlib

from groundstation.core.control.controllers import Pid

pathlib.Path({mark!r}).touch()


def make(vehicle, options):
    return Pid().build(vehicle)
"""
OWN = 'kind = "custom"\nfactory = "{module}:make"\n'


def changed(target: Path, edit: Callable[[dict[str, str]], dict[str, str]]) -> Path:
    """A recording that says something else about itself."""
    return rewrite(recorded()[0], target, about=edit)


def flown_by(module: str) -> Callable[[dict[str, str]], dict[str, str]]:
    def edit(about: dict[str, str]) -> dict[str, str]:
        config = about["config"]
        begin = config.index("[controller]\n") + len("[controller]\n")
        end = config.index("\n[", begin)
        return {**about, "config": config[:begin] + OWN.format(module=module) + config[end:]}

    return edit


@pytest.fixture
def foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """A recording that names a module, and the file that appears once somebody imports it."""
    mark = tmp_path / "imported"
    module = f"foreign_{os.getpid()}_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{module}.py").write_text(MODULE.format(mark=str(mark)))
    monkeypatch.syspath_prepend(tmp_path)
    return changed(tmp_path / "foreign.mcap", flown_by(module)), mark


def test_no_module_that_a_recording_names_is_imported_unasked(foreign: tuple[Path, Path]) -> None:
    path, mark = foreign
    for overrides in ((), ("vehicle.mass_kg=0.1",)):
        with pytest.raises(ConfigError) as error:
            replay_facts(path, overrides)
        assert error.value.key == "controller.kind"
        assert "--trust-modules" in str(error.value)
        assert str(path) in str(error.value)
    Tape(path)
    assert not mark.exists()


def test_it_is_where_the_operator_says_so(foreign: tuple[Path, Path], tmp_path: Path) -> None:
    path, mark = foreign
    (tmp_path / "of_my_own.py").write_text(
        "from groundstation.core.control.controllers import Pid\nmake = lambda v, _: "
        "Pid().build(v)\n"
    )
    assert replay_facts(path, ["controller.factory=of_my_own:make"])["commands"] > 300
    assert not mark.exists()
    assert replay_facts(path, trust_modules=True)["commands"] > 300
    assert mark.exists()


@pytest.mark.parametrize(
    "config", [".".join(["a"] * 3_000) + " = 1", "x = ]", "x = " + "[" * 3_000]
)
def test_a_configuration_that_is_none_is_told_by_the_name_of_the_file(
    config: str, tmp_path: Path
) -> None:
    path = changed(tmp_path / "broken.mcap", lambda about: {**about, "config": config})
    with pytest.raises(ConfigError) as error:
        replay_command(path, [], as_json=False)
    assert str(path) in str(error.value)
    assert "the configuration in it is no" in str(error.value)
    Tape(path)


def test_a_list_of_recordings_shows_letters_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hostile = "\x1b]0;owned\x07\r\n20260101-000000-mqx.mcap  landed\u202e"
    path = tmp_path / "20260101-000000-mqx.mcap"
    changed(path, lambda about: {**about, "controller": hostile})
    monkeypatch.setattr(figures, "FIGURES", figures.FIGURES[:1])
    page = ("report", path, "--out", tmp_path / "page.html")
    for words in (("logs", tmp_path), page, ("replay", path)):
        out = run_here(program.main, *words).stdout
        assert all(line.isprintable() for line in out.split("\n")), words
