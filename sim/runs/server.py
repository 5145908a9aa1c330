"""A simulated vehicle and cameras in real time: what a lab's network would send and take, on loopback."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping

import msgspec

from groundstation.config import ConfigError
from groundstation.lab import FleetPlan
from groundstation.pose import PoseConfig
from groundstation.pose.sources import JsonConfig, NatNetConfig, QualisysConfig, ViconConfig, VisionConfig
from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig
from sim.radio import PtyWire
from sim.runs.stage import FleetStage, Stage
from sim.world import World

AF_UNIX = 1
"""A number of Linux."""


@contextlib.asynccontextmanager
async def _alone(*ends: str) -> AsyncIterator[None]:
    """Keep others like us from ``ends``, by what is sent and where: a ground station would take two for one.

    Raises:
        ConfigError: another one is there already.
    """
    loop = asyncio.get_running_loop()
    with contextlib.ExitStack() as held:
        for end in ends:
            name = f"\0groundstation-sim serve {end}"  # in no folder, and gone with its process
            try:
                transport, _ = await loop.create_datagram_endpoint(
                    asyncio.DatagramProtocol, local_addr=name, family=AF_UNIX
                )
            except OSError:
                says = f"another `groundstation-sim serve` sends {end} already: stop it, or --set another address"
                raise ConfigError("serve", says) from None
            held.callback(transport.close)
        yield


async def serve(
    name: str,
    world: World,
    config: Config,
    *,
    seed: int,
    duration_s: float | None,
    autopilot: str = "px4",
    parameters: Mapping[str, float] | None = None,
) -> int:
    """Serve until ``duration_s`` [s] have passed (None: until interrupted); returns the exit code.

    Raises:
        ConfigError: another one serves the same.
    """
    link = config.link
    pty = None if isinstance(link, MavlinkLinkConfig) else PtyWire()
    stage = Stage(world, config, seed, autopilot=autopilot, parameters=parameters, pty=pty)
    if isinstance(link, MavlinkLinkConfig):
        end = f"{autopilot} autopilot (MAVLink) to udp {link.address}"
    else:
        assert pty is not None, "every other link is a radio's"
        end = f"{type(link).__struct_config__.tag} receiver on {pty.path}, for link.port beside link.simulated = true"
    async with _alone(*_describe_wires(config)):
        print(f"serving {name}: {end}, {_poses(config.pose)}. Ctrl-C ends.", flush=True)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stage.run(), duration_s)
    if pty is not None:
        pty.close()
    touchdown = stage.plant.touchdown_m_s
    if touchdown is not None:
        print(f"touched down at {touchdown:.2f} m/s", flush=True)
    return 0


async def serve_fleet(
    world: World, fleet: FleetPlan, *, seed: int, duration_s: float | None, autopilot: str = "px4"
) -> int:
    """Serve a vehicle like that of ``world`` for each of a fleet, below where its trajectory begins.

    Raises:
        ConfigError: the links are not MAVLink's, or another one serves the same.
    """
    labs, worlds = [member.lab for member in fleet.members], []
    for member in fleet.members:
        link, flight = member.lab.link, member.lab.flight
        if not isinstance(link, MavlinkLinkConfig):
            raise ConfigError("link.kind", "expected mavlink: of a fleet nothing else is simulated", member.name)
        start = member.lab.trajectory.build().position_at(0.0)
        if flight.start == "floor":
            start, world = (start[0], start[1], flight.floor_z_m), msgspec.structs.replace(world, start_thrust=0.0)
        worlds.append(msgspec.structs.replace(world, start_ned=start, floor_z_m=flight.floor_z_m))
    stage = FleetStage(worlds, labs, seed, lambda _number, _time_s, _place: None, autopilot=autopilot)
    ends = ", ".join(f"{member.name} to udp {getattr(member.lab.link, 'address', '')}" for member in fleet.members)
    async with _alone(*dict.fromkeys(end for lab in labs for end in _describe_wires(lab))):
        print(f"serving {autopilot} autopilots (MAVLink): {ends}; {_poses(labs[0].pose)}. Ctrl-C ends.", flush=True)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stage.run(), duration_s)
    for member, one in zip(fleet.members, stage.stages, strict=True):
        if one.plant.touchdown_m_s is not None:
            print(f"{member.name} touched down at {one.plant.touchdown_m_s:.2f} m/s", flush=True)
    return 0


def _describe_wires(config: Config) -> list[str]:
    """What is sent to one vehicle's ground station, and where; a radio's pseudo-terminal is nobody else's anyway."""
    ends = [f"MAVLink to {config.link.address}"] if isinstance(config.link, MavlinkLinkConfig) else []
    if (cameras := getattr(config.pose, "listen", None)) is not None:
        ends.append(f"poses of {getattr(config.pose, 'object', '')} to {cameras}")
    return ends


def _poses(config: PoseConfig) -> str:
    """Where poses come from, or go to, in words."""
    match config:
        case NatNetConfig():
            how = f"multicast to {config.group}:{config.data_port}" if config.multicast else "unicast"
            return f"NatNet server at udp {config.server}, {how}"
        case QualisysConfig():
            return f"QTM at tcp {config.server}"
        case ViconConfig() | JsonConfig() | VisionConfig():
            return f"poses to udp {config.listen}"
        case _:
            return "poses to the MAVLink connection"
