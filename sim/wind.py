"""Wind as the acceleration it gives the vehicle: mean, sine gusts, one step, and Dryden-shaped turbulence."""

import math
import random

from groundstation.ops import Vec3
from sim.world import World

# MIL-F-8785C, low altitude: at 1 m height the scale lengths are 7.9 m along and across the wind and 1 m
# vertically; flown through at 3 m/s they become these correlation times. Indoors nothing better is known.
CORRELATION_S = (2.6, 2.6, 0.33)


class Turbulence:
    """Dryden-shaped noise per axis: longitudinal form on x, lateral form on y and z (MIL-F-8785C, 3.7)."""

    def __init__(self, rms: float, random_: random.Random) -> None:
        """Start in the stationary state; ``rms`` [m/s²] per axis."""
        self._rms = rms
        self._gauss = random_.gauss
        # Two cascaded lags: white noise -> s, s -> r. x uses s alone, y and z a mixture (a zero at √3 τ).
        self._slow = [self._gauss(0.0, 1.0) for _ in range(3)]
        self._second = [0.0, 0.0, 0.0]

    def step(self, duration: float) -> Vec3:
        """The turbulence [m/s²] after ``duration`` [s]."""
        if self._rms == 0.0:
            return (0.0, 0.0, 0.0)
        out = [0.0, 0.0, 0.0]
        for i, time in enumerate(CORRELATION_S):
            keep = math.exp(-duration / time)
            slow = keep * self._slow[i] + math.sqrt(1.0 - keep * keep) * self._gauss(0.0, 1.0)
            if i == 0:
                out[i] = self._rms * slow
            else:
                # G(s) ~ (1 + √3 τ s)/(1 + τ s)²  =  √3/(1 + τ s) - (√3 - 1)/(1 + τ s)²; unit variance: / √1.
                self._second[i] = keep * self._second[i] + (1.0 - keep) * slow
                root = math.sqrt(3.0)
                out[i] = self._rms * (root * slow - (root - 1.0) * self._second[i]) / LATERAL_RMS
            self._slow[i] = slow
        return (out[0], out[1], out[2])


# Stationary rms of √3 x - (√3 - 1) y with x a unit Ornstein-Uhlenbeck process of time τ and y = x through a
# lag τ: E[x²] = 1, E[xy] = E[y²] = 1/2.
LATERAL_RMS = math.sqrt(3.0 - math.sqrt(3.0) * (math.sqrt(3.0) - 1.0) + 0.5 * (math.sqrt(3.0) - 1.0) ** 2)


class Wind:
    """The disturbance acceleration b(t) [m/s², NED]."""

    def __init__(self, world: World, random_: random.Random) -> None:
        """Take the world's wind figures and the stream of random numbers for turbulence."""
        self._world = world
        self._turbulence = Turbulence(world.wind_turbulence, random_)
        self._now: Vec3 = (0.0, 0.0, 0.0)

    def step(self, duration: float) -> None:
        """Let ``duration`` [s] pass."""
        if self._world.wind_turbulence:
            self._now = self._turbulence.step(duration)

    def at(self, flight_time: float) -> Vec3:
        """b at ``flight_time`` [s] after release."""
        world = self._world
        (mx, my, mz), (tx, ty, tz) = world.wind_mean, self._now
        if world.wind_gust != (0.0, 0.0, 0.0):
            sine = math.sin(2.0 * math.pi * world.wind_gust_hz * flight_time)
            gx, gy, gz = world.wind_gust
            mx, my, mz = mx + gx * sine, my + gy * sine, mz + gz * sine
        if flight_time >= world.wind_step_time_s:
            sx, sy, sz = world.wind_step
            mx, my, mz = mx + sx, my + sy, mz + sz
        return (mx + tx, my + ty, mz + tz)
