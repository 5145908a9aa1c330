"""How the programs start, and which packages they need."""

import json
import shlex
import sys
from importlib import import_module
from types import SimpleNamespace

import pytest

from groundstation.runtime import packages
from groundstation.runtime.entry import Exit


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
