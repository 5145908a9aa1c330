"""How commands keep time: the pacer's frames beside a bare sleep loop, and pose to command beside a bare echo."""

import asyncio
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from links.core import Command, Segment
from links.rf import Arm, DsmLinkConfig, End, Give, Pacer, PacerReport, Stop, open_process
from sim.radio import PtyWire
from tests.proving.bench import latency as bench_latency

if TYPE_CHECKING:
    from tests.proving.bench.bench import Options


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


def measure_pacer(seconds: float, *, busy: bool) -> dict[str, Any]:
    """``{"pacer": {p50_us, p99_us, p999_us, lost}, "floor": {…}, "fifo": bool}`` of ``seconds`` [s] at 22.5 ms.

    The pacer is armed and gets a new command for each frame. Its lateness is taken when the frame is written, the
    floor's when it wakes up. Both have the same scheduling policy: real-time where that is allowed, and ``fifo`` tells.
    With ``busy``, processes that never wait have every processor meanwhile.
    """
    return asyncio.run(_measure(seconds, busy))


async def _measure(seconds: float, busy: bool) -> dict[str, Any]:
    count = max(10, round(seconds / PERIOD_S))
    reports: list[PacerReport] = []
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
            await pacer.wait_for_end()
            wire.close()
    last = reports[-1]
    p50, p99, p999 = last.late_us
    return {
        "pacer": {"p50_us": p50, "p99_us": p99, "p999_us": p999, "lost": last.lost},
        "floor": _pacer_figures(floor),
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


def _pacer_figures(late_us: list[int]) -> dict[str, int]:
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


def measure(options: "Options") -> dict[str, Any]:
    """The pacer idle and with every processor busy, ``options.seconds`` each; the latencies as long, all together."""
    idle = measure_pacer(options.seconds, busy=False)
    busy = measure_pacer(options.seconds, busy=True)
    latency = bench_latency.measure(options.seconds / len(bench_latency.RATES_HZ))
    return {
        **busy,
        "ratios": _ratios(busy["pacer"], busy["floor"]),
        "idle": {**idle, "ratios": _ratios(idle["pacer"], idle["floor"])},
        **latency,
        "latency_ratios": {
            rate: _ratios(figures, latency["echo"][rate]) for rate, figures in latency["pose_to_command"].items()
        },
        "seconds": options.seconds,
        "period_s": PERIOD_S,
    }


def _ratios(ours: dict[str, float], floor: dict[str, float]) -> dict[str, float]:
    keys = ("p50_us", "p99_us", "p999_us")
    return {key.removesuffix("_us"): round(ours[key] / max(floor[key], 1.0), 2) for key in keys}


def text(facts: dict[str, Any]) -> list[str]:
    """A few lines; see :func:`measure`."""
    policy = "real-time priority" if facts["fifo"] else "ordinary priority: SCHED_FIFO is not allowed here"
    lines = [f"lateness of frames every {1e3 * facts['period_s']:g} ms for {facts['seconds']:g} s, {policy}"]
    for name, these in (("processors busy", facts), ("idle", facts["idle"])):
        for what, label in (("pacer", "the pacer"), ("floor", "a bare loop")):
            lost = these[what]["lost"]
            lines.append(f"  {name:16} {label:12} {_figures(these[what])}; {lost} lost")
        lines.append(f"  {name:16} {'ratio':12} {_words(these['ratios'])}")
    lines.append("pose's datagram in to command's datagram out")
    for rate, ours in facts["pose_to_command"].items():
        lines.append(f"  {rate + ' Hz':16} {'the program':12} {_figures(ours)}; {lost_words(ours)}")
        lines.append(f"  {rate + ' Hz':16} {'a bare echo':12} {_figures(facts['echo'][rate])}")
        lines.append(f"  {rate + ' Hz':16} {'ratio':12} {_words(facts['latency_ratios'][rate])}")
    return lines


def _figures(these: dict[str, float]) -> str:
    return f"50 % within {these['p50_us']:.0f} µs, 99 % {these['p99_us']:.0f}, 99.9 % {these['p999_us']:.0f}"


def lost_words(these: dict[str, float]) -> str:
    """What became of the poses that had no command of their own."""
    return f"{these['overtaken']} overtaken by a newer pose, {these['unanswered']} unanswered"


def _words(ratios: dict[str, float]) -> str:
    return f"{ratios['p50']:g}, {ratios['p99']:g}, {ratios['p999']:g}"
