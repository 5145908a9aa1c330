"""Cost of a dashboard and of a viewer: pose to command without and with each, in turns.

The flight records in every turn, so that what is compared is who looks on.
"""

import asyncio
import fcntl
import gc
import os
import pty
import struct
import termios
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from links.io import make_child_command
from tests.proving.bench.bench import Options
from tests.proving.bench.links import Answers, figures_of, lost_words, together
from tests.proving.bench.links import fly_latency as fly

RATE_HZ = 50
"""Rate of the poses [1/s]."""
TURNS = 2
"""Flights that nobody looks at, as many with a dashboard, and as many with a viewer."""
SIZE = 48, 160
"""Rows and columns of the dashboard's terminal."""
LIMIT_US = 2000.0
"""Goal for the 99th percentile with a dashboard, and with a viewer [µs]."""
NO_VIEWER = "foxglove-sdk is not installed"
"""Why there is no row of a viewer."""
Watch = Callable[[Path], AbstractAsyncContextManager[None]]


def measure(options: Options) -> dict[str, Any]:
    """``options.seconds`` in all, an equal part of them watched by each."""
    gc.collect()
    gc.freeze()
    shares: dict[str, list[float]] = {"dashboard": [], "viewer": []}
    ways: dict[str, Watch | None] = {
        "without": None,
        "with": lambda path: _dashboard(path, shares["dashboard"]),
        "viewed": lambda path: _viewer(path, shares["viewer"]),
    }
    if any(find_spec(name) is None for name in ("foxglove", "aiohttp")):
        del ways["viewed"]
    found: dict[str, list[Answers]] = {name: [] for name in ways}
    for _ in range(TURNS):
        for name, watched in ways.items():
            commands, _ = asyncio.run(fly(RATE_HZ, options.seconds / (TURNS * len(ways)), watched))
            found[name].append(commands)
    gc.unfreeze()
    figures = {name: figures_of(together(answers)) for name, answers in found.items()}
    return {
        "rate_hz": RATE_HZ,
        **figures,
        "viewed": figures.get("viewed"),
        "note": "" if "viewed" in figures else NO_VIEWER,
        "dashboard_share": _mean(shares["dashboard"]),
        "viewer_share": _mean(shares["viewer"]),
        "goal_p99_us": LIMIT_US,
    }


def _mean(values: list[float]) -> float | None:
    return sum(values) / len(values) if values else None


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
    try:
        async with _measure([screen], shares):
            yield
    finally:
        loop.remove_reader(ours)
        os.close(theirs)
        os.close(ours)


@asynccontextmanager
async def _viewer(path: Path, shares: list[float]) -> AsyncIterator[None]:
    """``groundstation view`` on the recording as it grows, as ``fly --view`` opens it, and a client of it.

    Foxglove's server in the place of Rerun's window: both read the file and make the same scene of it.
    """
    while not (found := list(path.parent.glob("flights/*.mcap"))):  # noqa: ASYNC110  # another process's file
        await asyncio.sleep(0.1)
    place = f"127.0.0.1:{await _free_port()}"
    words = make_child_command("groundstation", "view", str(found[0]), "--in", "foxglove", "--listen", place)
    viewer = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.PIPE)
    assert viewer.stdout is not None, "a pipe"
    if not await viewer.stdout.readline():
        raise RuntimeError("the viewer has ended already")
    onlooker = make_child_command("tests.proving.bench.onlooker", place.partition(":")[2])
    client = await asyncio.create_subprocess_exec(*onlooker)
    async with _measure([viewer, client], shares):
        yield


async def _free_port() -> int:
    server = await asyncio.get_running_loop().create_server(asyncio.Protocol, "127.0.0.1", 0)
    port: int = server.sockets[0].getsockname()[1]
    server.close()
    return port


@asynccontextmanager
async def _measure(processes: Sequence[asyncio.subprocess.Process], shares: list[float]) -> AsyncIterator[None]:
    """Add the processor share of the first of ``processes`` to ``shares``; end all."""
    loop = asyncio.get_running_loop()
    begun_s = loop.time()
    try:
        yield
        shares.append(_processor_s(processes[0].pid) / (loop.time() - begun_s))
    finally:
        for process in processes:
            if process.returncode is None:
                process.kill()
            await process.wait()


def _processor_s(pid: int) -> float:
    """Processor time of a process so far [s], as Linux has it (proc(5))."""
    fields = Path(f"/proc/{pid}/stat").read_text("utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def text(facts: dict[str, Any]) -> list[str]:
    """A line for each way of looking on, and what each takes."""
    goal = f"goal: 99 % below {facts['goal_p99_us']:.0f} µs"
    lines = [f"pose's datagram in to command's datagram out, {facts['rate_hz']:g} Hz ({goal})"]
    for name, whom in (("without", "unwatched"), ("with", "dashboard"), ("viewed", "viewer")):
        if (these := facts[name]) is None:
            lines.append(f"{whom:9} not measured: {facts['note']}")
            continue
        lines.append(
            f"{whom:9} 50 % within {these['p50_us']:.0f} µs ({these['p50_us'] / facts['without']['p50_us']:.2f}x), "
            f"99 % {these['p99_us']:.0f} ({these['p99_us'] / facts['without']['p99_us']:.2f}x), "
            f"99.9 % {these['p999_us']:.0f}; {lost_words(these)}"
        )
    shares = {"dashboard": facts["dashboard_share"], "viewer": facts["viewer_share"]}
    taken = [f"the {name} takes {100.0 * share:.0f} %" for name, share in shares.items() if share is not None]
    return [*lines, f"of a processor {', '.join(taken)}, its start included"]
