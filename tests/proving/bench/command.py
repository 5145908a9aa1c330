"""Run times of whole commands: `fly`, recording included, beside RotorPy's own flight."""

import os
import subprocess
import tempfile
from functools import partial
from importlib.util import find_spec
from statistics import median
from typing import Any

from links.io import make_child_command
from tests.proving.bench.bench import Options, in_turns

DURATIONS_S = (20.0, 60.0)
PEER = "rotorpy: a circle of 20 s, nothing recorded"
PEER_S = 20.0
ROUNDS = 5
GOAL_SHARE = 0.25
"""Share of the peer's time for a flight as long [-]."""


def measure(options: Options) -> dict[str, Any]:
    """Processor time of each command, user's and system's, measured in turns."""
    with tempfile.TemporaryDirectory() as folder:
        fly = make_child_command("sim", "fly", "--out", folder, "--duration")
        commands = {f"fly --duration {seconds:g}": (seconds, [*fly, str(seconds)]) for seconds in DURATIONS_S}
        note = ""
        if options.peers and find_spec("rotorpy") is None:
            note = "rotorpy is not installed: `make bench` installs it, or `uv sync --group peers`"
        elif options.peers:
            commands[PEER] = PEER_S, make_child_command("tests.proving.bench.batch", str(PEER_S))
        spent: dict[str, list[float]] = {name: [] for name in commands}
        walls = in_turns(
            {name: partial(_note, command, spent[name]) for name, (_, command) in commands.items()}, ROUNDS
        )
    rows: list[dict[str, Any]] = [
        {"name": name, "flown_s": commands[name][0], "cpu_s": median(found[1:] or found), "wall_s": walls[name]}
        for name, found in spent.items()
    ]
    peer = next((row["cpu_s"] for row in rows if row["name"] == PEER), None)
    for row in rows:
        row["share"] = row["cpu_s"] / peer if peer and row["flown_s"] == PEER_S else None
    return {"rounds": ROUNDS, "goal_share": GOAL_SHARE, "rows": rows, "note": note}


def _note(command: list[str], spent: list[float]) -> None:
    """Run ``command``, and note the processor time that it and its children took [s]."""
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL)  # noqa: S603  # our own words, no shell
    _, status, used = os.wait4(running.pid, 0)
    running.returncode = os.waitstatus_to_exitcode(status)
    if running.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with exit code {running.returncode}")
    spent.append(used.ru_utime + used.ru_stime)


def text(facts: dict[str, Any]) -> list[str]:
    """One line a command."""
    lines = []
    for row in facts["rows"]:
        share = f"  {row['share']:.3f} of rotorpy's" if row["share"] is not None and row["name"] != PEER else ""
        lines.append(f"{row['name']:48}{row['cpu_s']:7.2f} s of a processor, {row['wall_s']:.2f} s{share}")
    goal = f"goal: {facts['goal_share']:g} of rotorpy's time for a flight as long"
    return [*lines, facts["note"] or f"{goal} (medians of {facts['rounds']})"]
