"""What differs from flight to flight in a campaign: vehicle, wind and more, drawn from each flight's seed alone."""

import math
from collections.abc import Collection, Iterable
from typing import NamedTuple

import msgspec
import numpy as np

from groundstation.core.geometry import Vec3
from sim.world import World, generator


class Draw(NamedTuple):
    """Some fields of :class:`World` that are drawn together, each by itself and uniformly."""

    fields: tuple[str, ...]
    low: float
    high: float
    relative: bool
    """The bounds are shares of the scenario's value; otherwise they are in the field's own unit, whatever it says."""

    def __str__(self) -> str:
        """The range, for people."""
        bounds = f"{self.low:g} to {self.high:g}"
        return f"{' and '.join(self.fields)} {bounds}{' times the scenario' if self.relative else ''}"


DRAWS: dict[str, tuple[Draw, ...]] = {
    "mass": (Draw(("mass_kg",), 0.9, 1.1, True),),
    "lags": (Draw(("thrust_lag_s", "rate_lag_s"), 0.8, 1.2, True),),
    "gain": (Draw(("thrust_gain",), 0.8, 1.1, False),),
    "wind": (),
    "latency": (Draw(("pose_latency_s",), 0.75, 1.5, True),),
    "noise": (Draw(("pose_noise_m", "attitude_noise_rad"), 0.5, 2.0, True),),
    "losses": (Draw(("pose_loss", "frame_loss"), 0.0, 0.05, False), Draw(("outage_s",), 0.0, 0.15, False)),
}
"""What can be drawn. ``wind`` turns mean wind and gusts, each to its own direction, uniform on the sphere.

The controller is told nothing of it: a pose that comes later than it is told is stamped wrongly by the difference.
"""
WINDS = ("wind_mean", "wind_gust")
USUAL = ("mass", "lags", "gain", "wind")
"""Drawn unless told otherwise: what the figures of ``adverse`` are defined for."""


def fields(names: Iterable[str]) -> tuple[str, ...]:
    """The fields of :class:`World` that the draws of these names set."""
    return tuple(f for name in names for f in (*(f for draw in DRAWS[name] for f in draw.fields), *_winds(name)))


def absolute(names: Iterable[str]) -> dict[str, Draw]:
    """Those among them that do not depend on the scenario's value."""
    return {f: draw for name in names for draw in DRAWS[name] if not draw.relative for f in draw.fields}


def draw_world(world: World, seed: int, names: Collection[str] = USUAL) -> World:
    """``world`` as the flight of ``seed`` meets it, with the draws of ``names``.

    Always the same numbers are drawn in the same order, so that neither a figure of ``world`` nor the choice of
    ``names`` shifts another draw.
    """
    random = generator(seed, "campaign")
    values: dict[str, float | Vec3] = {}
    for name, draws in DRAWS.items():
        found: dict[str, float | Vec3] = {}
        for draw in draws:
            for field in draw.fields:
                value = float(random.uniform(draw.low, draw.high))
                found[field] = value * getattr(world, field) if draw.relative else value
        for field in _winds(name):
            found[field] = _turn(getattr(world, field), random)
        if name in names:
            values |= found
    return msgspec.structs.replace(world, **values)


def overrides(world: World, names: Iterable[str] = USUAL) -> list[str]:
    """What ``--set`` needs so that a single flight meets ``world`` to the last bit."""
    return [f"sim.{field}={_toml(getattr(world, field))}" for field in fields(names)]


def _winds(name: str) -> tuple[str, ...]:
    return WINDS if name == "wind" else ()


def _turn(v: Vec3, random: np.random.Generator) -> Vec3:
    """A vector as long as ``v``; three normal numbers point in every direction with equal density."""
    x, y, z = random.standard_normal(3).tolist()
    scale = math.hypot(*v) / math.hypot(x, y, z)
    return (scale * x, scale * y, scale * z)


def _toml(value: float | Vec3) -> str:
    return "[" + ",".join(map(repr, value)) + "]" if isinstance(value, tuple) else repr(value)
