"""A simulated vehicle and cameras in real time: what a lab's network would send and take, on loopback."""

import asyncio
import contextlib
from collections.abc import Mapping

from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig
from sim.pty_wire import PtyWire
from sim.stage import Stage
from sim.world import World


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
    """Serve until ``duration_s`` [s] have passed (None: until interrupted); returns the exit code."""
    link = config.link
    pty = None if isinstance(link, MavlinkLinkConfig) else PtyWire()
    stage = Stage(world, config, seed, autopilot=autopilot, parameters=parameters, pty=pty)
    if isinstance(link, MavlinkLinkConfig):
        end = f"{autopilot} autopilot (MAVLink) to udp {link.address}"
    else:
        assert pty is not None, "every other link is a radio's"
        end = f"{type(link).__struct_config__.tag} receiver on {pty.path}"
    poses = getattr(config.pose, "listen", "the MAVLink connection")
    print(f"serving {name}: {end}, poses to {poses}. Ctrl-C ends.", flush=True)
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(stage.run(), duration_s)
    if pty is not None:
        pty.close()
    touchdown = stage.plant.touchdown_m_s
    if touchdown is not None:
        print(f"touched down at {touchdown:.2f} m/s", flush=True)
    return 0
