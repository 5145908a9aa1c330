"""A lab for several simulated vehicles: the files that a user would write, and the truth of each vehicle."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from groundstation.config import ConfigError, dump
from groundstation.pose.sources import NatNetConfig
from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig
from sim.world import World

APART_M = 3.0
"""From one vehicle's figure to the next one's, in a square grid [m]."""
MOST = 13
"""So many bodies fit into one datagram of the Vicon stream."""


def lay_out(
    folder: Path, world: World, config: Config, count: int, ports: Sequence[int], apart_m: float = APART_M
) -> tuple[Path, list[World]]:
    """Write ``lab.toml`` and ``fleet.toml`` into ``folder``, for ``count`` vehicles like the one told.

    Args:
        folder: of the two files.
        world: the truth of the first vehicle, the others' differing by where they are.
        config: what all are told; its trajectory is moved for each.
        count: how many vehicles.
        ports: free UDP ports: one for poses, one for the first of ``count`` copies of them, which follow one another,
            and one for each vehicle's link.
        apart_m: from one figure to the next [m].

    Returns:
        The fleet file, and the truth of each vehicle.

    Raises:
        ConfigError: the trajectory can't be moved, or link or count are none for a fleet.
    """
    if not 1 <= count <= MOST:
        raise ConfigError("--vehicles", f"expected 1 to {MOST}, got {count}")
    if not isinstance(config.link, MavlinkLinkConfig):
        raise ConfigError("--link", "expected mavlink for several vehicles")
    pose_port, relay_port, *link_ports = ports
    key = next((k for k in ("centre_ned", "position_ned") if hasattr(config.trajectory, k)), None)
    if key is None:
        raise ConfigError("trajectory.kind", "several vehicles are simulated on lemniscate, circle and hold")
    pose: Any = config.pose
    where = (
        {"server": f"127.0.0.1:{pose_port}"} if isinstance(pose, NatNetConfig) else {"listen": f"127.0.0.1:{pose_port}"}
    )
    if all(hasattr(pose, name) for name in where):
        config = msgspec.structs.replace(config, pose=msgspec.structs.replace(pose, **where))
    (folder / "lab.toml").write_text(dump(config), "utf-8")
    north, east, down = getattr(config.trajectory, key)
    across = math.ceil(math.sqrt(count))
    worlds, vehicles = [], list[dict[str, Any]]()
    for number in range(count):
        x, y = apart_m * (number % across), apart_m * (number // across)
        start = world.start_ned
        worlds.append(msgspec.structs.replace(world, start_ned=(start[0] + x, start[1] + y, start[2])))
        vehicles.append(
            {
                "name": f"quad{number + 1}",
                "link": {"listen": f"127.0.0.1:{link_ports[number]}"},
                "trajectory": {key: [north + x, east + y, down]},
            }
        )
    file = folder / "fleet.toml"
    file.write_text(tomli_w.dumps({"config": "lab.toml", "relay_port": relay_port, "vehicles": vehicles}), "utf-8")
    return file, worlds
