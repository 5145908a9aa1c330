"""What differs from flight to flight in a campaign: the vehicle and the wind, drawn from each flight's seed alone."""

import math

import msgspec
import numpy as np

from groundstation.ops import Vec3
from sim.draws import stream
from sim.world import World

MASS = (0.9, 1.1)
"""Mass over the scenario's, uniform [-]."""
LAG = (0.8, 1.2)
"""Each lag, of the thrust and of the rates, over the scenario's, uniform and each by itself [-]."""
THRUST_GAIN = (0.8, 1.1)
"""True thrust over commanded thrust, uniform, whatever the scenario says [-]."""
DRAWN = ("mass_kg", "thrust_lag_s", "rate_lag_s", "thrust_gain", "wind_mean", "wind_gust")
"""Fields of :class:`World` that a campaign draws."""


def drawn(world: World, seed: int) -> World:
    """``world`` as the flight of ``seed`` meets it.

    The mean wind and the gusts keep their lengths; each has its own direction, uniform on the sphere. Always the
    same numbers are drawn in the same order, so that no figure of ``world`` shifts the draws of another.
    """
    random = stream(seed, "campaign")
    mass, thrust_lag, rate_lag, gain = (float(random.uniform(*bounds)) for bounds in (MASS, LAG, LAG, THRUST_GAIN))
    return msgspec.structs.replace(
        world,
        mass_kg=mass * world.mass_kg,
        thrust_lag_s=thrust_lag * world.thrust_lag_s,
        rate_lag_s=rate_lag * world.rate_lag_s,
        thrust_gain=gain,
        wind_mean=_turned(world.wind_mean, random),
        wind_gust=_turned(world.wind_gust, random),
    )


def overrides(world: World) -> list[str]:
    """What ``--set`` needs so that a single flight meets ``world`` to the last bit."""
    return [f"sim.{name}={_toml(getattr(world, name))}" for name in DRAWN]


def _turned(v: Vec3, random: np.random.Generator) -> Vec3:
    """A vector as long as ``v``; three normal numbers point in every direction with equal density."""
    x, y, z = random.standard_normal(3).tolist()
    scale = math.hypot(*v) / math.hypot(x, y, z)
    return (scale * x, scale * y, scale * z)


def _toml(value: float | Vec3) -> str:
    return "[" + ",".join(map(repr, value)) + "]" if isinstance(value, tuple) else repr(value)
