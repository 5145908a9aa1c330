"""Stage of a fleet: a plant and an autopilot for each vehicle, and one capture system that sees them all.

Its lab is the files that a user would write, and the truth of each vehicle.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from groundstation.config import ConfigError, dump
from groundstation.core.geometry import Vec3
from groundstation.pose.sources import NatNetConfig
from groundstation.runtime import sleep_until
from groundstation.settings import Config
from links.mavlink import MavlinkLinkConfig
from sim.runs.stage import Stage
from sim.trackers import TrackedBody, Tracker, make_tracker
from sim.world import World, rows, stream, with_noise

SEEDS_APART = 1000
"""Between the seeds of two vehicles of one fleet."""

OnStep = Callable[[int, float, Vec3], None]
"""Takes the vehicle's number, the time [s] and the true place [m, NED] of every step of a plant."""


class FleetStage:
    """Everything that is not a ground station. Every random draw comes from ``seed``, one stream a purpose."""

    def __init__(
        self, worlds: Sequence[World], labs: Sequence[Config], seed: int, on_step: OnStep, *, autopilot: str = "px4"
    ) -> None:
        """A vehicle for each of ``worlds``; ``labs`` tell the addresses and formats to speak.

        Raises:
            ConfigError: the poses come from no capture system that sees them all.
        """
        self.stages = [
            Stage(
                world,
                lab,
                seed + SEEDS_APART * number,
                _number_steps(on_step, number),
                autopilot=autopilot,
                alone=False,
            )
            for number, (world, lab) in enumerate(zip(worlds, labs, strict=True))
        ]
        tracked = [make_tracker(lab.pose) for lab in labs]
        names = [one[0] for one in tracked if one is not None]
        if tracked[0] is None or len(set(names)) < len(labs):
            raise ConfigError("--source", "expected one that shows every vehicle: vicon, natnet, qualisys, json")
        self.mocap = FleetMocap(self.stages, names, tracked[0][1], seed)

    async def run(self) -> None:
        """Let the world turn until cancelled."""
        async with asyncio.TaskGroup() as group:
            for stage in self.stages:
                group.create_task(stage.run())
            group.create_task(self.mocap.run())


class FleetMocap:
    """Cameras that run by themselves and send one frame with all bodies."""

    def __init__(self, stages: Sequence[Stage], names: Sequence[str], tracker: Tracker, seed: int) -> None:
        """Have ``tracker`` send where the vehicle of each stage is, by its name."""
        self._bodies = [
            (name, stage, rows(stream(seed + SEEDS_APART * number, "noise").standard_normal, 6))
            for number, (name, stage) in enumerate(zip(names, stages, strict=True))
        ]
        self._tracker = tracker
        self._phase = stream(seed, "phase").random()
        self.hidden: set[str] = set()
        """Names of the bodies that the cameras do not see now."""
        self._last: dict[str, TrackedBody] = {}
        self.sent_s: float | None = None
        """When the newest frame left, on the event loop's clock [s]."""

    async def run(self) -> None:
        """Emit until cancelled."""
        loop, tracker = asyncio.get_running_loop(), self._tracker
        world = self._bodies[0][1].world
        await tracker.open()
        period = 1.0 / world.pose_rate_hz
        start, frame = loop.time() + self._phase * period, 0
        try:
            while True:
                when = start + frame * period
                await sleep_until(when)
                seen = []
                for name, stage, noise in self._bodies:
                    truth = with_noise(stage.plant.truth(when), stage.world, next(noise))
                    now = TrackedBody(name, truth.position_ned, truth.attitude, True)
                    if name in self.hidden:  # the last that was seen of it
                        now = self._last.get(name, now)._replace(tracked=False)
                    self._last[name] = now
                    seen.append(now)
                loop.call_at(when + world.pose_latency_s, self._send, frame, when, seen)
                frame += 1
        finally:
            tracker.close()

    def _send(self, frame: int, when: float, seen: list[TrackedBody]) -> None:
        self.sent_s = asyncio.get_running_loop().time()
        self._tracker.send(frame, when, seen)


def _number_steps(on_step: OnStep, number: int) -> Callable[[float, Vec3], None]:
    return lambda time_s, place: on_step(number, time_s, place)


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
