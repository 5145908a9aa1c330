"""Recordings of simulated flights, flown once each however many tests look at them."""

import atexit
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

from groundstation.recording.records import Record
from sim.cli.run_folder import RECORDING, RunFolder
from sim.runs.fly import Result, fly
from sim.scenarios.prepare import prepare
from sim.scenarios.scenarios import SCENARIOS


def _remove(folder: Path, owner: int) -> None:
    if os.getpid() == owner:  # a test may fork
        shutil.rmtree(folder, ignore_errors=True)


@cache
def recorded(
    scenario: str = "paper", *overrides: str, seed: int = 0, duration_s: float = 8.0, source: str = "vicon"
) -> tuple[Path, Result, tuple[Record, ...]]:
    """The recording, the result, and the records of one flight. The file is shared: nobody may change it."""
    folder = Path(tempfile.mkdtemp(prefix="gs-"))
    atexit.register(_remove, folder, os.getpid())
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source)
    run = RunFolder(folder, config, world, scenario=scenario, seed=seed)
    records: list[Record] = []

    def give(record: Record) -> None:
        records.append(record)
        run.give(record)

    result = fly(world, config, seed=seed, duration_s=duration_s, give=give)
    run.close({"completed": result.completed, "why": result.why})
    return folder / RECORDING, result, tuple(records)
