"""From a pose's datagram in to its command's datagram out, in real time, of the program that flies.

``groundstation daemon`` flies a simulated vehicle that lives here; poses leave from here at 50, 100 and 250 Hz, and
between any two of them a datagram of the same size goes to a bare asyncio echo in a process of its own. Both times
are taken here, by one clock, so both hold the same wake-up of this process.
"""

import asyncio
import gc
import sys
import tempfile
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager, nullcontext
from pathlib import Path
from typing import Any

from groundstation.clock import sleep_until
from groundstation.config import dump
from groundstation.poses.vicon import ViconConfig
from groundstation.settings import Config
from links.address import parse_address
from links.mavlink import MavlinkLinkConfig
from sim.autopilot import Px4Autopilot
from sim.autopilot_peer import AutopilotPeer
from sim.draws import rows, stream
from sim.prepare import prepare
from sim.quadrotor import Quadrotor
from sim.scenarios import SCENARIOS
from sim.trackers import Seen, vicon_encoder
from sim.vehicle import SimulatedVehicle
from sim.wind import Wind

RATES_HZ = (50, 100, 250)
"""Poses per second."""
START_LIMIT_S = 20.0
"""How long the program may take to arm the vehicle [s]."""
SETTLE_S = 1.0
"""What is left out at the beginning of each flight [s]."""
_SET_POINT = b"\x52\x00\x00"


class LatencyFailed(Exception):
    """The program that flies did not fly; the text says how far it came."""


class _Peer(AutopilotPeer):
    """The autopilot's end, which notes when the first set-point after each pose arrives."""

    pose_left_s: float | None = None
    latencies_s: list[float]

    def datagram_received(self, data: bytes, addr: Any) -> None:
        now = asyncio.get_running_loop().time()
        if data[7:10] == _SET_POINT and self.pose_left_s is not None:
            self.latencies_s.append(now - self.pose_left_s)
            self.pose_left_s = None
        super().datagram_received(data, addr)


class _Answers(asyncio.DatagramProtocol):
    """The other end of the echo."""

    def __init__(self) -> None:
        self.left_s: float | None = None
        self.latencies_s: list[float] = []

    def datagram_received(self, data: bytes, addr: Any) -> None:
        if self.left_s is not None:
            self.latencies_s.append(asyncio.get_running_loop().time() - self.left_s)
            self.left_s = None


def measure(seconds: float) -> dict[str, Any]:
    """Fly ``seconds`` [s] at each rate; latencies in µs: p50, p99, p99.9, and how many poses got no command.

    Raises:
        LatencyFailed: the program did not come to fly.
    """
    gc.collect()
    gc.freeze()
    figures: dict[str, Any] = {"pose_to_command": {}, "echo": {}}
    for rate in RATES_HZ:
        command, echo, sent = asyncio.run(fly(rate, seconds))
        figures["pose_to_command"][str(rate)] = figures_of(command, sent)
        figures["echo"][str(rate)] = figures_of(echo, sent)
    gc.unfreeze()
    return figures


def figures_of(latencies_s: list[float], sent: int) -> dict[str, float]:
    """Percentiles [µs], and how many of ``sent`` got none."""
    ordered = sorted(latencies_s)

    def percentile(p: float) -> float:
        return round(1e6 * ordered[min(int(p * len(ordered)), len(ordered) - 1)], 1)

    if not ordered:
        raise LatencyFailed("nothing came back")
    return {
        "p50_us": percentile(0.5),
        "p99_us": percentile(0.99),
        "p999_us": percentile(0.999),
        "count": len(ordered),
        "unanswered": sent - len(ordered),
    }


async def fly(
    rate_hz: int, seconds: float, watched: Callable[[Path], AbstractAsyncContextManager[object]] | None = None
) -> tuple[list[float], list[float], int]:
    """Latencies of commands and of echoes [s], and how many of each were asked for.

    ``watched`` lasts as long as the flight, and gets the path of its status socket.
    """
    with tempfile.TemporaryDirectory(prefix="latency-") as name:
        folder = Path(name)
        echo = await _process("-m", "sim.bench_echo", stdout=asyncio.subprocess.PIPE)
        config = await _config(rate_hz, folder)
        path = folder / "flight.toml"
        path.write_text(dump(config))
        daemon = await _process("-m", "groundstation", "daemon", str(path), "--arm", config.vehicle.name)
        try:
            assert echo.stdout is not None
            port = int(await echo.stdout.readline())
            async with nullcontext() if watched is None else watched(Path(config.status.path)):
                return await _measured(config, rate_hz, seconds, port)
        finally:
            for process in (daemon, echo):  # only simulated vehicles are left to themselves
                process.kill()
                await process.wait()


async def _process(*arguments: str, stdout: int = asyncio.subprocess.DEVNULL) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        sys.executable, *arguments, stdin=asyncio.subprocess.DEVNULL, stdout=stdout, stderr=asyncio.subprocess.DEVNULL
    )


async def _config(rate_hz: int, folder: Path) -> Config:
    period = 1.0 / rate_hz
    overrides = [
        f"link.listen={await _free_address()}",
        f"pose.listen={await _free_address()}",
        f"pose.rate_hz={rate_hz}",
        "pose.latency_s=0.0",
        f"link.period_s={period!r}",
        "link.pace=poses",
        f"vehicle.frame_period_s={period!r}",
        f"status.path={folder / 'status.sock'}",
    ]
    _, config = prepare(SCENARIOS["paper"], overrides)
    return config


async def _free_address() -> str:
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, local_addr=("127.0.0.1", 0))
    host, port = transport.get_extra_info("sockname")[:2]
    transport.close()
    await asyncio.sleep(0)
    return f"{host}:{port}"


async def _measured(config: Config, rate_hz: int, seconds: float, port: int) -> tuple[list[float], list[float], int]:
    loop = asyncio.get_running_loop()
    world = SCENARIOS["paper"].world
    plant = Quadrotor(world, Wind(world, rows(stream(0, "turbulence").standard_normal, 3)))
    plant.advance(loop.time())
    vehicle = SimulatedVehicle(plant, world, rows(stream(0, "estimate").standard_normal, 6))
    autopilot = Px4Autopilot(vehicle)
    assert isinstance(config.link, MavlinkLinkConfig)
    peer = _Peer(autopilot, parse_address(config.link.address))
    peer.latencies_s = []
    assert isinstance(config.pose, ViconConfig)
    encode = vicon_encoder(config.pose)
    poses, _ = await loop.create_datagram_endpoint(
        asyncio.DatagramProtocol, remote_addr=parse_address(config.pose.listen)
    )
    echo, answers = await loop.create_datagram_endpoint(_Answers, remote_addr=("127.0.0.1", port))
    running = asyncio.create_task(peer.run())
    period, frame, sent = 1.0 / rate_hz, 0, 0
    begun = loop.time()
    counts_from = None
    try:
        while counts_from is None or loop.time() < counts_from + seconds:
            if running.done():
                running.result()
            due = begun + frame * period
            await sleep_until(due)
            seen = vehicle.measured(loop.time())
            data = encode(frame, due, [Seen(config.pose.object, seen.position_ned, seen.attitude, True)])
            counts = counts_from is not None and loop.time() >= counts_from
            peer.pose_left_s = loop.time() if counts else None
            poses.sendto(data)
            frame += 1
            if counts_from is None:
                if plant.released_s is not None:
                    counts_from = loop.time() + SETTLE_S
                elif loop.time() > begun + START_LIMIT_S:
                    raise LatencyFailed(f"the vehicle was not armed within {START_LIMIT_S:g} s")
            await sleep_until(due + 0.5 * period)
            if counts:
                sent += 1
                answers.left_s = loop.time()
                echo.sendto(data)
            if frame * period < loop.time() - begun - 0.5:  # after a standstill of this machine: no burst
                begun += period
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        poses.close()
        echo.close()
    if not autopilot.armed:
        raise LatencyFailed("the flight ended before the measurement did")
    return peer.latencies_s, answers.latencies_s, sent
