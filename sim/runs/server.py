"""Server: simulated vehicle and cameras in real time, with the wires of a lab's network on
loopback.
"""

import asyncio
import contextlib
import os
import shutil
import socket
import sys
import tempfile
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

from groundstation.config import ConfigError, refuse_value
from groundstation.core.geometry import Vec3
from groundstation.machine import ApiError, own_directory, wait_at_most
from groundstation.pose import PoseConfig
from groundstation.pose.sources import (
    JsonConfig,
    NatNetConfig,
    QualisysConfig,
    ViconConfig,
    VisionConfig,
)
from groundstation.runtime import Exit
from groundstation.settings import Config, RehearsalConfig, beacon
from links.bridge import BridgeLinkConfig
from links.mavlink import MavlinkLinkConfig
from sim.radio import PtyWire
from sim.runs.stage import FleetStage, Stage
from sim.text import notice
from sim.world import World

_PID_BITS = 22
"""Linux numbers processes below 2²² (PID_MAX_LIMIT): above is room for a vehicle's number in its
hardware id."""


@contextlib.asynccontextmanager
async def _claim(room: RehearsalConfig | None, *ends: str) -> AsyncIterator[None]:
    """Claim ``ends`` for this server: a ground station would take two servers at one end for one.

    In a rehearsal the ground station looks for this claim before it opens anything.
    """
    loop = asyncio.get_running_loop()
    if sys.platform != "linux":
        raise ConfigError("serve", notice("serve.linux_only"))
    with contextlib.ExitStack() as held:
        # Abstract sockets are in no folder, and end with their process.
        names = {f"\0groundstation-sim serve {end}": end for end in ends}
        for name, end in (names if room is None else {beacon(room): f"at {room.host}"}).items():
            try:
                transport, _ = await loop.create_datagram_endpoint(
                    asyncio.DatagramProtocol, local_addr=name, family=socket.AF_UNIX
                )
            except OSError:
                raise ConfigError("serve", notice("serve.twice", end=end)) from None
            held.callback(transport.close)
        yield


@contextlib.asynccontextmanager
async def _broker(config: Config) -> AsyncIterator[str]:
    """Run the broker of a rehearsal that publishes; yield its address in words, or why there is
    none.
    """
    if config.rehearsal is None or not config.mqtt.enabled:
        yield ""
        return
    program = shutil.which(
        "mosquitto", path=f"{os.environ.get('PATH', os.defpath)}:/usr/sbin:/usr/local/sbin"
    )
    if program is None:
        yield "; no broker: install mosquitto to rehearse MQTT"
        return
    host, port = config.mqtt.host, config.mqtt.tcp_port
    with tempfile.TemporaryDirectory(prefix="groundstation-broker-") as folder:
        settings = Path(folder) / "mosquitto.conf"
        settings.write_text(
            f"listener {port} {host}\nallow_anonymous true\npersistence false\n", "utf-8"
        )
        broker = await asyncio.create_subprocess_exec(
            program, "-c", str(settings), stderr=asyncio.subprocess.DEVNULL, start_new_session=True
        )
        try:
            yield f"; broker at {host}:{port}"
        finally:
            with contextlib.suppress(ProcessLookupError):
                broker.terminate()
            await broker.wait()


async def serve(
    name: str,
    world: World,
    config: Config,
    *,
    seed: int,
    duration_s: float | None,
    autopilot: str = "px4",
    standing: Sequence[tuple[str, Vec3]] = (),
    carried: bool = False,
) -> Exit:
    """Serve until ``duration_s`` [s] have passed (None: until interrupted); returns the exit code.

    ``standing`` are further bodies at rest, by name and position [m, NED]. With ``carried`` a hand
    makes the moves of ``groundstation carry`` for each line on standard input.

    Raises:
        ConfigError: another server has the same ends, or an address of this machine can't be used.
    """
    link, room = config.link, config.rehearsal
    async with _claim(room, *_describe_wires(config)), _broker(config) as broker:
        pty = None
        if not link.has_autopilot or link.address_key == "serial":
            pty = PtyWire(None if room is None else _in_own_folder(Path(room.serial)))
        stage = Stage(world, config, seed, autopilot=autopilot, pty=pty, standing=standing)
        if link.has_autopilot:
            stage.autopilot.uid = os.getpid()  # two simulators are two vehicles
        end = _describe_end(config, autopilot, pty)
        print(
            f"serving {name}: {end}, {_describe_poses(config.pose)}{broker}. Ctrl-C ends.",
            flush=True,
        )
        if carried:
            stage.offer_hand(seed)
        try:
            await wait_at_most(_run(stage), duration_s)
        finally:
            if pty is not None:
                pty.close()
    touchdown = stage.plant.floor.touchdown_m_s
    if touchdown is not None:
        print(f"touched down at {touchdown:.2f} m/s", flush=True)
    return Exit.DONE


async def _run(stage: Stage | FleetStage) -> None:
    """Run ``stage``.

    Raises:
        ConfigError: an address can't be opened.
    """
    try:
        await stage.run()
    except* OSError as errors:
        raise ConfigError("serve", notice("serve.cannot_play", why=errors.exceptions[0])) from None


def _describe_end(config: Config, autopilot: str, pty: PtyWire | None) -> str:
    """Describe the receiver of the commands, and its address."""
    link = config.link
    if isinstance(link, MavlinkLinkConfig):
        medium = {"tcp": "tcp", "serial": "the serial port"}.get(link.address_key, "udp")
        return f"{autopilot} autopilot (MAVLink) to {medium} {link.endpoint}"
    if isinstance(link, BridgeLinkConfig):
        return f"bridge and receiver at udp {link.remote}"
    assert pty is not None, "every other link is a radio's"
    receiver = f"{link.kind} receiver on {pty.path}"
    if config.rehearsal is not None:
        return receiver
    arm = link.map.arm
    assert arm is not None, "a scenario's receiver has an arm channel"
    return (
        f"{receiver}, for link.port beside link.simulated = true "
        f"and link.map.arm.channel = {arm.channel}"
    )


def _in_own_folder(path: Path) -> Path:
    """Return ``path``, whose folder is made readable for us alone."""
    with refuse_value("serve", ApiError):
        own_directory(path.parent)
    return path


async def serve_fleet(
    what: str,
    worlds: Sequence[World],
    labs: Sequence[Config],
    *,
    seed: int,
    duration_s: float | None,
    autopilot: str = "px4",
) -> Exit:
    """Serve the fleet ``what``: a vehicle in each of ``worlds``, configured by ``labs``, with one
    capture system.

    Raises:
        ConfigError: the links are not MAVLink's, or another server has the same ends.
    """
    for lab in labs:
        if not lab.link.has_autopilot or lab.link.address_key == "serial":
            raise ConfigError("link.kind", notice("serve.fleet_link"), lab.vehicle.name)
    stage = FleetStage(
        worlds, labs, seed, lambda _number, _time_s, _place: None, autopilot=autopilot
    )
    for number, one in enumerate(stage.stages):
        one.autopilot.uid = os.getpid() + (number << _PID_BITS)
    ends = ", ".join(f"{lab.vehicle.name} to udp {lab.link.endpoint}" for lab in labs)
    wires = dict.fromkeys(end for lab in labs for end in _describe_wires(lab))
    async with _claim(labs[0].rehearsal, *wires), _broker(labs[0]) as broker:
        print(
            f"serving {what}: {autopilot} autopilots (MAVLink) {ends}; "
            f"{_describe_poses(labs[0].pose)}{broker}. Ctrl-C ends.",
            flush=True,
        )
        await wait_at_most(_run(stage), duration_s)
    for lab, one in zip(labs, stage.stages, strict=True):
        if one.plant.floor.touchdown_m_s is not None:
            print(
                f"{lab.vehicle.name} touched down at {one.plant.floor.touchdown_m_s:.2f} m/s",
                flush=True,
            )
    return Exit.DONE


def _describe_wires(config: Config) -> list[str]:
    """Describe the streams to one vehicle's ground station and their addresses."""
    ends = [f"MAVLink to {config.link.endpoint}"] if config.link.has_autopilot else []
    if config.pose.address_key == "listen":
        ends.append(f"poses of {config.pose.body_name} to {config.pose.address}")
    return ends


def _describe_poses(config: PoseConfig) -> str:
    """Describe the addresses of the poses."""
    match config:
        case NatNetConfig():
            how = (
                f"multicast to {config.group}:{config.data_port}" if config.multicast else "unicast"
            )
            return f"NatNet server at udp {config.server}, {how}"
        case QualisysConfig():
            return f"QTM at tcp {config.server}"
        case ViconConfig() | JsonConfig() | VisionConfig():
            return f"poses to udp {config.listen}"
        case _:
            return "poses to the MAVLink connection"
