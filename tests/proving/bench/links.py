"""Timing of commands on this machine, ``groundstation-sim bench``.

An edge file: it reads the machine's clock.

Frames are timed beside a bare sleep loop, and the way from pose to command beside a bare echo.
``groundstation daemon`` flies a simulated vehicle that lives here; poses leave at 50, 100 and
250 Hz, and between any two of them a datagram of the same size goes to a bare asyncio echo in a
process of its own. Both times are taken here, by one clock. Poses are a thousandth slower than they
say: they slide along what the autopilot tells of itself.
"""

import argparse
import asyncio
import gc
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from groundstation.config import dump
from groundstation.machine import sleep_until
from groundstation.pose.sources import ViconConfig
from groundstation.runtime import Exit
from groundstation.settings import Config
from links.core import Command, Segment
from links.io import make_child_command, parse_address
from links.mavlink import MavlinkLinkConfig
from links.rf import Arm, DsmLinkConfig, End, Give, Pacer, PacerReport, Stop, open_process
from sim.autopilots import AutopilotPeer, Px4Autopilot
from sim.radio import PtyWire
from sim.scenarios import SCENARIOS, prepare
from sim.trackers import TrackedBody, vicon_encoder
from sim.world import Quadrotor, SimulatedVehicle, Wind, normals
from tests.loops import free_address


class LatencyFailed(Exception):
    """The measurement did not come to its end; the text says how far it came."""


class Answers(NamedTuple):
    """Times from sending to the answer [s]."""

    latencies_s: list[float]
    sent: int
    overtaken: int = 0
    """Poses that were answered, late, by the command that answered a newer one."""


class Waiting:
    """The poses that no command has answered yet. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self.latencies_s: list[float] = []
        self.overtaken = 0
        self._left: deque[float] = deque()

    def left(self, now_s: float) -> None:
        """A pose has left."""
        self._left.append(now_s)

    def command(self, computed_ms: int, now_s: float) -> None:
        """A command has come, computed in the millisecond ``computed_ms`` (modulo 2³²).

        It answers every pose that had left by then; one between two poses, from what is known,
        answers no pose.
        """
        answered = 0
        while self._left and (computed_ms - int(1e3 * self._left[0])) & 0xFFFFFFFF < 1 << 31:
            self.latencies_s.append(now_s - self._left.popleft())
            answered += 1
        self.overtaken += max(answered - 1, 0)


SHOWN = {"p50_us": 0.5, "p99_us": 0.99, "p999_us": 0.999}
"""Percentiles by the names of their figures."""


def find_percentiles(values: Sequence[float]) -> dict[str, float]:
    """Return the percentiles of :data:`SHOWN`, each one of ``values``."""
    found = np.quantile(values, list(SHOWN.values()), method="higher")
    return dict(zip(SHOWN, found.tolist(), strict=True))


def figures_of(answers: Answers) -> dict[str, float]:
    """Percentiles [µs] of all that were answered, overtaken ones too, and the counts."""
    found = answers.latencies_s
    if not found:
        raise LatencyFailed("nothing came back")
    return {
        **{name: round(1e6 * latency_s, 1) for name, latency_s in find_percentiles(found).items()},
        "count": len(found),
        "overtaken": answers.overtaken,
        "unanswered": answers.sent - len(found),
    }


def together(several: Sequence[Answers]) -> Answers:
    """Those of several flights as of one."""
    latencies_s, sent, overtaken = zip(*several, strict=True)
    return Answers([*chain.from_iterable(latencies_s)], sum(sent), sum(overtaken))


RATES_HZ = (50, 100, 250)
"""Poses per second."""
START_LIMIT_S = 20.0
"""Timeout for the program to arm the vehicle [s]."""
SETTLE_S = 1.0
"""Time at the beginning of each flight that is left out, and for its last answers [s]."""
MOST_FLIGHTS = 5
"""Most flights of one measurement: one ends where this machine stands still for 0.25 s."""
SLIDE = 1.001
"""The time between two poses, in nominal periods."""
_SET_POINT = b"\x52\x00\x00"


class _Peer(AutopilotPeer):
    """The autopilot's end, which notes when set-points arrive."""

    waiting: Waiting

    def datagram_received(self, data: bytes, addr: Any) -> None:
        if data[7:10] == _SET_POINT:
            # Its payload begins with time_boot_ms, by the clock that is ours too.
            boot_ms = int.from_bytes(data[10:14], "little")
            self.waiting.command(boot_ms, asyncio.get_running_loop().time())
        super().datagram_received(data, addr)


class _Echoes(asyncio.DatagramProtocol):
    """The other end of the echo."""

    def __init__(self) -> None:
        self.left_s: dict[bytes, float] = {}
        self.latencies_s: list[float] = []

    def datagram_received(self, data: bytes, addr: Any) -> None:
        left_s = self.left_s.pop(data, None)
        if left_s is not None:
            self.latencies_s.append(asyncio.get_running_loop().time() - left_s)


def measure_latency(seconds: float) -> dict[str, Any]:
    """Fly ``seconds`` [s] at each rate; see :func:`tests.proving.bench.links.figures_of`.

    Raises:
        LatencyFailed: nothing was armed, or flights ended again and again.
    """
    gc.collect()
    gc.freeze()
    figures: dict[str, Any] = {"pose_to_command": {}, "echo": {}}
    for rate in RATES_HZ:
        commands, echoes = asyncio.run(fly_latency(rate, seconds))
        figures["pose_to_command"][str(rate)] = figures_of(commands)
        figures["echo"][str(rate)] = figures_of(echoes)
    gc.unfreeze()
    return figures


async def fly_latency(rate_hz: int, seconds: float) -> tuple[Answers, Answers]:
    """The answers of commands, and of echoes, of as many flights as ``seconds`` [s] take."""
    flights: list[tuple[Answers, Answers]] = []
    for _ in range(MOST_FLIGHTS):
        flights.append(await _fly_once(rate_hz, seconds))
        seconds -= flights[-1][0].sent / rate_hz
        if seconds < 0.5:
            commands, echoes = zip(*flights, strict=True)
            return together(commands), together(echoes)
    raise LatencyFailed(
        f"{MOST_FLIGHTS} flights ended before the measurement did: let the machine do nothing else"
    )


async def _fly_once(rate_hz: int, seconds: float) -> tuple[Answers, Answers]:
    """The answers of one flight, which may end before ``seconds`` [s] are over."""
    with tempfile.TemporaryDirectory(prefix="latency-") as name:
        folder = Path(name)
        echo = await _process("tests.proving.bench.echo", stdout=PIPE)
        config = await _config(rate_hz, folder)
        path = folder / "flight.toml"
        path.write_text(dump(config), "utf-8")
        daemon = await _process("groundstation", "daemon", str(path), "--arm", config.vehicle.name)
        try:
            assert echo.stdout is not None
            port = int(await echo.stdout.readline())
            return await _measure_flight(config, rate_hz, seconds, port)
        finally:
            for process in (daemon, echo):  # only simulated vehicles are left to themselves
                process.kill()
                await process.wait()


async def _process(module: str, *words: str, stdout: int = DEVNULL) -> asyncio.subprocess.Process:
    command = make_child_command(module, *words)
    return await asyncio.create_subprocess_exec(
        *command, stdin=DEVNULL, stdout=stdout, stderr=DEVNULL
    )


async def _config(rate_hz: int, folder: Path) -> Config:
    period = 1.0 / rate_hz
    overrides = [
        f"link.listen={await free_address()}",
        f"pose.listen={await free_address()}",
        f"pose.rate_hz={rate_hz / SLIDE!r}",
        "pose.latency_s=0.0",
        f"link.period_s={period!r}",
        "link.pace=poses",
        f"vehicle.frame_period_s={period!r}",
        f"status.path={folder / 'status.sock'}",
        f"recording.folder={folder / 'flights'}",
    ]
    _, config = prepare(SCENARIOS["paper"], overrides)
    return config


async def _measure_flight(
    config: Config, rate_hz: int, seconds: float, port: int
) -> tuple[Answers, Answers]:
    loop, world = asyncio.get_running_loop(), SCENARIOS["paper"].world
    plant = Quadrotor(world, Wind(world, normals(0, "turbulence", 3)))
    plant.advance(loop.time())
    vehicle = SimulatedVehicle(plant, world, normals(0, "estimate", 6), normals(0, "wander", 3))
    autopilot = Px4Autopilot(vehicle)
    assert isinstance(config.link, MavlinkLinkConfig) and isinstance(config.pose, ViconConfig)
    peer = _Peer(autopilot, parse_address(config.link.endpoint))
    waiting = peer.waiting = Waiting()
    encode = vicon_encoder(config.pose)
    listener = parse_address(config.pose.listen)
    poses, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=listener)
    echo, echoes = await loop.create_datagram_endpoint(_Echoes, remote_addr=("127.0.0.1", port))
    running = asyncio.create_task(peer.run())
    period, frame, sent = SLIDE / rate_hz, 0, 0
    begun = loop.time()
    counts_from = None
    try:
        while counts_from is None or (loop.time() < counts_from + seconds and autopilot.armed):
            if running.done():
                running.result()
            due = begun + frame * period
            await sleep_until(due)
            seen = vehicle.measure(loop.time())
            body = TrackedBody(config.pose.object, seen.position_ned, seen.attitude, True)
            data = encode(frame, due, [body])
            counts = counts_from is not None and loop.time() >= counts_from
            if counts:
                waiting.left(loop.time())
            poses.sendto(data)
            frame += 1
            if counts_from is None and vehicle.plant.released_s is not None:
                counts_from = loop.time() + SETTLE_S
            if counts_from is None and loop.time() > begun + START_LIMIT_S:
                raise LatencyFailed(f"the vehicle was not armed within {START_LIMIT_S:g} s")
            await sleep_until(due + 0.5 * period)
            if counts:
                sent += 1
                echoes.left_s[data] = loop.time()
                echo.sendto(data)
            # After a standstill of this machine: no burst.
            if frame * period < loop.time() - begun - 0.5:
                begun += period
        await asyncio.sleep(SETTLE_S)
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        poses.close()
        echo.close()
    return Answers(waiting.latencies_s, sent, waiting.overtaken), Answers(echoes.latencies_s, sent)


MODULE = DsmLinkConfig()
"""Module whose frames are paced, every 22.5 ms."""
HOGS_PER_CPU = 1.5
"""Processes that compute and never wait, for each processor."""


async def measure_pacer(seconds: float, *, busy: bool) -> dict[str, Any]:
    """``{"pacer": {p50_us, p99_us, p999_us, lost}, "floor": {…}, "fifo": bool}`` in ``seconds``.

    The pacer is armed and gets a new command for each frame. Its lateness is taken when the frame
    is written, the floor's when it wakes up. Both have the same scheduling policy: real-time where
    that is allowed, which ``fifo`` tells. ``busy``: every processor has more to do than it can.
    """
    count = max(10, round(seconds / MODULE.period_s))
    reports: list[PacerReport] = []
    wire = PtyWire()
    wire.listen(lambda data: None)
    with tempfile.TemporaryDirectory(prefix="bench-") as folder, _hogs(busy):
        pacer = await open_process(
            replace(MODULE, port=wire.path),
            1.0,
            lambda report: reports.append(report) if report is not None else None,
        )
        flying = asyncio.create_task(_fly(pacer))
        try:
            fifo = reports[-1].fifo
            floor = await _floor(Path(folder), count, MODULE.fifo_priority if fifo else 0)
        finally:
            flying.cancel()
            pacer.give(Stop())
            pacer.give(End(0.0))
            await pacer.wait_for_end()
            wire.close()
    last = reports[-1]
    return {
        "pacer": {**dict(zip(SHOWN, last.late_us, strict=True)), "lost": last.lost},
        "floor": {
            **find_percentiles(floor),
            "lost": sum(late >= 1e6 * MODULE.period_s for late in floor),
        },
        "fifo": fifo,
    }


async def _fly(pacer: Pacer) -> None:
    loop = asyncio.get_running_loop()
    pacer.give(Arm(1, loop.time()))
    down = tuple(Segment(0.5, 0.4, (0.0, 0.0, 0.0)) for _ in range(4))
    while True:
        now = loop.time()
        pacer.give(Give(1, Command(0.5, (0.1, -0.1, 0.0), 1, now, now + 1.0, down)))
        await asyncio.sleep(MODULE.period_s)


async def _floor(folder: Path, count: int, priority: int) -> list[int]:
    """Lateness of each wake-up of a bare loop in C [µs]."""
    words = [str(round(1e9 * MODULE.period_s)), str(count), str(priority)]
    compiler = shutil.which("cc")
    program, source = folder / "floor", Path(__file__).with_name("bench_floor.c")
    if compiler is None:
        raise RuntimeError(f"no C compiler to compile {source} with: install one that is called cc")
    build = await asyncio.create_subprocess_exec(compiler, "-O2", "-o", str(program), str(source))
    if await build.wait() != 0:
        raise RuntimeError(f"{compiler} does not compile {source}")
    process = await asyncio.create_subprocess_exec(str(program), *words, stdout=PIPE)
    out, _ = await process.communicate()
    return [int(line) for line in out.split()]


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


def measure_all(seconds: float) -> dict[str, Any]:
    """Return the facts of the machine, and of its links: ``seconds`` [s] for each measurement."""
    idle, busy = (asyncio.run(measure_pacer(seconds, busy=busy)) for busy in (False, True))
    latency = measure_latency(seconds / len(RATES_HZ))
    links = {
        **busy,
        "ratios": _ratios(busy["pacer"], busy["floor"]),
        "idle": {**idle, "ratios": _ratios(idle["pacer"], idle["floor"])},
        **latency,
        "latency_ratios": {
            rate: _ratios(figures, latency["echo"][rate])
            for rate, figures in latency["pose_to_command"].items()
        },
        "seconds": seconds,
        "period_s": MODULE.period_s,
    }
    machine = {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpus": os.cpu_count(),
        "load": os.getloadavg()[0],
    }
    return {"machine": machine, "links": links}


def _ratios(ours: dict[str, float], floor: dict[str, float]) -> dict[str, float]:
    return {key.removesuffix("_us"): round(ours[key] / max(floor[key], 1.0), 2) for key in SHOWN}


def text(facts: dict[str, Any]) -> str:
    """Return the facts as lines for people."""
    machine, links = facts["machine"], facts["links"]
    ordinary = "ordinary priority: SCHED_FIFO is not allowed here"
    policy = "real-time priority" if links["fifo"] else ordinary
    lines = [
        f"Python {machine['python']}, {machine['system']}, {machine['cpus']} CPUs, load "
        f"{machine['load']:.1f}",
        "",
        "links:",
        f"  lateness of frames every {1e3 * links['period_s']:g} ms for {links['seconds']:g} s, "
        f"{policy}",
    ]
    for name, these in (("processors busy", links), ("idle", links["idle"])):
        for what, label in (("pacer", "the pacer"), ("floor", "a bare loop")):
            lines.append(
                f"    {name:16} {label:12} {_figures(these[what])}; {these[what]['lost']} lost"
            )
        lines.append(f"    {name:16} {'ratio':12} {_words(these['ratios'])}")
    lines.append("  pose's datagram in to command's datagram out")
    for rate, ours in links["pose_to_command"].items():
        lost = f"{ours['overtaken']} overtaken by a newer pose, {ours['unanswered']} unanswered"
        lines.append(f"    {rate + ' Hz':16} {'the program':12} {_figures(ours)}; {lost}")
        lines.append(f"    {rate + ' Hz':16} {'a bare echo':12} {_figures(links['echo'][rate])}")
        lines.append(f"    {rate + ' Hz':16} {'ratio':12} {_words(links['latency_ratios'][rate])}")
    return "\n".join(lines)


def _figures(these: dict[str, float]) -> str:
    return (
        f"50 % within {these['p50_us']:.0f} µs, 99 % {these['p99_us']:.0f}, 99.9 % "
        f"{these['p999_us']:.0f}"
    )


def _words(ratios: dict[str, float]) -> str:
    return f"{ratios['p50']:g}, {ratios['p99']:g}, {ratios['p999']:g}"


def bench(args: argparse.Namespace) -> Exit:
    """Measure this machine."""
    facts = measure_all(args.seconds)
    if args.json and args.what:
        facts |= facts.pop("links")
    print(json.dumps(facts) if args.json else text(facts))
    return Exit.DONE
