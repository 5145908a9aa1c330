"""The plant: a rigid body on SO(3) with lagging thrust and body rates, in wind. Equations (1)-(4) of the paper.

p¨ = -(T/m) R e3 + g e3 + b - k v,   R˙ = R S(ω),   T and ω follow their commands through first-order lags.

It advances when it is asked for a later instant, in equal steps of at most ``world.step_s``: lags exact,
attitude by the exact integral of the rates, translation by Simpson's rule (fourth order in the step).
"""

import math
from collections.abc import Callable

from groundstation import so3
from groundstation.ops import Quat, Vec3
from sim.airframe import Truth
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
        self._p: Vec3 = world.start_ned
        self._v: Vec3 = (0.0, 0.0, 0.0)
        self._q: Quat = so3.IDENTITY
        self._thrust = world.start_thrust * world.mass_kg * world.gravity
        self._w: Vec3 = (0.0, 0.0, 0.0)
        self._thrust_command = 0.0
        self._rate_command: Vec3 = (0.0, 0.0, 0.0)
        self._on_ground = False
        self._step_cache = (0.0, 0.0, 0.0, 0.0, 0.0)
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
        return Truth(self._time, self._p, self._v, self._q, self._w, self._thrust, self._on_ground)

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
                    self._on_step(self._time, self._p)
        self._time = time_s

    def _step(self, flight_time: float, h: float) -> None:
        world = self._world
        if self._step_cache[0] != h:
            tt, tw = world.thrust_lag_s, world.rate_lag_s
            self._step_cache = (
                h,
                math.exp(-0.5 * h / tt) if tt > 0.0 else 0.0,
                math.exp(-h / tt) if tt > 0.0 else 0.0,
                math.exp(-0.5 * h / tw) if tw > 0.0 else 0.0,
                math.exp(-h / tw) if tw > 0.0 else 0.0,
            )
        _, thrust_mid_keep, thrust_keep, mid_keep, keep = self._step_cache
        self._wind.step(h)
        bx, by, bz = self._wind.at(flight_time + 0.5 * h)
        (wx, wy, wz), (cx, cy, cz) = self._w, self._rate_command
        dx, dy, dz = wx - cx, wy - cy, wz - cz
        tau = world.rate_lag_s
        half, full = 0.5 * h, h
        m, f = tau * (1.0 - mid_keep), tau * (1.0 - keep)
        q0 = self._q
        q1 = so3.turned(q0, (half * cx + m * dx, half * cy + m * dy, half * cz + m * dz))
        q2 = so3.turned(q0, (full * cx + f * dx, full * cy + f * dy, full * cz + f * dz))
        thrust_command = self._thrust_command
        over = self._thrust - thrust_command
        # Without lag the thrust is the commanded one from the first instant on.
        t0 = self._thrust if world.thrust_lag_s > 0.0 else thrust_command
        t1 = thrust_command + thrust_mid_keep * over
        t2 = thrust_command + thrust_keep * over
        gravity, mass, drag = world.gravity, world.mass_kg, world.drag_per_s
        if world.rate_leak:
            lx, ly, lz = so3.to_world(q1, (world.rate_leak * cy, -world.rate_leak * cx, 0.0))
            bx, by, bz = bx + lx, by + ly, bz + lz
        bz += gravity
        (px, py, pz), (vx, vy, vz) = self._p, self._v
        ax, ay, az = so3.third_column(q0)
        k = -t0 / mass
        ax, ay, az = k * ax + bx - drag * vx, k * ay + by - drag * vy, k * az + bz - drag * vz
        mx, my, mz = so3.third_column(q1)
        k = -t1 / mass
        mx = k * mx + bx - drag * (vx + half * ax)
        my = k * my + by - drag * (vy + half * ay)
        mz = k * mz + bz - drag * (vz + half * az)
        ex, ey, ez = so3.third_column(q2)
        k = -t2 / mass
        ex = k * ex + bx - drag * (vx + h * mx)
        ey = k * ey + by - drag * (vy + h * my)
        ez = k * ez + bz - drag * (vz + h * mz)
        s, d = h / 6.0, h * h / 6.0
        self._p = (
            px + h * vx + d * (ax + 2.0 * mx),
            py + h * vy + d * (ay + 2.0 * my),
            pz + h * vz + d * (az + 2.0 * mz),
        )
        self._v = (vx + s * (ax + 4.0 * mx + ex), vy + s * (ay + 4.0 * my + ey), vz + s * (az + 4.0 * mz + ez))
        self._q = q2
        self._thrust = t2
        self._w = (cx + keep * dx, cy + keep * dy, cz + keep * dz)
        self._touch_floor()

    def _touch_floor(self) -> None:
        """Rest on the floor, upright, while there is no more lift than weight."""
        floor = self._world.floor_z_m
        self._on_ground = self._p[2] >= floor
        if not self._on_ground:
            return
        if self.touchdown_m_s is None and self._v[2] > 0.0:
            self.touchdown_m_s = self._v[2]
        yaw = so3.euler_zyx(self._q)[2]
        self._p = (self._p[0], self._p[1], floor)
        self._v = (0.0, 0.0, min(self._v[2], 0.0))
        self._q = so3.from_euler_zyx(0.0, 0.0, yaw)
        self._w = (0.0, 0.0, 0.0)
