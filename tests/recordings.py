"""Recordings of simulated flights, flown once in a run of tests however many of them look at it."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
from mcap.writer import Writer

from groundstation.recording import CHANNELS, Entry, Record, Recording
from groundstation.settings import Config
from sim.runs import RECORDING, MissionResult, fly, fly_mission
from sim.runs.flight import Result, Script
from sim.runs.simulation import RunFolder
from sim.scenarios import SCENARIOS, prepare
from sim.world import World
from tests.flown_once import folder_of, once


@cache
def recorded(
    scenario: str = "paper",
    *overrides: str,
    seed: int = 0,
    duration_s: float = 8.0,
    source: str = "vicon",
) -> tuple[Path, Result, tuple[Record, ...]]:
    """Recording, result and records of one flight; nobody may change the shared file."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source)

    def make(folder: Path) -> tuple[Result, tuple[Record, ...]]:
        run = RunFolder(folder, config, world, scenario=scenario, seed=seed)
        records: list[Record] = []

        def give(record: Record) -> None:
            records.append(record)
            run.give(record)

        result = fly(world, config, seed=seed, duration_s=duration_s, give=give)
        figures = msgspec.to_builtins(result.verdict)
        run.close({"completed": result.completed, "why": result.why, **figures})
        return result, tuple(records)

    key = ("recorded", scenario, world, config, seed, duration_s)
    return folder_of(key) / RECORDING, *once(key, make)


def record_mission(
    folder: Path,
    world: World,
    config: Config,
    script: Script | None = None,
    scenario: str = "paper",
) -> tuple[MissionResult, Path]:
    """A mission with ``script`` beside it, and its recording in ``folder``."""
    run = RunFolder(folder, config, world, scenario=scenario, seed=0)
    mission = fly_mission(world, config, seed=0, script=script, give=run.give)
    run.close({"completed": mission.landed, "why": mission.why})
    return mission, folder / RECORDING


def rewrite(
    path: Path,
    target: Path,
    *,
    about: Callable[[dict[str, str]], dict[str, str]] = dict,
    edit: Callable[[Entry], list[tuple[str, bytes]]] = lambda entry: [(entry.topic, entry.data)],
) -> Path:
    """A copy of a recording; ``edit`` gives what stands in the place of each entry."""
    recording = Recording(path)
    with target.open("wb") as file:
        writer: Any = Writer(file)
        writer.start()
        writer.add_metadata("about", about(recording.about))
        ids = {topic: writer.register_channel(topic, "json", 0) for topic in CHANNELS}
        for entry in recording.entries():
            for topic, data in edit(entry):
                writer.add_message(ids[topic], entry.stamp_ns, data, entry.stamp_ns)
        writer.finish()
    return target
