"""Cost of recording: a pilot at 100 Hz on a real event loop, with and without a recorder."""

import asyncio
import resource
import tempfile
from collections.abc import Callable
from statistics import median
from time import thread_time
from typing import Any

from groundstation.core.messages import FlightEvent, Pose, Tick, TickRecord
from groundstation.core.pilot import Pilot
from groundstation.flight import about
from groundstation.machine import RecordingConfig, sleep_until
from groundstation.recording import ReceivedRecord, Record, RecorderProcess, SentRecord
from groundstation.settings import Config
from tests.proving.bench.bench import Options

RATE_HZ = 100.0
"""Rate of the recorded commands [1/s]."""
TICKS = 300
"""In each turn."""
TURNS = 5
LIMIT = 0.05
"""Goal: so much of a tick's period at most."""
POSE_BYTES, COMMAND_BYTES = b"p" * 90, b"c" * 53
"""About what a pose takes on the wire, and a command does."""


async def fly_ticks(
    ticks: int, pilot: Pilot, config: Config, give: Callable[[Record], None] | None
) -> tuple[float, float]:
    """Processor time of this thread for a tick [s]: all of it, and from the pose's arrival to the command's leaving."""
    loop = asyncio.get_running_loop()
    trajectory = config.trajectory.build()
    first = loop.time()
    begun = thread_time()
    path: list[float] = []
    for number in range(ticks):
        await sleep_until(first + number / RATE_HZ)
        now = loop.time()
        start = thread_time()
        if give is not None:
            give(ReceivedRecord(now, 0, number, ("127.0.0.1", 51001), POSE_BYTES))
        at = trajectory.at(now - first).position_ned
        pilot.pose(Pose(number, now - 0.02, now, at, (1.0, 0.0, 0.0, 0.0)))
        if number == 0:
            pilot.follow(trajectory, now)
        pilot.tick(now)
        path.append(thread_time() - start)
        if give is not None:
            give(SentRecord(now, 1, ("127.0.0.1", 14540), COMMAND_BYTES))
    await asyncio.sleep(0.1)
    return (thread_time() - begun) / ticks, median(path)


async def turn(ticks: int, folder: str, *, recording: bool) -> tuple[float, float]:
    """One turn; see :func:`fly_ticks`."""
    config = Config()
    parts = config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m
    if not recording:
        return await fly_ticks(ticks, Pilot(*parts), config, None)
    recorder = RecorderProcess(RecordingConfig(folder=folder), about(config), lambda *_: None)
    await asyncio.sleep(1.0)  # its start is not what is measured

    def tell(event: FlightEvent | Tick) -> None:
        recorder.give(TickRecord(event) if isinstance(event, Tick) else event)  # type: ignore[arg-type]  # no notices here

    figures = await fly_ticks(ticks, Pilot(*parts, tell), config, recorder.give)
    await recorder.close()
    return figures


def compare(ticks: int, turns: int) -> dict[str, Any]:
    """The medians of so many turns of so many ticks, with and without."""
    found: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory(prefix="bench-") as folder:
        for _ in range(turns):
            for recording in (False, True):
                found[recording].append(asyncio.run(turn(ticks, folder, recording=recording)))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    all_of = {recording: 1e6 * median(whole for whole, _ in figures) for recording, figures in found.items()}
    path = {recording: 1e6 * median(path for _, path in figures) for recording, figures in found.items()}
    return {
        "rate_hz": RATE_HZ,
        "ticks": ticks * turns,
        "without_us": all_of[False],
        "with_us": all_of[True],
        "share_of_period": (all_of[True] - all_of[False]) * 1e-6 * RATE_HZ,
        "goal_share": LIMIT,
        "command_without_us": path[False],
        "command_with_us": path[True],
        "recorder_us": 1e6 * spent / (ticks * turns),
    }


def measure(options: Options) -> dict[str, Any]:
    """The figures."""
    del options
    return compare(TICKS, TURNS)


def text(facts: dict[str, Any]) -> list[str]:
    """Three lines."""
    return [
        f"a tick takes {facts['without_us']:.0f} µs of the flight's thread, {facts['with_us']:.0f} µs recorded: "
        f"{100.0 * facts['share_of_period']:.2f} % of its period at {facts['rate_hz']:g} Hz "
        f"(goal: below {100.0 * facts['goal_share']:g} %)",
        f"from pose to command {facts['command_without_us']:.0f} µs, recorded {facts['command_with_us']:.0f} µs",
        f"the recorder's own process takes {facts['recorder_us']:.0f} µs a tick, its start included",
    ]
