"""Hours of missions one after the other in one process, some of them struck by a fault: does anything grow or stay?

All of it is one run of one event loop in virtual time. Every fourth flight is recorded, into a folder that
is tidied as in a real flight, with little room.
"""

import asyncio
import gc
import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from groundstation.config import dump
from groundstation.flight import about
from groundstation.machine import RecordingConfig, free_name, list_recordings, tidy
from groundstation.recording import FlightLog
from sim.scenarios import SCENARIOS, prepare
from sim.time import VirtualTimeLoop, in_virtual_time
from tests.proving.faults import BROKEN, STATES, Fault, NotReached, Row, Scene, fly_here

FAULTY_SHARE = 0.4
"""Share of the flights struck by a fault, which is drawn, as is the state that it strikes in
[-]."""
FIGURE_S = (20.0, 90.0)
"""Shortest and longest duration of the figure [s]."""
PAUSE_S = 5.0
"""Between two flights [s, virtual]."""
RECORDED_EACH = 4
"""Flights per recorded one: recording takes longer than the flight itself."""
KEEP_GB = 0.02
"""Limit of the soak's recordings [GB]."""
GROWTH = 0.05
"""Memory may grow by this share."""
WARM_FLIGHTS = 3
"""Memory of the first flights is not looked at: modules are imported and caches fill."""
NOTHING = "nothing"
"""Name of the strike of a flight without a fault."""

PAGE_BYTES = 4096
"""Size of a memory page [bytes]."""


def look() -> dict[str, int]:
    """Count the interpreter's objects and memory after a full collection."""
    gc.collect()
    statm = Path("/proc/self/statm")
    resident = int(statm.read_text(encoding="utf-8").split()[1]) * PAGE_BYTES if statm.exists() else 0
    return {"objects": len(gc.get_objects()), "blocks": sys.getallocatedblocks(), "resident_bytes": resident}


class Soak(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a soak."""

    scenario: str
    seed: int
    hours: float
    """Virtual time flown [h]."""
    flights: int
    struck: int
    """Number of flights that a fault was to strike."""
    unsafe: tuple[Row, ...]
    """Flights that did not end safely: the fault deck is judged elsewhere, in air not as bad as
    ``adverse``."""
    resident_first_mb: float
    """Resident memory, the mean of the first hour, or of the first quarter where that is shorter [MiB]."""
    resident_last_mb: float
    """Resident memory at the end [MB]."""
    resident_growth: float
    """Relative growth of the resident memory [-]."""
    objects_grown: int
    """Objects that the garbage collector knows, from the first to the last look."""
    orphan_tasks: int
    """Tasks that were left over after a flight, all together."""
    orphan_endpoints: int
    """Sockets of the network in memory, likewise."""
    recordings_mb: float
    """The most that recordings took [MB]."""
    recordings_limit_mb: float
    """Limit of the recordings [MB]: kept ones, and the one being written."""
    wall_s: float
    early: tuple[str, ...]
    """Flights that ended before anything struck them, each with its seed and why."""
    passed: bool


def soak(
    hours: float, *, scenario: str = "adverse", seed: int = 0, on_progress: Callable[[float], None] | None = None
) -> Soak:
    """Fly for ``hours`` of virtual time; ``on_progress`` hears how many have passed."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="gs-soak-") as folder:
        ledger = _soak(3600.0 * hours, scenario, seed, Path(folder), on_progress)
    first, last = _means(ledger.looks)
    growth = last / first - 1.0 if first else 0.0
    limit = 1e3 * KEEP_GB + ledger.largest_mb
    orphans = ledger.tasks + ledger.endpoints
    return Soak(
        scenario=scenario,
        seed=seed,
        hours=hours,
        flights=len(ledger.looks),
        struck=ledger.struck,
        unsafe=tuple(ledger.unsafe),
        resident_first_mb=first,
        resident_last_mb=last,
        resident_growth=growth,
        objects_grown=ledger.objects[-1] - ledger.objects[0],
        orphan_tasks=ledger.tasks,
        orphan_endpoints=ledger.endpoints,
        recordings_mb=ledger.most_mb,
        recordings_limit_mb=limit,
        wall_s=time.perf_counter() - start,
        early=tuple(ledger.early),
        passed=ledger.as_planned and not ledger.early and growth <= GROWTH and orphans == 0 and ledger.most_mb <= limit,
    )


class _Ledger:
    """Numbers noted after every flight; numbers only, so that noting grows nothing itself."""

    def __init__(self) -> None:
        self.looks: list[tuple[float, float]] = []
        """Virtual time [s] and resident memory [MiB]."""
        self.objects: list[int] = []
        self.struck = self.tasks = self.endpoints = 0
        self.unsafe: list[Row] = []
        self.early: list[str] = []
        """Flights that ended before anything struck them."""
        self.as_planned = True
        """Whether every flight that nothing struck went as planned."""
        self.most_mb = self.largest_mb = 0.0


async def _do_nothing(_: Scene) -> None:
    return


@in_virtual_time
async def _soak(
    until_s: float, scenario: str, seed: int, folder: Path, on_progress: Callable[[float], None] | None
) -> _Ledger:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop), "in virtual time only"
    draw, ledger = random.Random(seed), _Ledger()
    number = 0
    while loop.time() < until_s:
        name, state, fault = NOTHING, "tracking", Fault("nothing happens", _do_nothing)
        if draw.random() < FAULTY_SHARE:
            name, state = draw.choice(list(BROKEN)), draw.choice(list(STATES))
            fault = BROKEN[name]
            ledger.struck += 1
        try:
            row = await _record(folder, scenario, name, fault, state, draw.uniform(*FIGURE_S), seed + number, ledger)
        except NotReached as error:
            ledger.early.append(f"seed {seed + number}: {error}")
        else:
            if name == NOTHING and (not row.safe or row.reaction != "flies on"):
                ledger.as_planned = False
            if not row.safe:
                ledger.unsafe.append(row)
        await asyncio.sleep(PAUSE_S)
        ledger.tasks += len(asyncio.all_tasks()) - 1
        ledger.endpoints += len(loop.endpoints)
        seen = look()
        ledger.looks.append((loop.time(), seen["resident_bytes"] / 1048576.0))
        ledger.objects.append(seen["objects"])
        number += 1
        if on_progress is not None:
            on_progress(loop.time() / 3600.0)
    return ledger


async def _record(
    folder: Path, scenario: str, name: str, fault: Fault, state: str, figure_s: float, seed: int, ledger: _Ledger
) -> Row:
    """One flight, and its recording where it is its turn."""
    if len(ledger.looks) % RECORDED_EACH:
        return await fly_here(name, fault, state, seed=seed, scenario=scenario, figure_s=figure_s)
    now_s = asyncio.get_running_loop().time()
    config = RecordingConfig(folder=str(folder), keep_gb=KEEP_GB)
    tidy(config, now_s)
    world, told = prepare(SCENARIOS[scenario], list(fault.overrides), source=fault.source, link=fault.link)
    path = free_name(folder, _stamp(now_s), told.vehicle.name)
    facts = about(told, clock="virtual", scenario=scenario, seed=seed, sim=dump(world))
    log = FlightLog(path, facts, epoch_ns=0, tell=lambda *_: None)
    try:
        row = await fly_here(name, fault, state, seed=seed, scenario=scenario, figure_s=figure_s, keep=log.write)
    finally:
        log.close()
    ledger.largest_mb = max(ledger.largest_mb, _size_mb(path))
    ledger.most_mb = max(ledger.most_mb, sum(_size_mb(one) for one in list_recordings(folder)))
    return row


def _size_mb(path: Path) -> float:
    """Return the size of a recording with its .tlog [MB]."""
    files = (path, path.with_suffix(".tlog"))
    return sum(file.stat().st_size for file in files if file.exists()) / 1e6


def _stamp(now_s: float) -> str:
    """Virtual time as the stamp of a recording's name, from the first day of a year without wall time."""
    seconds = int(now_s)
    days, rest = divmod(seconds, 86400)
    return f"000001{days + 1:02d}-{rest // 3600:02d}{rest // 60 % 60:02d}{rest % 60:02d}"


def _means(looks: list[tuple[float, float]]) -> tuple[float, float]:
    """Mean memory [MiB] of the first and of the last hour, or quarter."""
    looks = looks[WARM_FLIGHTS:] or looks
    begun, end = looks[0][0], looks[-1][0]
    span = min(3600.0, 0.25 * (end - begun))
    first = [mb for time_s, mb in looks if time_s <= begun + span]
    last = [mb for time_s, mb in looks if time_s >= end - span]
    return sum(first) / len(first), sum(last) / len(last)


def text(facts: Soak) -> str:
    """For people."""
    lines = [
        f"{facts.scenario}, seed {facts.seed}: {'nothing grows or stays' if facts.passed else 'NOT AS IT SHOULD BE'}",
        f"{facts.flights} flights in {facts.hours:g} h of virtual time, {facts.struck} of them struck by a fault, "
        f"{len(facts.unsafe)} not safe",
        f"resident memory {facts.resident_first_mb:.1f} → {facts.resident_last_mb:.1f} MiB, "
        f"{100.0 * facts.resident_growth:+.1f} % (limit {100.0 * GROWTH:.0f} %); objects {facts.objects_grown:+d}",
        f"left over after flights: {facts.orphan_tasks} tasks, {facts.orphan_endpoints} sockets",
        f"recordings took {facts.recordings_mb:.1f} MB at most (limit {facts.recordings_limit_mb:.1f} MB)",
        f"{facts.wall_s:.0f} s, {3600.0 * facts.hours / facts.wall_s:.0f} times as fast as the clock",
    ]
    lines += [f"ENDED EARLY {one}" for one in facts.early]
    lines += [f"UNSAFE {row.fault} in {row.state}: {row.reaction}: {row.why}" for row in facts.unsafe]
    return "\n".join(lines)
