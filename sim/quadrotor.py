"""One simulated vehicle in time: held, released, flying, on the floor. Its physics are in plant.py.

It advances when it is asked for a later instant, in equal steps of at most ``world.step_s``.
"""

import math
from collections.abc import Callable

from groundstation import so3
from groundstation.ops import FLOATS, Vec3
from sim.airframe import Truth
from sim.plant import Body, Physics, moved
from sim.wind import Wind
from sim.world import World


class Quadrotor:
    """One simulated vehicle. It is held at ``world.start_ned`` until released. Implements Airframe's physics."""

    def __init__(self, world: World, wind: Wind, on_step: Callable[[float, Vec3], None] | None = None) -> None:
        """Hold the vehicle at its start; ``on_step(time_s, position_ned)`` sees every step after release."""
        self._world = world
        self._wind = wind
        self._on_step = on_step
        self._time = 0.0
        self.released_s: float | None = None
        self._physics = Physics(
            world.mass_kg,
            world.thrust_lag_s,
            world.rate_lag_s,
            world.drag_per_s,
            world.rate_leak,
            world.gravity,
        )
        thrust = world.start_thrust * world.mass_kg * world.gravity
        self._body = Body(world.start_ned, (0.0, 0.0, 0.0), so3.IDENTITY, thrust, (0.0, 0.0, 0.0))
        self._thrust_command = 0.0
        self._rate_command: Vec3 = (0.0, 0.0, 0.0)
        self._on_ground = False
        x, y, z = world.rate_limits_deg_s
        self._limits: Vec3 = (math.radians(x), math.radians(y), math.radians(z))
        self.touchdown_m_s: float | None = None

    def command(self, time_s: float, thrust_n: float, rates: Vec3) -> None:
        """From ``time_s`` on: thrust [N] as commanded (gain and limits apply here) and rates [rad/s, FRD]."""
        self.advance(time_s)
        world, (a, b, c) = self._world, self._limits
        gain = world.thrust_gain
        if world.thrust_sag and self.released_s is not None:
            gain *= 1.0 - world.thrust_sag * min(1.0, (time_s - self.released_s) / 60.0)
        self._thrust_command = gain * min(max(thrust_n, 0.0), world.thrust_max_n)
        self._rate_command = (
            min(max(rates[0], -a), a),
            min(max(rates[1], -b), b),
            min(max(rates[2], -c), c),
        )

    def release(self, time_s: float) -> None:
        """Let go of the vehicle; does nothing the second time."""
        if self.released_s is None:
            self.advance(time_s)
            self.released_s = time_s

    def truth(self, time_s: float) -> Truth:
        """The exact state at ``time_s`` [s], which must not lie before an earlier question."""
        self.advance(time_s)
        p, v, q, thrust, rates = self._body
        return Truth(self._time, p, v, q, rates, thrust, self._on_ground)

    def advance(self, time_s: float) -> None:
        """Let the physics run until ``time_s`` [s]."""
        span = time_s - self._time
        if span <= 0.0:
            return
        if self.released_s is not None and span > 1e-12:
            start = self._time
            count = math.ceil(span / self._world.step_s - 1e-9) or 1
            h = span / count
            for k in range(count):
                self._step(start + k * h - self.released_s, h)
                self._time = start + (k + 1) * h
                if self._on_step is not None:
                    self._on_step(self._time, self._body.position)
        self._time = time_s

    def _step(self, flight_time: float, h: float) -> None:
        wind = self._wind.at(flight_time + 0.5 * h)
        body = moved(FLOATS, self._body, self._thrust_command, self._rate_command, wind, h, self._physics)
        self._body = body if body.position[2] < self._world.floor_z_m else self._on_floor(body)
        self._on_ground = body.position[2] >= self._world.floor_z_m

    def _on_floor(self, body: Body) -> Body:
        """Rest on the floor, upright, while there is no more lift than weight."""
        x, y, _ = body.position
        if self.touchdown_m_s is None and body.velocity[2] > 0.0:
            self.touchdown_m_s = body.velocity[2]
        yaw = so3.euler_zyx(body.attitude)[2]
        return Body(
            (x, y, self._world.floor_z_m),
            (0.0, 0.0, min(body.velocity[2], 0.0)),
            so3.from_euler_zyx(0.0, 0.0, yaw),
            body.thrust,
            (0.0, 0.0, 0.0),
        )
