"""What became of the vehicle, judged by the simulated truth."""

import math

from groundstation import so3
from groundstation.ops import Vec3
from groundstation.pilot import Tick
from sim.quadrotor import Quadrotor

OFF_FLOOR_M = 0.02
"""Higher than this above the floor it flies [m]."""


class Truth:
    """One flight. Times are on the event loop's clock [s]."""

    def __init__(self, floor_z_m: float) -> None:
        """The floor is at ``floor_z_m`` [m, NED]."""
        self.plant: Quadrotor
        """To be set before the first step."""
        self.struck_s = math.inf
        """From when on it counts."""
        self.off_m = 0.0
        """Farthest from the reference, or sideways from where there was none any more."""
        self._floor = floor_z_m
        self._upright = 1.0
        self._referred_s = -math.inf
        self._from: Vec3 | None = None

    @property
    def tilt_deg(self) -> float:
        """Farthest that it leant."""
        return math.degrees(math.acos(max(-1.0, min(1.0, self._upright))))

    def step(self, time_s: float, position: Vec3) -> None:
        """One step of the plant."""
        if time_s < self.struck_s:
            return
        self._upright = min(self._upright, so3.third_column(self.plant.attitude)[2])
        if self._floor - position[2] < OFF_FLOOR_M:
            return
        if time_s - self._referred_s > 0.1:
            self._from = self._from or position
            self.off_m = max(self.off_m, math.dist(self._from[:2], position[:2]))

    def tick(self, tick: Tick, *, follows: bool) -> None:
        """One command; ``follows`` where there is a reference that it follows."""
        if follows:
            self.refer(tick.time_s, tick.reference.position_ned, tick.reference.velocity_ned, tick.estimate.time_s)

    def refer(self, time_s: float, position: Vec3, velocity: Vec3, at_s: float) -> None:
        """At ``time_s`` it is told to be at ``position`` with ``velocity`` at ``at_s``."""
        self._referred_s, self._from = time_s, None
        if time_s >= self.struck_s:
            back = time_s - at_s
            place = tuple(p + back * v for p, v in zip(position, velocity, strict=True))
            self.off_m = max(self.off_m, math.dist(place, self.plant.truth(time_s).position_ned))
