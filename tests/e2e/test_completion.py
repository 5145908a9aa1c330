"""A key press in a shell completes our command lines; no program of ours runs for it."""

import os
import pty
import select
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

SHELLS = {
    "bash": ["--norc", "--noprofile", "-i"],
    "zsh": ["-f", "-i"],
}
BEGIN = {"bash": "PS1=; bind 'set enable-bracketed-paste off'", "zsh": "PS1=; autoload -U compinit; compinit -u"}
DEADLINE_S = 60.0
BIN = Path(sys.executable).parent


def completed(shell: str, program: str, script: Path, typed: str, expected: str, folder: Path) -> str:
    """What an interactive ``shell`` has shown after ``typed`` and a tab, as soon as ``expected`` is in it."""
    far, near = pty.openpty()
    environment = {"PATH": "/usr/bin:/bin", "TERM": "dumb", "HOME": str(folder)}  # nothing of ours is to be run
    process = subprocess.Popen(
        [program, *SHELLS[shell]], stdin=near, stdout=near, stderr=near, env=environment, cwd=folder,
        start_new_session=True,
    )  # fmt: skip
    os.close(near)
    shown = ""
    try:
        for text, until in (
            (f"{BEGIN[shell]}; eval \"$(cat '{script}')\"; echo re''ady\n", "ready"),
            (f"{typed}\t", expected),
        ):
            os.write(far, text.encode())
            shown = ""
            while until not in shown:
                if not select.select([far], [], [], DEADLINE_S)[0]:
                    return shown
                shown += os.read(far, 65536).decode(errors="replace").replace("\b", "").replace("\r\n", "\n")
        return shown
    finally:
        process.kill()
        process.wait()
        os.close(far)


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        ("groundstation-sim miss", "groundstation-sim mission "),
        ("groundstation-sim fly --dura", "--duration "),
        ("groundstation-sim fly --scenario gust", "gust_front "),
        ("groundstation-sim fly --set sim.mass", "sim.mass_kg="),
        ("groundstation-sim fly --set vehicle.mass", "vehicle.mass_kg="),
        ("groundstation fly --set vehicle.mass", "vehicle.mass_kg="),
        ("groundstation rf-bridge --set key", "key_file="),
        ("groundstation config new px4-v", "px4-vicon "),
        ("groundstation config show roo", "room.toml"),
    ],
)
def test_a_tab_completes_commands_scenarios_keys_and_files(
    shell: str, typed: str, expected: str, tmp_path: Path, needs_program: Callable[..., str]
) -> None:
    program = needs_program(shell)
    (tmp_path / "room.toml").touch()
    script = tmp_path / "script"
    with script.open("w") as output:
        subprocess.run([BIN / typed.split(maxsplit=1)[0], "completion", shell], stdout=output, check=True)
    assert expected in completed(shell, program, script, typed, expected, tmp_path)
