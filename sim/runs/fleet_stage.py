"""The simulated side of several flights: a plant and an autopilot each, and one capture system that sees them all."""

import asyncio
from collections.abc import Callable, Sequence

from groundstation.config import ConfigError
from groundstation.core.geometry import Vec3
from groundstation.runtime import sleep_until
from groundstation.settings import Config
from sim.runs.stage import Stage
from sim.trackers import Seen, Tracker, make_tracker
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
            Stage(world, lab, seed + SEEDS_APART * number, _numbered(on_step, number), autopilot=autopilot, alone=False)
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
        self._last: dict[str, Seen] = {}
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
                    now = Seen(name, truth.position_ned, truth.attitude, True)
                    if name in self.hidden:  # the last that was seen of it
                        now = self._last.get(name, now)._replace(tracked=False)
                    self._last[name] = now
                    seen.append(now)
                loop.call_at(when + world.pose_latency_s, self._send, frame, when, seen)
                frame += 1
        finally:
            tracker.close()

    def _send(self, frame: int, when: float, seen: list[Seen]) -> None:
        self.sent_s = asyncio.get_running_loop().time()
        self._tracker.send(frame, when, seen)


def _numbered(on_step: OnStep, number: int) -> Callable[[float, Vec3], None]:
    return lambda time_s, place: on_step(number, time_s, place)
