"""Missions of a fleet, in virtual time in one process, or in real time as users fly them.

In real time ``groundstation fleet`` flies against a simulated side in this process: every core, its recorder and the
relay are processes of their own, on real sockets. What a command costs is read from the recordings, which see every
byte as it comes and leaves. The truth judges both: how near the vehicles came to each other, and to their figures.
"""

import asyncio
import math
import os
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from itertools import combinations
from pathlib import Path
from typing import Any, TypeAlias

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.messages import FlightEvent, Notice, Subscriber
from groundstation.core.mission import State
from groundstation.flight import Flight, make_flight
from groundstation.lab import FleetPlan, Relay, read_fleet
from groundstation.recording import NoRecording, Recording
from groundstation.settings import Config
from links.io import open_child
from sim.runs.flight import LIMIT_S, MISSION_CONFIRM_S, REST_S, confirm_at, run_missions
from sim.runs.referee import MissionVerdict, StateEntry, TrueTrack
from sim.runs.stage import FleetStage, lay_out
from sim.time import in_virtual_time
from sim.world import World

SAMPLE_S = 0.02
"""Interval between samples of the distance between vehicles [s]."""


class Nearest(msgspec.Struct, frozen=True):
    """The least distance between two vehicles of a fleet."""

    distance_m: float
    between: tuple[str, str]
    time_s: float
    """When it was, from the first vehicle's release [s]."""


class FleetFlight(MissionVerdict, frozen=True, kw_only=True):
    """One vehicle's mission, and what its commands took."""

    name: str
    tick_p50_ms: float | None = None
    """Median time between a pose's arrival in the core and its command [ms]; None in virtual time."""
    tick_p99_ms: float | None = None
    compute_p50_ms: float | None = None
    """The part of it from when the command is begun to its leaving; None in virtual time."""
    compute_p99_ms: float | None = None
    round_p50_ms: float | None = None
    """Median time between the capture system's frame and its command's arrival at the autopilot [ms]; None in
    virtual time."""
    round_p99_ms: float | None = None
    ticks: int = 0
    """Commands that these figures rest on."""


class Tracks:
    """Every step of every plant."""

    def __init__(self, count: int) -> None:
        self.of = [TrueTrack() for _ in range(count)]
        """One a vehicle."""

    def step(self, number: int, time_s: float, place: Vec3) -> None:
        """One step."""
        self.of[number].step(time_s, place)

    @property
    def begun_s(self) -> float:
        """When the first vehicle was released, on the event loop's clock [s]; 0 before that."""
        return min((one.times[0] for one in self.of if one.times), default=0.0)

    def last(self, number: int, start: Vec3) -> Vec3:
        """Where it was seen last [m, NED]; ``start`` where it was never released."""
        one = self.of[number]
        return (one.x[-1], one.y[-1], one.z[-1]) if one.times else start

    def nearest(self, names: Sequence[str], starts: Sequence[Vec3]) -> Nearest | None:
        """Find the smallest distance between two vehicles; one that was never released stays at its start."""
        import numpy as np

        end = max((one.times[-1] for one in self.of if one.times), default=0.0)
        grid = np.arange(self.begun_s, end + SAMPLE_S, SAMPLE_S)
        places = []
        for one, start in zip(self.of, starts, strict=True):
            columns = [
                np.interp(grid, one.times, axis) if one.times else grid * 0.0 + s
                for axis, s in zip((one.x, one.y, one.z), start, strict=True)
            ]
            places.append(np.stack(columns))
        found: Nearest | None = None
        for a, b in combinations(range(len(names)), 2):
            apart = np.linalg.norm(places[a] - places[b], axis=0)
            at = int(np.argmin(apart))
            if found is None or apart[at] < found.distance_m:
                found = Nearest(float(apart[at]), (names[a], names[b]), float(grid[at] - self.begun_s))
        return found


def judge(
    number: int,
    name: str,
    config: Config,
    states: Sequence[StateEntry],
    started_s: float | None,
    fault: str,
    tracks: Tracks,
    stage: FleetStage,
) -> FleetFlight:
    """One vehicle's flight by the truth.

    Args:
        number: that of the vehicle.
        name: its name.
        config: what its ground station is told.
        states: those that its ground station went through.
        started_s: when its figure began, on the event loop's clock [s]; None where it did not.
        fault: what made it come down early; empty where nothing did.
        tracks: every step of every plant.
        stage: the simulated side.
    """
    plant, world = stage.stages[number].plant, stage.stages[number].world
    begun = tracks.begun_s
    last = states[-1] if states else StateEntry(State.IDLE, begun, "nothing was heard of it")
    return FleetFlight(
        name=name,
        landed=last.state == State.LANDED and not fault,
        why=fault or last.reason,
        states=tuple(StateEntry(one.state, round(one.time_s - begun, 6), one.reason) for one in states),
        touchdown_m_s=plant.floor.hardest_m_s,
        **tracks.of[number].judge_figure(config.trajectory.build(), started_s, states, world.step_s),
        home_m=math.dist(world.start_ned[:2], tracks.last(number, world.start_ned)[:2]),
    )


PORTS = (51001, 51101, *range(14541, 14641))
"""In virtual time no port is ever taken."""
APART_S = 0.1
"""Time between the arming of one vehicle and of the next [s]."""

FleetScript: TypeAlias = Callable[[dict[str, Flight], FleetStage], Coroutine[Any, Any, None]]
Change: TypeAlias = Callable[[list[World], FleetPlan], tuple[list[World], FleetPlan]]


class FleetMission(msgspec.Struct, frozen=True, kw_only=True):
    """Flown missions."""

    vehicles: tuple[FleetFlight, ...]
    nearest: Nearest | None
    """Smallest distance between two vehicles; None for one vehicle alone."""
    duration_s: float
    wall_s: float
    load: tuple[float, float, float] | None = None
    """Load averages of the machine over 1, 5 and 15 minutes at the end; None in virtual time."""

    @property
    def landed(self) -> bool:
        """Whether all went as it was meant to."""
        return all(one.landed for one in self.vehicles)


@in_virtual_time
async def fly_fleet(
    world: World,
    config: Config,
    count: int,
    *,
    seed: int,
    autopilot: str = "px4",
    script: FleetScript | None = None,
    change: Change | None = None,
    on_event: Callable[[str, Notice], None] | None = None,
) -> FleetMission:
    """Fly ``count`` vehicles like ``config`` in ``world``, side by side; see :func:`sim.runs.flight.from_floor`.

    ``script(flights, stage)`` runs beside them; ``change`` may alter truth and plan before; ``on_event`` takes each
    vehicle's name and notice.

    Raises:
        ConfigError: see :func:`sim.runs.stage.lay_out`.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="groundstation-sim-") as folder:
        file, worlds = lay_out(Path(folder), world, config, count, PORTS)
        fleet = read_fleet(file)
    if change is not None:
        worlds, fleet = change(worlds, fleet)
    loop, tracks = asyncio.get_running_loop(), Tracks(len(worlds))
    stage = FleetStage(worlds, [member.lab for member in fleet.members], seed, tracks.step, autopilot=autopilot)
    states: dict[str, list[StateEntry]] = {member.name: [] for member in fleet.members}
    hear = {name: _note(noted, name, on_event) for name, noted in states.items()}
    flights = {
        member.name: make_flight(
            member.core, confirm=confirm_at(MISSION_CONFIRM_S + APART_S * number), subscribers=(hear[member.name],)
        )
        for number, member in enumerate(fleet.members)
    }
    limit = LIMIT_S + max(member.core.flight.duration_s or 0.0 for member in fleet.members)
    async with _relaying(fleet):
        outcomes, ended_s = await run_missions(
            stage.run(), list(flights.values()), limit, script and script(flights, stage)
        )
    for one in stage.stages:
        one.plant.advance(loop.time())
    vehicles = []
    for number, (member, outcome) in enumerate(zip(fleet.members, outcomes, strict=True)):
        started_s = flights[member.name].started_s
        fault = f"not over after {limit:g} s" if outcome is None else outcome.fault
        vehicles.append(judge(number, member.name, member.core, states[member.name], started_s, fault, tracks, stage))
    nearest = tracks.nearest(list(flights), [world.start_ned for world in worlds])
    return FleetMission(
        vehicles=tuple(vehicles), nearest=nearest, duration_s=ended_s, wall_s=time.perf_counter() - start
    )


@asynccontextmanager
async def _relaying(fleet: FleetPlan) -> AsyncIterator[None]:
    """The fleet's relay of poses runs, where it has one."""
    if fleet.relay_listen is None:
        yield
        return
    relay = Relay(fleet.relay_listen, fleet.relay_targets)
    await relay.open()
    yield
    relay.close()


def _note(states: list[StateEntry], name: str, on_event: Callable[[str, Notice], None] | None) -> Subscriber:
    def hear(event: FlightEvent) -> None:
        if isinstance(event, Notice):
            if on_event is not None:
                on_event(name, event)
            if event.kind == "state":
                states.append(StateEntry(event.state, event.time_s, event.text))

    return hear


COMMAND = b"\x52\x00\x00"
"""SET_ATTITUDE_TARGET, 82, where a MAVLink 2 frame has its number."""


def fly_fleet_real(
    world: World,
    config: Config,
    count: int,
    *,
    seed: int,
    autopilot: str = "px4",
    say: Callable[[str], None] | None = None,
) -> FleetMission:
    """Fly ``count`` vehicles like ``config`` in ``world`` in real time; ``say`` takes what their cores say.

    Raises:
        ConfigError: see :func:`sim.runs.stage.lay_out`.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="groundstation-sim-") as folder:
        values = asyncio.run(_fly_real(world, config, count, Path(folder), seed, autopilot, say))
    return FleetMission(**values, wall_s=time.perf_counter() - start, load=os.getloadavg())


async def _fly_real(
    world: World,
    config: Config,
    count: int,
    folder: Path,
    seed: int,
    autopilot: str,
    say: Callable[[str], None] | None,
) -> dict[str, Any]:
    loop, tracks = asyncio.get_running_loop(), Tracks(count)
    recording = msgspec.structs.replace(config.recording, folder=str(folder / "flights"), enabled=True)
    config = msgspec.structs.replace(config, recording=recording)
    file, worlds = lay_out(folder, world, config, count, await _free_ports(count))
    fleet = read_fleet(file)
    labs = [member.lab for member in fleet.members]
    stage = FleetStage(worlds, labs, seed, tracks.step, autopilot=autopilot)
    rounds = [_Rounds(stage, number) for number in range(count)]
    turning = asyncio.ensure_future(stage.run())
    stations = await _stations(file, fleet, folder)
    listening = asyncio.ensure_future(_listen(stations, say))
    begun = loop.time()
    limit = LIMIT_S + (config.flight.duration_s or 0.0)
    await asyncio.wait({turning, listening}, timeout=limit, return_when=asyncio.FIRST_COMPLETED)
    if not listening.done():
        stations.terminate()
        await listening
    await stations.wait()
    duration = loop.time() - begun
    await asyncio.sleep(REST_S)
    turning.cancel()
    for failure in await asyncio.gather(turning, return_exceptions=True):
        if isinstance(failure, Exception):
            raise failure
    vehicles = []
    for number, member in enumerate(fleet.members):
        log = _Log(folder / "flights", member.name)
        states, started_s, fault = log.states, log.started_at(member.core), log.fault()
        flown = judge(number, member.name, member.core, states, started_s, fault, tracks, stage)
        vehicles.append(msgspec.structs.replace(flown, **log.timing(), **rounds[number].timing()))
    names, starts = [member.name for member in fleet.members], [world.start_ned for world in worlds]
    return {"vehicles": tuple(vehicles), "nearest": tracks.nearest(names, starts), "duration_s": duration}


async def _stations(file: Path, fleet: FleetPlan, folder: Path) -> asyncio.subprocess.Process:
    """``groundstation fleet``, every vehicle armed without asking, its sockets in ``folder``."""
    arm = [word for member in fleet.members for word in ("--arm", member.name)]
    environment = os.environ | {"XDG_RUNTIME_DIR": str(folder)}
    words = ("fleet", str(file), *arm)
    return await open_child("groundstation", *words, apart=False, stderr=asyncio.subprocess.STDOUT, env=environment)


async def _listen(stations: asyncio.subprocess.Process, say: Callable[[str], None] | None) -> None:
    assert stations.stdout is not None, "it is a pipe"
    while line := await stations.stdout.readline():
        if say is not None:
            say(line.decode(errors="replace").rstrip())


async def _free_ports(count: int) -> list[int]:
    """Ports that nobody uses at this moment: for poses, the first of ``count`` in a row, and for ``count`` links."""
    loop, held = asyncio.get_running_loop(), list[asyncio.DatagramTransport]()

    async def take(port: int) -> int:
        transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=("127.0.0.1", port))
        held.append(transport)
        return int(transport.get_extra_info("sockname")[1])

    try:
        single = [await take(0) for _ in range(count + 1)]
        for first in range(20000, 30000, count):  # below those that the system gives out
            try:
                row = [await take(first + number) for number in range(count)]
            except OSError:
                continue
            return [single[0], row[0], *single[1:]]
        raise OSError(f"no {count} free UDP ports in a row")
    finally:
        for transport in held:
            transport.close()
        await asyncio.sleep(0)


class _Rounds:
    """Times between the capture system's frames and the next command's arrival at one autopilot."""

    def __init__(self, stage: FleetStage, number: int) -> None:
        self._found: list[float] = []
        self._stage = stage
        self._answered_s = 0.0
        stage.stages[number].peer.overhear = self._count_round

    def _count_round(self, time_s: float, data: bytes) -> None:
        sent_s = self._stage.mocap.sent_s
        if data[7:10] == COMMAND and sent_s is not None and sent_s > self._answered_s:
            self._answered_s = sent_s
            self._found.append(time_s - sent_s)

    def timing(self) -> dict[str, float]:
        """Median and 99th percentile."""
        return _percentiles("round", self._found)


class _Log:
    """Recording of one core."""

    def __init__(self, folder: Path, name: str) -> None:
        self.states: list[StateEntry] = []
        self._started_s: float | None = None
        self._ticks: list[float] = []
        self._computed: list[float] = []
        self._fault = "it has left no recording"
        for path in sorted(folder.glob(f"*-{name}.mcap")):
            try:
                self._read(Recording(path))
            except (NoRecording, OSError) as error:
                self._fault = str(error)

    def _read(self, recording: Recording) -> None:
        self._fault = ""
        arrivals: dict[int, float] = {}
        pending: tuple[int, float] | None = None
        for entry in recording.entries(("/measured", "/command", "/raw/sent", "/mission")):
            value = entry.value()
            match entry.topic:
                case "/measured":
                    arrivals[value["id"]] = value["arrival_s"]
                case "/command":
                    pending = value["pose_id"], value["time_s"]
                    if self.states and self.states[-1].state == State.TRACKING and self._started_s is None:
                        self._started_s = value["time_s"] - value["flight_time_s"]
                case "/raw/sent" if pending is not None:
                    pose, begun = pending
                    pending = None
                    self._computed.append(value["time_s"] - begun)
                    if pose in arrivals:  # the first command that rests on it
                        self._ticks.append(value["time_s"] - arrivals.pop(pose))
                case "/mission":
                    if not self.states or self.states[-1].state != value["state"]:
                        self.states.append(StateEntry(value["state"], value["time_s"], value["text"]))
                case _:
                    pass

    def started_at(self, config: Config) -> float | None:
        """When the figure began, on the event loop's clock [s]; None where it did not."""
        return None if self._started_s is None else self._started_s + config.vehicle.acting_delay_s

    def fault(self) -> str:
        """Why it did not go as it was meant to; empty where the record says that it did."""
        early = [one for one in self.states if one.state in (State.DESCENT, State.ABORTED, State.KILLED)]
        return self._fault or (early[0].reason if early else "")

    def timing(self) -> dict[str, Any]:
        """Median and 99th percentile of what its commands took."""
        figures: dict[str, Any] = {"ticks": len(self._ticks)}
        return figures | _percentiles("tick", self._ticks) | _percentiles("compute", self._computed)


def _percentiles(name: str, seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {}
    return {f"{name}_{key}_ms": 1e3 * percentile(seconds, share) for key, share in (("p50", 0.5), ("p99", 0.99))}


def percentile(values: Sequence[float], share: float) -> float:
    """The value below which ``share`` (0..1) of them lie."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
