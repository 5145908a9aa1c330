"""Growth of the interpreter's objects and memory over a flight in virtual time."""

import asyncio
import gc
import sys
from pathlib import Path

from groundstation.flight import make_flight
from groundstation.machine import sleep_until
from sim.runs import Stage, confirm_at
from sim.scenarios import SCENARIOS, prepare
from sim.time import in_virtual_time


def look() -> dict[str, int]:
    """Count the interpreter's objects and memory after a full collection."""
    gc.collect()
    resident = int(Path("/proc/self/statm").read_text("utf-8").split()[1]) * 4096
    return {
        "objects": len(gc.get_objects()),
        "blocks": sys.getallocatedblocks(),
        "resident_bytes": resident,
    }


@in_virtual_time
async def looks_within(duration_s: float, count: int) -> list[dict[str, int]]:
    """Looks at the start of an `adverse` flight without a referee, and ``count`` after."""
    world, config = prepare(SCENARIOS["adverse"], [])

    stage, flight = Stage(world, config, 0), make_flight(config, confirm=confirm_at(0.0))
    parts = [asyncio.ensure_future(part.run()) for part in (stage, flight)]
    start, looks = asyncio.get_running_loop().time(), []
    for index in range(count + 1):
        await sleep_until(start + duration_s * index / count)
        assert not any(part.done() for part in parts)
        looks.append(look())
    for part in parts:
        part.cancel()
    await asyncio.gather(*parts, return_exceptions=True)
    return looks
