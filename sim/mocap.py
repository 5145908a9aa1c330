"""The simulated motion-capture system: samples the plant at the cameras' rate, emits the source's real bytes."""

import asyncio
from collections.abc import Callable

from groundstation.clock import sleep_until
from sim.airframe import Truth
from sim.draws import rows, stream
from sim.quadrotor import Quadrotor
from sim.vehicle import with_noise
from sim.world import World

Encoder = Callable[[int, Truth], bytes]
"""Frame number and what the cameras saw -> the datagram."""


class Mocap:
    """Cameras that run by themselves: their phase against our frames is drawn from the seed."""

    def __init__(self, world: World, plant: Quadrotor, seed: int, encode: Encoder, target: tuple[str, int]) -> None:
        """Send to ``target`` what ``encode`` makes of each camera frame."""
        self._world = world
        self._plant = plant
        self._phase = stream(seed, "phase").random()
        self._noise = rows(stream(seed, "noise").standard_normal, 6)
        self._luck = rows(stream(seed, "pose loss").random, 1)
        self._encode = encode
        self._target = target
        self._covered = False

    def cover(self, covered: bool) -> None:
        """Cover the cameras: no pose leaves until they are uncovered."""
        self._covered = covered

    async def run(self) -> None:
        """Emit until cancelled."""
        loop = asyncio.get_running_loop()
        world = self._world
        transport, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=self._target)
        period = 1.0 / world.pose_rate_hz
        start = loop.time() + self._phase * period
        frame = 0
        try:
            while True:
                when = start + frame * period
                await sleep_until(when)
                # The instant of the exposure is the scheduled one: a late wake-up must not move the truth.
                seen = with_noise(self._plant.truth(when), world, next(self._noise))
                if not self._lost(when, next(self._luck)[0]):
                    data = self._encode(frame, seen)
                    if world.pose_latency_s > 0.0:
                        loop.call_at(when + world.pose_latency_s, transport.sendto, data)
                    else:
                        transport.sendto(data)
                frame += 1
        finally:
            transport.close()

    def _lost(self, when: float, luck: float) -> bool:
        """Lost at random, or within one of the regular outages (the last part of each period)."""
        world = self._world
        if self._covered or luck < world.pose_loss:
            return True
        released = self._plant.released_s
        if not world.outage_s or released is None or when < released:
            return False
        return (when - released) % world.outage_period_s >= world.outage_period_s - world.outage_s
