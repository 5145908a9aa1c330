"""Recordings of simulated flights, flown once in a run of tests however many of them look at it."""

from functools import cache
from pathlib import Path

import msgspec

from groundstation.recording import Record
from sim.runs import RECORDING, fly
from sim.runs.flight import Result
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from tests.flown_once import folder_of, once


@cache
def recorded(
    scenario: str = "paper", *overrides: str, seed: int = 0, duration_s: float = 8.0, source: str = "vicon"
) -> tuple[Path, Result, tuple[Record, ...]]:
    """The recording, the result, and the records of one flight. The file is shared: nobody may change it."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source)

    def make(folder: Path) -> tuple[Result, tuple[Record, ...]]:
        run = RunFolder(folder, config, world, scenario=scenario, seed=seed)
        records: list[Record] = []

        def give(record: Record) -> None:
            records.append(record)
            run.give(record)

        result = fly(world, config, seed=seed, duration_s=duration_s, give=give)
        run.close({"completed": result.completed, "why": result.why, **msgspec.to_builtins(result.verdict)})
        return result, tuple(records)

    key = ("recorded", scenario, world, config, seed, duration_s)
    return folder_of(key) / RECORDING, *once(key, make)
