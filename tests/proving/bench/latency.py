"""From a pose's datagram in to its command's datagram out, in real time, of the program that flies.

``groundstation daemon`` flies a simulated vehicle that lives here; poses leave from here at 50, 100 and 250 Hz, and
between any two of them a datagram of the same size goes to a bare asyncio echo in a process of its own. Both times
are taken here, by one clock, so both hold the same wake-up of this process; each is how long what was sent had to wait
for its answer. Poses are a thousandth slower than they say: they slide along what the autopilot tells of itself, as
cameras of their own clock do, and so does the echo.
"""

import asyncio
import gc
import tempfile
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.config import dump
from groundstation.pose.sources import ViconConfig
from groundstation.runtime import sleep_until
from groundstation.settings import Config
from links.core import make_child_command
from links.io import parse_address
from links.mavlink import MavlinkLinkConfig
from sim.autopilots import AutopilotPeer, Px4Autopilot
from sim.scenarios import SCENARIOS, prepare
from sim.trackers import Seen, vicon_encoder
from sim.world import Quadrotor, SimulatedVehicle, Wind, rows, stream


class LatencyFailed(Exception):
    """The program that flies did not fly; the text says how far it came."""


class Answers(NamedTuple):
    """How long what was sent had to wait for its answer [s]."""

    latencies_s: list[float]
    sent: int
    overtaken: int = 0
    """Poses that a newer one followed before a command left: what answered the newer one has answered them, late."""


class Waiting:
    """The poses that no command has answered yet. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        """None yet."""
        self.latencies_s: list[float] = []
        self.overtaken = 0
        self._left: deque[float] = deque()

    def left(self, now_s: float) -> None:
        """A pose has left."""
        self._left.append(now_s)

    def command(self, computed_ms: int, now_s: float) -> None:
        """A command has come, computed in the millisecond ``computed_ms`` (modulo 2³²).

        It answers every pose that had left by then; one between two poses, from what is known, answers no pose.
        """
        answered = 0
        while self._left and (computed_ms - int(1e3 * self._left[0])) & 0xFFFFFFFF < 1 << 31:
            self.latencies_s.append(now_s - self._left.popleft())
            answered += 1
        self.overtaken += max(answered - 1, 0)


def figures_of(answers: Answers) -> dict[str, float]:
    """Percentiles [µs] of all that were answered, overtaken ones too; how many those were, and how many were not."""
    ordered = sorted(answers.latencies_s)

    def percentile(p: float) -> float:
        return round(1e6 * ordered[min(int(p * len(ordered)), len(ordered) - 1)], 1)

    if not ordered:
        raise LatencyFailed("nothing came back")
    return {
        "p50_us": percentile(0.5),
        "p99_us": percentile(0.99),
        "p999_us": percentile(0.999),
        "count": len(ordered),
        "overtaken": answers.overtaken,
        "unanswered": answers.sent - len(ordered),
    }


def together(several: Sequence[Answers]) -> Answers:
    """Those of several flights as of one."""
    return Answers(
        [latency for one in several for latency in one.latencies_s],
        sum(one.sent for one in several),
        sum(one.overtaken for one in several),
    )


RATES_HZ = (50, 100, 250)
"""Poses per second."""
START_LIMIT_S = 20.0
"""How long the program may take to arm the vehicle [s]."""
SETTLE_S = 1.0
"""What is left out at the beginning of each flight [s]."""
SLIDE = 1.001
"""The time between two poses, in nominal periods."""
LAST_S = 0.1
"""How long the last answers are waited for [s]."""
_SET_POINT = b"\x52\x00\x00"


class _Peer(AutopilotPeer):
    """The autopilot's end, which notes when set-points arrive."""

    waiting: Waiting

    def datagram_received(self, data: bytes, addr: Any) -> None:
        if data[7:10] == _SET_POINT:  # its payload begins with time_boot_ms, by the clock that is ours too
            self.waiting.command(int.from_bytes(data[10:14], "little"), asyncio.get_running_loop().time())
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


def measure(seconds: float) -> dict[str, Any]:
    """Fly ``seconds`` [s] at each rate; latencies in µs: see :func:`tests.proving.bench.latency.figures_of`.

    Raises:
        LatencyFailed: the program did not come to fly.
    """
    gc.collect()
    gc.freeze()
    figures: dict[str, Any] = {"pose_to_command": {}, "echo": {}}
    for rate in RATES_HZ:
        commands, echoes = asyncio.run(fly(rate, seconds))
        figures["pose_to_command"][str(rate)] = figures_of(commands)
        figures["echo"][str(rate)] = figures_of(echoes)
    gc.unfreeze()
    return figures


async def fly(
    rate_hz: int, seconds: float, watched: Callable[[Path], AbstractAsyncContextManager[object]] | None = None
) -> tuple[Answers, Answers]:
    """The answers of commands, and of echoes.

    ``watched`` lasts as long as the flight, and gets the path of its status socket.
    """
    with tempfile.TemporaryDirectory(prefix="latency-") as name:
        folder = Path(name)
        echo = await _process("tests.proving.bench.echo", stdout=asyncio.subprocess.PIPE)
        config = await _config(rate_hz, folder)
        path = folder / "flight.toml"
        path.write_text(dump(config))
        daemon = await _process("groundstation", "daemon", str(path), "--arm", config.vehicle.name)
        try:
            assert echo.stdout is not None
            port = int(await echo.stdout.readline())
            async with nullcontext() if watched is None else watched(Path(config.status.path)):
                return await _measured(config, rate_hz, seconds, port)
        finally:
            for process in (daemon, echo):  # only simulated vehicles are left to themselves
                process.kill()
                await process.wait()


async def _process(module: str, *words: str, stdout: int = asyncio.subprocess.DEVNULL) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *make_child_command(module, *words),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=stdout,
        stderr=asyncio.subprocess.DEVNULL,
    )


async def _config(rate_hz: int, folder: Path) -> Config:
    period = 1.0 / rate_hz
    overrides = [
        f"link.listen={await _free_address()}",
        f"pose.listen={await _free_address()}",
        f"pose.rate_hz={rate_hz / SLIDE!r}",
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


async def _measured(config: Config, rate_hz: int, seconds: float, port: int) -> tuple[Answers, Answers]:
    loop = asyncio.get_running_loop()
    world = SCENARIOS["paper"].world
    plant = Quadrotor(world, Wind(world, rows(stream(0, "turbulence").standard_normal, 3)))
    plant.advance(loop.time())
    noise, wander = (rows(stream(0, what).standard_normal, n) for what, n in (("estimate", 6), ("wander", 3)))
    vehicle = SimulatedVehicle(plant, world, noise, wander)
    autopilot = Px4Autopilot(vehicle)
    assert isinstance(config.link, MavlinkLinkConfig)
    peer = _Peer(autopilot, parse_address(config.link.address))
    waiting = peer.waiting = Waiting()
    assert isinstance(config.pose, ViconConfig)
    encode = vicon_encoder(config.pose)
    poses, _ = await loop.create_datagram_endpoint(
        asyncio.DatagramProtocol, remote_addr=parse_address(config.pose.listen)
    )
    echo, echoes = await loop.create_datagram_endpoint(_Echoes, remote_addr=("127.0.0.1", port))
    running = asyncio.create_task(peer.run())
    period, frame, sent = SLIDE / rate_hz, 0, 0
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
            if counts:
                waiting.left(loop.time())
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
                echoes.left_s[data] = loop.time()
                echo.sendto(data)
            if frame * period < loop.time() - begun - 0.5:  # after a standstill of this machine: no burst
                begun += period
        await asyncio.sleep(LAST_S)
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        poses.close()
        echo.close()
    if not autopilot.armed:
        raise LatencyFailed("the flight ended before the measurement did")
    return Answers(waiting.latencies_s, sent, waiting.overtaken), Answers(echoes.latencies_s, sent)
