"""Wind as the acceleration it gives the vehicle: mean, sine gusts, one step, and Dryden-shaped turbulence."""

import math
from collections.abc import Iterator
from typing import NamedTuple

from groundstation.core.geometry import Real, Vec3
from sim.world.world import World

# MIL-F-8785C, low altitude: at 1 m height the scale lengths are 7.9 m along and across the wind and 1 m
# vertically; flown through at 3 m/s they become these correlation times. Indoors nothing better is known.
CORRELATION_S = (2.6, 2.6, 0.33)


GRID_S = 0.0025
"""Turbulence moves once in this time, and is held between [s]."""
# The lateral form (1 + √3 τs)/(1 + τs)² is √3 x - (√3 - 1) y: x has time τ and unit variance, y is x through one more
# lag τ; E[x²] = 1, E[xy] = E[y²] = 1/2.
ROOT3 = math.sqrt(3.0)
LATERAL_RMS = math.sqrt(3.0 - ROOT3 * (ROOT3 - 1.0) + 0.5 * (ROOT3 - 1.0) ** 2)
KEEP: Vec3 = (
    math.exp(-GRID_S / CORRELATION_S[0]),
    math.exp(-GRID_S / CORRELATION_S[1]),
    math.exp(-GRID_S / CORRELATION_S[2]),
)
SPREAD: Vec3 = (math.sqrt(1.0 - KEEP[0] ** 2), math.sqrt(1.0 - KEEP[1] ** 2), math.sqrt(1.0 - KEEP[2] ** 2))


class Eddies(NamedTuple):
    """The state of the turbulence: x, y and z through one lag, y and z through a second one. Elementwise."""

    once: Vec3
    twice_y: Real
    twice_z: Real


def begun(normals: Vec3) -> Eddies:
    """In the stationary state, from three standard normal numbers."""
    return Eddies(normals, 0.0, 0.0)


def stirred(eddies: Eddies, normals: Vec3) -> Eddies:
    """One grid step later, from three standard normal numbers."""
    (x, y, z), twice_y, twice_z = eddies
    x, y, z = (
        KEEP[0] * x + SPREAD[0] * normals[0],
        KEEP[1] * y + SPREAD[1] * normals[1],
        KEEP[2] * z + SPREAD[2] * normals[2],
    )
    return Eddies((x, y, z), KEEP[1] * twice_y + (1.0 - KEEP[1]) * y, KEEP[2] * twice_z + (1.0 - KEEP[2]) * z)


def felt(eddies: Eddies, rms: Real) -> Vec3:
    """The turbulence [m/s², NED]: Dryden's longitudinal form on x, lateral form on y and z (MIL-F-8785C, 3.7)."""
    (x, y, z), twice_y, twice_z = eddies
    k = rms / LATERAL_RMS
    return (rms * x, k * (ROOT3 * y - (ROOT3 - 1.0) * twice_y), k * (ROOT3 * z - (ROOT3 - 1.0) * twice_z))


def steady(world: World, flight_time: float) -> Vec3:
    """Mean, gust and step [m/s², NED] at ``flight_time`` [s]."""
    mx, my, mz = world.wind_mean
    if world.wind_gust != (0.0, 0.0, 0.0):
        sine = math.sin(2.0 * math.pi * world.wind_gust_hz * flight_time)
        gx, gy, gz = world.wind_gust
        mx, my, mz = mx + gx * sine, my + gy * sine, mz + gz * sine
    if flight_time >= world.wind_step_time_s:
        sx, sy, sz = world.wind_step
        mx, my, mz = mx + sx, my + sy, mz + sz
    return (mx, my, mz)


def cell(flight_time: float) -> int:
    """Which step of the grid ``flight_time`` [s] lies in; a time that is a step's start but for rounding does."""
    return int(flight_time / GRID_S + 1e-6)


class Wind:
    """The disturbance acceleration b(t) [m/s², NED] of one flight; questions go forward in time."""

    def __init__(self, world: World, normals: Iterator[list[float]]) -> None:
        """Take the world's wind figures, and rows of three standard normal numbers for the turbulence."""
        self._world = world
        self._normals = normals
        self._index = -1
        self._eddies: Eddies | None = None
        self._felt: Vec3 = (0.0, 0.0, 0.0)
        self.push: Vec3 = (0.0, 0.0, 0.0)
        """What comes on top of all that the world has [m/s², NED]; may be changed in flight."""

    def at(self, flight_time: float) -> Vec3:
        """b at ``flight_time`` [s] after release."""
        x, y, z = steady(self._world, flight_time)
        if self.push != (0.0, 0.0, 0.0):
            x, y, z = x + self.push[0], y + self.push[1], z + self.push[2]
        if not self._world.wind_turbulence:
            return (x, y, z)
        index = cell(flight_time)
        while self._index < index:
            a, b, c = next(self._normals)
            self._eddies = begun((a, b, c)) if self._eddies is None else stirred(self._eddies, (a, b, c))
            self._felt = felt(self._eddies, self._world.wind_turbulence)
            self._index += 1
        tx, ty, tz = self._felt
        return (x + tx, y + ty, z + tz)
