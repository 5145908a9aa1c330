"""How the programs start, and which packages they need."""

import io
import json
import shlex
import sys
from importlib import import_module
from types import SimpleNamespace
from typing import Any

import pytest

from groundstation.runtime import packages
from groundstation.runtime.entry import Exit, _GuardedStream


@pytest.mark.parametrize("program", ["groundstation", "groundstation-sim"])
def test_ctrl_c_while_a_program_is_loaded_is_one_line(
    program: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(module: str) -> None:
        raise KeyboardInterrupt

    # The launcher puts a finder there, for good.
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path])
    launch = import_module("groundstation.runtime.launch")
    monkeypatch.setattr(launch, "import_module", interrupt)
    assert getattr(launch, f"run_{program.replace('-', '_')}")() == Exit.INTERRUPTED
    assert capsys.readouterr().err == f"{program}: interrupted\n"


@pytest.mark.parametrize("origin, what", [
    ({"url": "file:///lab/a%20clone", "dir_info": {"editable": True}}, ["-e",
        "/lab/a clone[tune]"]),
    ({"url": "file:///lab/clone", "dir_info": {}}, ["/lab/clone[tune]"]),
    ({"url": "file:///tmp/quadrotor_groundstation-0.1.0-py3-none-any.whl", "archive_info": {}},
     ["/tmp/quadrotor_groundstation-0.1.0-py3-none-any.whl[tune]"]),
    (None, ["quadrotor-groundstation[tune]"]),  # from an index: the name is known there
])  # fmt: skip
def test_an_extra_is_installed_from_where_the_program_came(
    monkeypatch: pytest.MonkeyPatch, origin: dict[str, object] | None, what: list[str]
) -> None:
    text = None if origin is None else json.dumps(origin)
    monkeypatch.setattr(
        "importlib.metadata.distribution", lambda _: SimpleNamespace(read_text=lambda _: text)
    )
    words = shlex.split(packages.describe_install("tune"))
    assert words == [sys.executable, "-m", "pip", "install", *what]


def test_quoted_text_does_not_control_the_terminal_by_any_way_of_writing() -> None:
    shown = io.StringIO()
    guarded: Any = _GuardedStream(shown)
    guarded.write("a\x1b[2Jb\n")
    guarded.writelines(["c\x07d\n", "e\tf"])
    assert not any(sign in shown.getvalue() for sign in "\x1b\x07")
    assert [line[0] + line[-1] for line in shown.getvalue().split("\n")] == ["ab", "cd", "ef"]
