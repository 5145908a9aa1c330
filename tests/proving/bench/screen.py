"""What a dashboard costs the flight that it shows: pose to command without one and with one, in turns, in real time."""

import asyncio
import fcntl
import gc
import os
import pty
import struct
import termios
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from links.core import make_child_command
from tests.proving.bench.bench import Options
from tests.proving.bench.links import Answers, figures_of, lost_words, together
from tests.proving.bench.links import fly_latency as fly

RATE_HZ = 50
TURNS = 2
"""Flights without a dashboard, and as many with one."""
SIZE = 48, 160
"""Rows and columns of its terminal."""
LIMIT_US = 2000.0
"""Goal for the 99th percentile with a dashboard [µs]."""


def measure(options: Options) -> dict[str, Any]:
    """``options.seconds`` in all, half of them watched."""
    gc.collect()
    gc.freeze()
    found: dict[bool, list[Answers]] = {False: [], True: []}
    shares = list[float]()

    @asynccontextmanager
    async def dashboard(path: Path) -> AsyncIterator[None]:
        async with _dashboard(path, shares):
            yield

    for _ in range(TURNS):
        for watched in (False, True):
            seconds = options.seconds / (2 * TURNS)
            commands, _ = asyncio.run(fly(RATE_HZ, seconds, dashboard if watched else None))
            found[watched].append(commands)
    gc.unfreeze()
    return {
        "rate_hz": RATE_HZ,
        "without": figures_of(together(found[False])),
        "with": figures_of(together(found[True])),
        "dashboard_share": sum(shares) / len(shares),
        "goal_p99_us": LIMIT_US,
    }


@asynccontextmanager
async def _dashboard(path: Path, shares: list[float]) -> AsyncIterator[None]:
    """``groundstation tui`` on a terminal that somebody reads; its share of a processor goes into ``shares``."""
    loop = asyncio.get_running_loop()
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("4H", *SIZE, 0, 0))
    os.set_blocking(ours, False)
    loop.add_reader(ours, os.read, ours, 1 << 20)
    words = make_child_command("groundstation", "tui", "--socket", str(path))
    environment = os.environ | {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
    screen = await asyncio.create_subprocess_exec(*words, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
    begun_s, before_s = loop.time(), _processor_s(screen.pid)
    try:
        yield
        shares.append((_processor_s(screen.pid) - before_s) / (loop.time() - begun_s))
    finally:
        screen.kill()
        await screen.wait()
        loop.remove_reader(ours)
        os.close(theirs)
        os.close(ours)


def _processor_s(pid: int) -> float:
    """Processor time of a process so far [s], as Linux has it (proc(5))."""
    fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def text(facts: dict[str, Any]) -> list[str]:
    """Three lines."""
    lines = [f"pose's datagram in to command's datagram out, {facts['rate_hz']:g} Hz"]
    for name in ("without", "with"):
        these = facts[name]
        lines.append(
            f"{name:8} a dashboard: 50 % within {these['p50_us']:.0f} µs, 99 % {these['p99_us']:.0f}, 99.9 % "
            f"{these['p999_us']:.0f}; {lost_words(these)}"
        )
    lines[-1] += f" (goal: 99 % below {facts['goal_p99_us']:.0f} µs)"
    return [*lines, f"the dashboard takes {100.0 * facts['dashboard_share']:.0f} % of a processor, its start included"]
