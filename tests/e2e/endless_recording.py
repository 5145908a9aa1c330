"""Hands records to the recorder's own process at 100 Hz until it is killed; the argument is their folder.

Prints the time of every command once it was handed over.
"""

import asyncio
import sys

from groundstation.core.messages import Pose, Tick, TickRecord
from groundstation.core.pilot import Pilot
from groundstation.flight import about
from groundstation.machine import RecordingConfig
from groundstation.recording import ReceivedRecord, RecorderProcess, SentRecord
from groundstation.settings import Config


def a_tick() -> Tick:
    """One command of a pilot on its first pose."""
    config = Config()
    pilot = Pilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
    pilot.add_pose(Pose(0, 0.0, 0.02, (0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0)))
    pilot.follow(config.trajectory.build(), 0.0)
    return pilot.tick(0.03)


async def record(folder: str) -> None:
    """Until killed."""
    loop = asyncio.get_running_loop()
    tick = a_tick()
    process = RecorderProcess(RecordingConfig(folder=folder), about(Config()), lambda text, *_: print(text))
    while True:
        now = loop.time()
        process.give(ReceivedRecord(now, 0, 0, ("127.0.0.1", 1), b"x" * 90))
        process.give(TickRecord(tick._replace(time_s=now)))
        process.give(SentRecord(now, 1, ("127.0.0.1", 2), b"y" * 53))
        print(repr(now), flush=True)
        await asyncio.sleep(0.01)


if __name__ == "__main__":
    asyncio.run(record(sys.argv[1]))
