"""The attitude estimator on board of a simulated vehicle: gyros, held upright by accelerometers. Sans-IO.

What real ones are seen to do: between two corrections the estimate turns as the body does, to a hundredth of a degree;
it is off by a few tenths of a degree, which wander over many seconds; and one that knows no accelerations takes a part
of a lean that lasts for level, as a leaning multirotor's accelerometers show no lean while it accelerates freely.
"""

import math
from collections.abc import Iterator

from groundstation.core.geometry import Quat, Vec3, so3
from sim.world.quadrotor import TrueState

LOOP_S = 0.004
"""What is told is that of the newest turn of its loop [s]."""
WANDER_RAD, WANDER_S = math.radians(0.5), 10.0
"""How far it is off on each axis (1σ) [rad], and over how long that wanders [s]."""
UPRIGHT_PER_S = 0.1
"""How fast accelerometers pull it upright: a share of what they show to be wrong [1/s]."""
LONGEST_S = 0.1
"""What happened between two questions further apart is not taken for one acceleration [s]."""


class Horizon:
    """One vehicle's estimator."""

    def __init__(self, normals: Iterator[list[float]], gravity: float) -> None:
        """``normals`` gives rows of three standard normal numbers; ``gravity`` is in m/s²."""
        self._normals = normals
        self._gravity = gravity
        self._truth: TrueState | None = None
        self._wander: Vec3 = _scale(WANDER_RAD, next(normals))
        self._pulled = (0.0, 0.0)

    def feel(self, truth: TrueState) -> tuple[Quat, Vec3]:
        """Attitude and body rates [rad/s] as estimated, while ``truth`` is so; never earlier than before."""
        last, self._truth = self._truth, truth
        if last is not None and truth.time_s > last.time_s:
            self._go_on(last, truth, truth.time_s - last.time_s)
        age = math.fmod(truth.time_s, LOOP_S)
        rates = truth.rates_rad_s
        (a, b, c), (p, q, r), (north, east) = self._wander, rates, self._pulled
        attitude = so3.rotate(truth.attitude, (a - age * p, b - age * q, c - age * r))
        # Who accelerates north leans nose down, about west; so pulled upright is about east.
        return so3.multiply(so3.rotate(so3.IDENTITY, (-east, north, 0.0)), attitude), rates

    def _go_on(self, last: TrueState, truth: TrueState, since: float) -> None:
        """Wander and be pulled for ``since`` [s]."""
        keep = math.exp(-since / WANDER_S)
        a, b, c = self._wander
        x, y, z = _scale(WANDER_RAD * math.sqrt(1.0 - keep * keep), next(self._normals))
        self._wander = (keep * a + x, keep * b + y, keep * c + z)
        (u, v, _), (u0, v0, _) = truth.velocity_ned, last.velocity_ned
        free = since <= LONGEST_S and not truth.on_ground
        north, east = ((u - u0) / (since * self._gravity), (v - v0) / (since * self._gravity)) if free else (0.0, 0.0)
        pull = 1.0 - math.exp(-since * UPRIGHT_PER_S)
        a, b = self._pulled
        self._pulled = (a + pull * (north - a), b + pull * (east - b))


def _scale(by: float, row: list[float]) -> Vec3:
    x, y, z = row
    return by * x, by * y, by * z
