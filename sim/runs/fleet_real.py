"""Several missions in real time, as users fly them: ``groundstation fleet`` against a simulated side in this process.

Every core, its recorder and the relay are processes of their own, on real sockets. What a command costs is read from
the recordings, which see every byte as it comes and leaves.
"""

import asyncio
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from groundstation.core.mission import State
from groundstation.lab import FleetPlan, read_fleet
from groundstation.recording import NoRecording, Recording
from groundstation.settings import Config
from links.core import make_child_command
from sim.runs.fleet_mission import FleetMission, StationRecord, Tracks, judge
from sim.runs.fleet_stage import FleetStage, lay_out
from sim.runs.mission import LIMIT_S, REST_S, Entered
from sim.time import percentile
from sim.world import World

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
        ConfigError: see :func:`sim.runs.fleet_stage.lay_out`.
    """
    start = time.perf_counter()
    with tempfile.TemporaryDirectory(prefix="groundstation-sim-") as folder:
        values = asyncio.run(_fly(world, config, count, Path(folder), seed, autopilot, say))
    return FleetMission(**values, wall_s=time.perf_counter() - start, load=os.getloadavg())


async def _fly(
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
        flown = judge(number, member.name, member.core, log.summarize(member.core), log.fault(), tracks, stage)
        vehicles.append(msgspec.structs.replace(flown, **log.timing(), **rounds[number].timing()))
    names, starts = [member.name for member in fleet.members], [world.start_ned for world in worlds]
    return {"vehicles": tuple(vehicles), "nearest": tracks.nearest(names, starts), "duration_s": duration}


async def _stations(file: Path, fleet: FleetPlan, folder: Path) -> asyncio.subprocess.Process:
    """``groundstation fleet``, every vehicle armed without asking, its sockets in ``folder``."""
    arm = [word for member in fleet.members for word in ("--arm", member.name)]
    return await asyncio.create_subprocess_exec(
        *make_child_command("groundstation", "fleet", str(file), *arm),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
        env=os.environ | {"XDG_RUNTIME_DIR": str(folder)},
    )


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
    """From the capture system's sending to the autopilot's hearing of the first command after it, of one vehicle."""

    def __init__(self, stage: FleetStage, number: int) -> None:
        self._found: list[float] = []
        self._stage = stage
        self._answered_s = 0.0
        peer = stage.stages[number].peer
        self._hear = peer.datagram_received
        peer.datagram_received = self._count_round  # type: ignore[method-assign]  # only looked at on its way

    def _count_round(self, data: bytes, addr: Any) -> None:
        sent_s = self._stage.mocap.sent_s
        if data[7:10] == COMMAND and sent_s is not None and sent_s > self._answered_s:
            self._answered_s = sent_s
            self._found.append(asyncio.get_running_loop().time() - sent_s)
        self._hear(data, addr)

    def timing(self) -> dict[str, float]:
        """Median and 99th percentile."""
        return _percentiles("round", self._found)


class _Log:
    """What one core has recorded."""

    def __init__(self, folder: Path, name: str) -> None:
        """Read it; where there is none, nothing is known."""
        self._states: list[Entered] = []
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
                    if self._states and self._states[-1].state == State.TRACKING and self._started_s is None:
                        self._started_s = value["time_s"] - value["flight_time_s"]
                case "/raw/sent" if pending is not None:
                    pose, begun = pending
                    pending = None
                    self._computed.append(value["time_s"] - begun)
                    if pose in arrivals:  # the first command that rests on it
                        self._ticks.append(value["time_s"] - arrivals.pop(pose))
                case "/mission":
                    if not self._states or self._states[-1].state != value["state"]:
                        self._states.append(Entered(value["state"], value["time_s"], value["text"]))
                case _:
                    pass

    def summarize(self, config: Config) -> StationRecord:
        """Its states, and when the figure began."""
        delay = config.vehicle.command_delay_s
        started = None if self._started_s is None else self._started_s + delay
        return StationRecord(states=tuple(self._states), started_s=started)

    def fault(self) -> str:
        """Why it did not go as it was meant to; empty where the record says that it did."""
        early = [one for one in self._states if one.state in (State.DESCENT, State.ABORTED, State.KILLED)]
        return self._fault or (early[0].reason if early else "")

    def timing(self) -> dict[str, Any]:
        """Median and 99th percentile of what its commands took."""
        figures: dict[str, Any] = {"ticks": len(self._ticks)}
        return figures | _percentiles("tick", self._ticks) | _percentiles("compute", self._computed)


def _percentiles(name: str, seconds: list[float]) -> dict[str, float]:
    if not seconds:
        return {}
    return {f"{name}_{key}_ms": 1e3 * percentile(seconds, share) for key, share in (("p50", 0.5), ("p99", 0.99))}
