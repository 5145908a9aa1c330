"""A key press in a shell completes our command lines; no program of ours runs for it."""

import os
import pty
import select
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from groundstation.__main__ import main as flying_main
from sim.__main__ import main as simulating_main
from tests.e2e.stations import run_here

SHELLS = {"bash": ["--norc", "--noprofile", "-i"], "zsh": ["-f", "-i"]}
BEGIN = {
    "bash": "PS1=; bind 'set enable-bracketed-paste off'",
    "zsh": "PS1=; autoload -U compinit; compinit -u",
}
DEADLINE_S = 60.0
LINES = {
    "groundstation-sim miss": "groundstation-sim mission ",
    "groundstation-sim fly --dura": "--duration ",
    "groundstation-sim fly gust": "gust_front ",
    "groundstation-sim fly --set sim.mass": "sim.mass_kg=",
    "groundstation-sim fly --set vehicle.mass": "vehicle.mass_kg=",
    "groundstation radio bridge --set key": "key_file=",
    "groundstation fly --set vehicle.mass": "vehicle.mass_kg=",
    "groundstation config new px4-v": "px4-vicon ",
    "groundstation fleet roo": "room.toml",
    "groundstation-sim dev intervals --fli": "--flights ",
    "groundstation config show roo": "room.toml",
}
"""Lines and what a tab makes of them; no two alike in a row: a shell may still draw one."""
ONLY_BASH = {"groundstation fleet relay --unt": "--until-eof "}
"""A command below one that has arguments of its own."""
FORGET = "\x15"
"""Ctrl-U: the line is empty again."""


def lines_of(shell: str) -> dict[str, str]:
    """All that is typed in ``shell``."""
    return LINES | ONLY_BASH if shell == "bash" else LINES


def shown_for(shell: str, program: str, scripts: list[Path], folder: Path) -> dict[str, str]:
    """The output of an interactive ``shell`` after each line and a tab."""
    far, near = pty.openpty()
    # Nothing of ours is to be run.
    environment = {"PATH": "/usr/bin:/bin", "TERM": "dumb", "HOME": str(folder)}
    process = subprocess.Popen(
        [program, *SHELLS[shell]], stdin=near, stdout=near, stderr=near, env=environment,
        cwd=folder,
        start_new_session=True,
    )  # fmt: skip
    os.close(near)

    def type_until(text: str, expected: str) -> str:
        os.write(far, text.encode())
        shown = ""
        while expected not in shown and select.select([far], [], [], DEADLINE_S)[0]:
            shown += (
                os.read(far, 65536).decode(errors="replace").replace("\b", "").replace("\r\n", "\n")
            )
        return shown

    try:
        sourced = "; ".join(f"eval \"$(cat '{script}')\"" for script in scripts)
        type_until(f"{BEGIN[shell]}; {sourced}; echo re''ady\n", "ready")
        return {
            typed: type_until(f"{FORGET}{typed}\t", expected)
            for typed, expected in lines_of(shell).items()
        }
    finally:
        process.kill()
        process.wait()
        os.close(far)


@pytest.mark.parametrize("shell", SHELLS)
def test_a_tab_completes_commands_scenarios_keys_and_files(
    shell: str, tmp_path: Path, needs_program: Callable[..., str]
) -> None:
    program = needs_program(shell)
    (tmp_path / "room.toml").touch()
    scripts = []
    for ours, main, *command in (
        ("groundstation", flying_main, "config", "completion"),
        ("groundstation-sim", simulating_main, "completion"),
    ):
        scripts.append(tmp_path / ours)
        scripts[-1].write_text(run_here(main, *command, shell).stdout, "utf-8")
    for typed, shown in shown_for(shell, program, scripts, tmp_path).items():
        assert lines_of(shell)[typed] in shown, typed
