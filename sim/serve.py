"""A simulated vehicle and cameras in real time: what a lab's network would send and take, on loopback."""

import asyncio
import contextlib
from collections.abc import Mapping

from groundstation.settings import Config
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
    stage = Stage(world, config, seed, autopilot=autopilot, parameters=parameters)
    mavlink = config.link.address
    poses = getattr(config.pose, "listen", "the MAVLink connection")
    print(
        f"serving {name}: {autopilot} autopilot (MAVLink) to udp {mavlink}, poses to {poses}. Ctrl-C ends.", flush=True
    )
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(stage.run(), duration_s)
    touchdown = stage.plant.touchdown_m_s
    if touchdown is not None:
        print(f"touched down at {touchdown:.2f} m/s", flush=True)
    return 0
