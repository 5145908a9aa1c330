"""Load of one broker: a hundred stations publish to a mosquitto, one client listens to all."""

import asyncio
import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import msgspec

from groundstation.core.messages import Notice, Snapshot
from groundstation.interfaces.mqtt import from_url, publish_forever
from groundstation.machine import Latest
from groundstation.settings import MqttConfig
from links.core import LinkStatus
from links.io import make_child_command
from sim.runs import percentile
from tests.proving.bench.bench import Options

STATIONS = 100
"""Stations that publish."""
RATE_HZ = 10.0
"""Snapshots of each a second [1/s]."""
SETTLE_S = 3.0
"""Time until all have connected [s]."""
PROGRAM_PATH = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/local/sbin", "/usr/sbin"])


def measure(options: Options) -> dict[str, Any]:
    """See docs/reference/bench.md."""
    program = shutil.which("mosquitto", path=PROGRAM_PATH)
    if program is None:
        return {"note": "not measured: install mosquitto"}
    return run(program, STATIONS, options.seconds)


def run(program: str, stations: int, seconds: float, settle_s: float = SETTLE_S) -> dict[str, Any]:
    """The facts, with that mosquitto."""
    with tempfile.TemporaryDirectory(prefix="gs-") as folder:
        port = asyncio.run(_free_port())
        config = Path(folder) / "mosquitto.conf"
        config.write_text(
            f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\nset_tcp_nodelay true\n", "utf-8"
        )
        broker = subprocess.Popen([program, "-c", config], stderr=subprocess.DEVNULL)  # noqa: S603  # the broker
        try:
            facts = asyncio.run(_play(port, stations, seconds, settle_s))
        finally:
            broker.terminate()
            _, _, usage = os.wait4(broker.pid, 0)
            broker.returncode = 0
    facts["cpu_broker"] = (usage.ru_utime + usage.ru_stime) / (seconds + settle_s)
    return {"stations": stations, "rate_hz": RATE_HZ, "seconds": seconds, **facts}


def text(facts: dict[str, Any]) -> list[str]:
    """For people."""
    if "note" in facts:
        return [facts["note"]]
    cpu = ", ".join(f"{who} {100 * facts[f'cpu_{who}']:.0f} %" for who in ("stations", "broker", "listener"))
    return [
        f"{facts['stations']} stations, {facts['rate_hz']:g} Hz, {facts['seconds']:g} s: {facts['vehicles']} heard",
        f"delivered {100 * facts['delivered_share']:.2f} % of {facts['published']} snapshots",
        f"latency p50 {facts['p50_ms']:.1f} ms, p99 {facts['p99_ms']:.1f} ms, longest {facts['max_ms']:.1f} ms",
        f"of one processor: {cpu}",
    ]


async def _play(port: int, stations: int, seconds: float, settle_s: float) -> dict[str, Any]:
    url = f"mqtt://127.0.0.1:{port}"
    while True:
        with contextlib.suppress(OSError):
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.close()
            break
        await asyncio.sleep(0.02)
    loop = asyncio.get_running_loop()
    listener = await asyncio.create_subprocess_exec(
        *make_child_command("tests.proving.bench.mqtt", url, str(settle_s), str(seconds)), stdout=subprocess.PIPE
    )
    assert listener.stdout is not None, "a pipe"
    begin_s: float = msgspec.json.decode(await listener.stdout.readline())  # as soon as it hears them all
    config = MqttConfig(enabled=True, port=port, rate_hz=RATE_HZ * 2)  # each put is published: the source sets the pace
    sources = [Latest[Snapshot]() for _ in range(stations)]
    tasks = [asyncio.create_task(publish_forever(config, source)) for source in sources]
    feeds = [asyncio.create_task(_feed(f"v{i}", source, i / stations / RATE_HZ)) for i, source in enumerate(sources)]
    await asyncio.sleep(begin_s - loop.time())
    cpu_s = time.process_time()
    before = _put(sources)
    await asyncio.sleep(begin_s + seconds - loop.time())
    published, cpu_s = _put(sources) - before, time.process_time() - cpu_s
    heard: dict[str, Any] = msgspec.json.decode(await listener.stdout.read())
    await listener.wait()
    for task in (*feeds, *tasks):
        task.cancel()
    await asyncio.gather(*feeds, *tasks, return_exceptions=True)
    share = heard["delivered"] / published
    return {"published": published, "delivered_share": share, **heard, "cpu_stations": cpu_s / seconds}


def _put(sources: list[Latest[Snapshot]]) -> int:
    return sum(source.newest[0] for source in sources if source.newest is not None)


async def _feed(name: str, source: Latest[Snapshot], offset_s: float) -> None:
    """Make snapshots of a vehicle that stands, each with the instant of its making."""
    loop = asyncio.get_running_loop()
    next_s = loop.time() + offset_s
    while True:
        await asyncio.sleep(max(0.0, next_s - loop.time()))
        source.put(_snapshot(name, loop.time()))
        next_s += 1.0 / RATE_HZ


def _snapshot(name: str, time_s: float) -> Snapshot:
    zero = (0.0, 0.0, 0.0)
    link = LinkStatus(state="connected", sent=1000, expired=0, received=5000, dropped={}, text="")
    return Snapshot(
        vehicle=name, state="ready", reason="link and poses are there", time_s=time_s, flight_time_s=0.0, pose_id=7,
        pose_age_s=0.0123, pose_rate_hz=100.0, poses_dropped={"stale": 1}, position_ned=(0.123456, 1.234567, -0.1),
        velocity_ned=zero, attitude=(1.0, 0.0, 0.0, 0.0), reference_ned=zero, error_m=0.01, rms_m=0.02, thrust_n=0.0,
        thrust_max_n=1.37, rates_rad_s=zero, saturated=False, diagnostics=None, link=link,
        events=tuple(Notice(float(i), "ready", "an event of the flight, as long as they are") for i in range(20)),
    )  # fmt: skip


class ListenedMessages(msgspec.Struct):
    """Part of a snapshot that the listener reads."""

    vehicle: str
    time_s: float


async def _listen(url: str, settle_s: float, seconds: float) -> dict[str, Any]:
    """Hear all snapshots of that time, from ``settle_s`` after it could hear any; when that is, it says at once.

    By the event loop's clock, which all processes share.
    """
    broker = from_url(url)
    loop = asyncio.get_running_loop()
    latencies: list[float] = []
    vehicles: set[str] = set()
    cpu_s = time.process_time()
    async with broker.client() as client:
        await client.subscribe("groundstation/+/snapshot")
        begin_s = loop.time() + settle_s
        end_s = begin_s + seconds
        print(begin_s, flush=True)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout_at(end_s + 0.5):
                async for message in client.messages:
                    snapshot = msgspec.json.decode(message.payload, type=ListenedMessages)
                    if begin_s <= snapshot.time_s < end_s:
                        latencies.append(loop.time() - snapshot.time_s)
                        vehicles.add(snapshot.vehicle)
    return {
        "delivered": len(latencies),
        "vehicles": len(vehicles),
        "p50_ms": 1e3 * percentile(latencies, 0.5),
        "p99_ms": 1e3 * percentile(latencies, 0.99),
        "max_ms": 1e3 * max(latencies),
        "cpu_listener": (time.process_time() - cpu_s) / (end_s - begin_s),
    }


async def _free_port() -> int:
    server = await asyncio.start_server(lambda _r, _w: None, "127.0.0.1", 0)
    port: int = server.sockets[0].getsockname()[1]
    server.close()
    await server.wait_closed()
    return port


if __name__ == "__main__":
    print(msgspec.json.encode(asyncio.run(_listen(sys.argv[1], float(sys.argv[2]), float(sys.argv[3])))).decode())
