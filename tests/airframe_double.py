"""A point of mass 1 that turns at once and writes down what is done to it, and RF links to it."""

import asyncio
import itertools
from typing import Any

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from links.core import Command, Segment
from sim.radio import RfReceiver
from sim.world import TrueState

GRAVITY = 9.81


class Brick:
    """Implements :class:`sim.world.airframe.Airframe`: floor at z = 0, thrust 1 lifts 2 g."""

    def __init__(self, height_m: float = 0.0, *, held: bool = False) -> None:
        self.acts: list[tuple[float, float, Vec3]] = []
        self.powered: list[tuple[float, bool]] = []
        self.released: list[float] = []
        self.attitude: Quat = so3.IDENTITY
        self._position: Vec3 = (0.0, 0.0, -height_m)
        self._velocity: Vec3 = (0.0, 0.0, 0.0)
        self._on = False
        self._held = held
        self._thrust = 0.0
        self._rates: Vec3 = (0.0, 0.0, 0.0)
        self._time: float | None = None

    def act(self, time_s: float, thrust_fraction: float, rates_rad_s: Vec3) -> None:
        self._move(time_s)
        self.acts.append((time_s, thrust_fraction, rates_rad_s))
        self._thrust, self._rates = thrust_fraction, rates_rad_s

    def power(self, time_s: float, on: bool) -> None:
        self._move(time_s)
        self.powered.append((time_s, on))
        self._on = on

    def release(self, time_s: float) -> None:
        self._move(time_s)
        if self._held or not self.released:
            self.released.append(time_s)
        self._held = False

    def truth(self, time_s: float) -> TrueState:
        self._move(time_s)
        on_ground = not self._held and self._position[2] >= 0.0
        thrust = 2.0 * GRAVITY * self._thrust if self._on else 0.0
        return TrueState(
            time_s, self._position, self._velocity, self.attitude, self._rates, thrust, on_ground
        )

    def measure(self, time_s: float) -> TrueState:
        return self.truth(time_s)

    def estimate_attitude(self, time_s: float) -> tuple[Quat, Vec3]:
        truth = self.truth(time_s)
        return truth.attitude, truth.rates_rad_s

    def _move(self, time_s: float) -> None:
        """Euler steps of at most 1 ms."""
        if self._time is None:
            self._time = time_s
        while self._time < time_s:
            step = min(0.001, time_s - self._time)
            self._time = time_s if step < 0.001 else self._time + step
            if self._held:
                continue
            p, q, r = self._rates
            if self._on:
                self.attitude = so3.rotate(self.attitude, (p * step, q * step, r * step))
            down = so3.third_column(self.attitude)
            lift = 2.0 * GRAVITY * self._thrust if self._on else 0.0
            x, y, z = self._position
            u, v, w = self._velocity
            u, v = u - lift * down[0] * step, v - lift * down[1] * step
            w += (GRAVITY - lift * down[2]) * step
            if z + w * step >= 0.0 and w > 0.0:
                z, u, v, w = 0.0, 0.0, 0.0, 0.0
            self._position = (x + u * step, y + v * step, z + w * step)
            self._velocity = (u, v, w)


DOWN = Segment(0.5, 0.8, (0.0, 0.0, 0.0))


def command(thrust_n: float = 1.0, **changes: Any) -> Command:
    now = asyncio.get_running_loop().time()
    made = Command(thrust_n, (0.0, 0.0, 0.0), 1, now, now + 0.25, (DOWN,))
    return msgspec.structs.replace(made, **changes)


def idle() -> Command:
    return command(0.0, bring_down=())


NONCES = itertools.count(1)


def nonce(count: int) -> bytes:
    """A number that a bridge or its station takes for a random one."""
    return next(NONCES).to_bytes(count, "little")


class RfRoom:
    """A vehicle behind an RF receiver, and the link that leads there."""

    vehicle: Brick
    receiver: RfReceiver
    link: Any

    @property
    def thrust(self) -> float:
        """Share of the thrust that was commanded last; 0 where the motors are off."""
        return self.vehicle.acts[-1][1] if self.receiver.armed and self.vehicle.acts else 0.0

    async def stream(self, thrust_n: float, seconds: float) -> None:
        loop = asyncio.get_running_loop()
        until = loop.time() + seconds
        while loop.time() < until:
            self.link.send(command(thrust_n))
            await asyncio.sleep(self.link.period_s)
