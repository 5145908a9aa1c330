"""The launcher: Ctrl-C before the program is there."""

import sys
from importlib import import_module

import pytest

from groundstation.runtime.entry import Exit


@pytest.mark.parametrize("program", ["groundstation", "groundstation-sim"])
def test_ctrl_c_while_a_program_is_loaded_is_one_line(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(module: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])  # the launcher puts a finder there, for good
    launch = import_module("groundstation.runtime.launch")
    monkeypatch.setattr(launch, "import_module", interrupt)
    monkeypatch.setattr(launch.gc, "freeze", lambda: None)  # this process goes on
    assert getattr(launch, f"run_{program.replace('-', '_')}")() == Exit.INTERRUPTED
    assert capsys.readouterr().err == f"{program}: interrupted\n"
