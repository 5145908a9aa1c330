"""The simulated motion-capture system: samples the plant at the cameras' rate, emits the source's real bytes."""

import asyncio
import math
from collections.abc import Callable

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.runtime import sleep_until
from sim.trackers.trackers import Seen, Tracker
from sim.world import Quadrotor, Truth, Wander, World, rows, stream, with_noise

CIRCLE_M, APART_M, CIRCLE_RAD_S = 2.5, 0.5, 0.4
"""Where the other bodies are: radius of the first one's circle, and by how much each next one is larger; speed."""


class Mocap:
    """Cameras that run by themselves: their phase against our frames is drawn from the seed."""

    def __init__(self, world: World, plant: Quadrotor, seed: int, name: str, tracker: Tracker) -> None:
        """Have ``tracker`` send what the cameras see; the vehicle is called ``name``."""
        self._world = world
        self._plant = plant
        self._phase = stream(seed, "phase").random()
        self._noise = rows(stream(seed, "noise").standard_normal, 6)
        self._luck = rows(stream(seed, "pose loss").random, 1)
        self._wander = Wander(world, rows(stream(seed, "cameras' wander").standard_normal, 3))
        self._name = name
        self._tracker = tracker
        self._covered = False
        self._begun_s = 0.0
        self._last: tuple[Vec3, Quat] | None = None

    def cover(self, covered: bool) -> None:
        """Cover the cameras: no pose leaves until they are uncovered."""
        self._covered = covered

    def see(self, plant: Quadrotor) -> None:
        """From now on take that vehicle for ours."""
        self._plant = plant

    def through(self, wrap: Callable[[Tracker], Tracker]) -> None:
        """From now on let every frame pass what ``wrap`` puts before the tracking computer."""
        self._tracker = wrap(self._tracker)

    async def run(self) -> None:
        """Emit until cancelled."""
        loop = asyncio.get_running_loop()
        world = self._world
        await self._tracker.open()
        period = 1.0 / world.pose_rate_hz
        start = self._begun_s = loop.time() + self._phase * period
        frame = 0
        try:
            while True:
                when = start + frame * period
                await sleep_until(when)
                # The instant of the exposure is the scheduled one: a late wake-up must not move the truth.
                truth = with_noise(self._plant.truth(when), world, next(self._noise))
                truth = self._wander.seen(truth, self._plant.released_s)
                if not self._lost(when, next(self._luck)[0]):
                    bodies = self._seen(truth, when)
                    if world.pose_latency_s > 0.0:
                        loop.call_at(when + world.pose_latency_s, self._tracker.send, frame, when, bodies)
                    else:
                        self._tracker.send(frame, when, bodies)
                frame += 1
        finally:
            self._tracker.close()

    def _seen(self, truth: Truth, when: float) -> list[Seen]:
        """Our body first: where it is hidden, the last that was seen of it."""
        world = self._world
        position, attitude = truth.position_ned, truth.attitude
        others = [_circling(n, when) for n in range(world.other_bodies)]
        hidden = self._mishap(when, world.occlusion_s, 0.5)
        if hidden and self._last is not None:
            position, attitude = self._last
        elif self._mishap(when, world.swap_s, 0.75):
            others[:1] = [(position, attitude)] if others else []
            position, attitude = _circling(0, when)
        self._last = position, attitude
        bodies = [Seen(self._name, position, attitude, not hidden)]
        return bodies + [Seen(f"other{n}", *pose, True) for n, pose in enumerate(others)]

    def _mishap(self, when: float, length_s: float, share: float) -> bool:
        """Whether one that begins after ``share`` of each period, and takes ``length_s``, is going on.

        The periods begin with the first frame, and anew as the vehicle is released: so a flight's do not depend on how
        long it was made ready.
        """
        if length_s <= 0.0:
            return False
        released, period = self._plant.released_s, self._world.mishap_period_s
        since = self._begun_s if released is None or when < released else released
        return 0.0 <= (when - since) % period - share * period < length_s

    def _lost(self, when: float, luck: float) -> bool:
        """Lost at random, or within one of the regular outages (the last part of each period)."""
        world = self._world
        if self._covered or luck < world.pose_loss:
            return True
        released = self._plant.released_s
        if not world.outage_s or released is None or when < released:
            return False
        return (when - released) % world.outage_period_s >= world.outage_period_s - world.outage_s


def _circling(number: int, when: float) -> tuple[Vec3, Quat]:
    angle = CIRCLE_RAD_S * when + number
    radius = CIRCLE_M + APART_M * number
    position = (radius * math.cos(angle), radius * math.sin(angle), -1.0)
    return position, so3.from_euler_zyx(0.0, 0.0, math.remainder(angle, math.tau))
