"""Hours of virtual flight: does anything grow? Objects, allocated blocks and resident memory are looked at in between.

The flight is `fly`'s without its referee, which keeps every step, and without a log of the wire.
"""

import asyncio
import gc
import sys
from pathlib import Path
from typing import Any

from groundstation.flight import make_flight
from groundstation.machine import sleep_until
from sim.runs import Stage
from sim.scenarios import SCENARIOS, prepare
from sim.time import in_virtual_time
from tests.proving.bench.bench import Options

SCENARIO = "adverse"
LOOKS = 20
"""Looks spread over the flight. The first quarter is warm-up: deques and caches fill."""
PAGE_BYTES = 4096
"""Size of a memory page [bytes]."""


def look() -> dict[str, int]:
    """Count the interpreter's objects and memory after a full collection."""
    gc.collect()
    statm = Path("/proc/self/statm")
    resident = int(statm.read_text(encoding="utf-8").split()[1]) * PAGE_BYTES if statm.exists() else 0
    return {"objects": len(gc.get_objects()), "blocks": sys.getallocatedblocks(), "resident_bytes": resident}


@in_virtual_time
async def _fly(duration_s: float) -> list[dict[str, int]]:
    world, config = prepare(SCENARIOS[SCENARIO], [])

    async def confirm() -> bool:
        return True

    flight = make_flight(config, confirm=confirm)
    stage = asyncio.create_task(Stage(world, config, 0).run())
    flying = asyncio.create_task(flight.run())
    loop = asyncio.get_running_loop()
    start, looks = loop.time(), []
    try:
        for index in range(LOOKS + 1):
            await sleep_until(start + duration_s * index / LOOKS)
            if flying.done() or stage.done():
                raise RuntimeError("the flight ended early")
            looks.append(look())
    finally:
        for task in (flying, stage):
            task.cancel()
        await asyncio.gather(flying, stage, return_exceptions=True)
    return looks


def measure_growth(hours: float) -> dict[str, Any]:
    """Fly for ``hours``; growth is from the end of the first quarter to the end of the flight."""
    looks = _fly(3600.0 * hours)
    first, last = looks[LOOKS // 4], looks[-1]
    return {
        "scenario": SCENARIO,
        "hours": hours,
        **{f"{key}_grown": last[key] - first[key] for key in first},
        **{f"{key}_end": last[key] for key in last},
    }


def measure(options: Options) -> dict[str, Any]:
    """The figures of one flight."""
    return measure_growth(options.hours)


def text(facts: dict[str, Any]) -> list[str]:
    """One line."""
    return [
        f"{facts['scenario']}, {facts['hours']:g} h: {facts['objects_grown']:+d} objects of {facts['objects_end']}, "
        f"{facts['blocks_grown']:+d} allocated blocks of {facts['blocks_end']}, "
        f"{facts['resident_bytes_grown'] / 1048576:+.1f} MiB of {facts['resident_bytes_end'] / 1048576:.0f}"
    ]
