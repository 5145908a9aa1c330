"""How late the pacer's frames leave, beside a bare sleep loop in the same run."""

import asyncio
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from links.core.port import Command, Segment
from links.rf.codecs.dsm_codec import DsmLinkConfig
from links.rf.pacer_messages import Arm, End, Give, Pacer, Report, Stop
from links.rf.pacer_process import open_process
from sim.radio.pty_wire import PtyWire

PERIOD_S = 0.0225
PRIORITY = 50
HOGS_PER_CPU = 1.5
"""Processes that compute and never wait, for each processor."""

_FLOOR_IN_PYTHON = """
import sys
from links.rf.pacer_child import Clock, prioritise
period, count, priority = int(sys.argv[1]) / 1e9, int(sys.argv[2]), int(sys.argv[3])
clock = Clock()
prioritise(priority, clock)
due, late = clock.now(), []
for _ in range(count):
    due += period
    clock.sleep_until(due)
    late.append(clock.now() - due)
print(*(int(1e6 * each) for each in late), sep="\\n")
"""


def measure(seconds: float, *, busy: bool) -> dict[str, Any]:
    """``{"pacer": {p50_us, p99_us, p999_us, lost}, "floor": {…}, "fifo": bool}`` of ``seconds`` [s] at 22.5 ms.

    The pacer is armed and gets a new command for each frame. Its lateness is taken when the frame is written, the
    floor's when it wakes up. Both have the same scheduling policy: real-time where that is allowed, and ``fifo`` tells.
    With ``busy``, processes that never wait have every processor meanwhile.
    """
    return asyncio.run(_measure(seconds, busy))


async def _measure(seconds: float, busy: bool) -> dict[str, Any]:
    count = max(10, round(seconds / PERIOD_S))
    reports: list[Report] = []
    came: list[bytes] = []
    wire = PtyWire()
    wire.listen(came.append)
    with tempfile.TemporaryDirectory(prefix="bench-") as folder, _hogs(busy):
        pacer = await open_process(
            DsmLinkConfig(port=wire.path, period_s=PERIOD_S, fifo_priority=PRIORITY),
            1.0,
            lambda report: reports.append(report) if report is not None else None,
        )
        flying = asyncio.create_task(_fly(pacer))
        try:
            fifo = reports[-1].fifo
            floor = await _floor(Path(folder), count, PRIORITY if fifo else 0)
        finally:
            flying.cancel()
            pacer.give(Stop())
            pacer.give(End(0.0))
            await pacer.ended()
            wire.close()
    last = reports[-1]
    p50, p99, p999 = last.late_us
    return {
        "pacer": {"p50_us": p50, "p99_us": p99, "p999_us": p999, "lost": last.lost},
        "floor": _figures(floor),
        "fifo": fifo,
    }


async def _fly(pacer: Pacer) -> None:
    loop = asyncio.get_running_loop()
    pacer.give(Arm(1, loop.time()))
    down = tuple(Segment(0.5, 0.4, (0.0, 0.0, 0.0)) for _ in range(4))
    while True:
        now = loop.time()
        pacer.give(Give(1, Command(0.5, (0.1, -0.1, 0.0), 1, now, now + 1.0, down)))
        await asyncio.sleep(PERIOD_S)


async def _floor(folder: Path, count: int, priority: int) -> list[int]:
    """Lateness of each wake-up of a bare loop [µs]: in C where there is a compiler."""
    words = [str(round(1e9 * PERIOD_S)), str(count), str(priority)]
    compiler = shutil.which("cc")
    if compiler is None:
        command = [sys.executable, "-c", _FLOOR_IN_PYTHON, *words]
    else:
        program = folder / "floor"
        source = Path(__file__).with_name("bench_floor.c")
        build = await asyncio.create_subprocess_exec(compiler, "-O2", "-o", str(program), str(source))
        if await build.wait() != 0:
            raise RuntimeError(f"{compiler} does not compile {source}")
        command = [str(program), *words]
    process = await asyncio.create_subprocess_exec(*command, stdout=subprocess.PIPE)
    out, _ = await process.communicate()
    return [int(line) for line in out.split()]


def _figures(late_us: list[int]) -> dict[str, int]:
    ordered = sorted(late_us)
    p50, p99, p999 = (ordered[min(len(ordered) - 1, int(share * len(ordered)))] for share in (0.5, 0.99, 0.999))
    lost = sum(1 for late in late_us if late >= 1e6 * PERIOD_S)
    return {"p50_us": p50, "p99_us": p99, "p999_us": p999, "lost": lost}


@contextmanager
def _hogs(busy: bool) -> Iterator[None]:
    """Every processor busy, or none."""
    count = round(HOGS_PER_CPU * (os.cpu_count() or 1)) if busy else 0
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()
