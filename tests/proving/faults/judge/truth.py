"""What became of the vehicle, judged by the simulated truth."""

import math
from collections.abc import Callable

from groundstation.core import Tick
from groundstation.core.geometry import Vec3, so3
from sim.world import Quadrotor

OFF_FLOOR_M = 0.02
"""Higher than this above the floor it flies [m]."""
RECENT_S = 0.1
"""A reference that was told so long ago at most still counts as the present one [s]."""


class Truth:
    """One flight. Times are on the event loop's clock [s]."""

    def __init__(self, floor_z_m: float, on_look: Callable[["Truth"], None] | None = None) -> None:
        """The floor is at ``floor_z_m`` [m, NED]; ``on_look`` sees this after each step that counts."""
        self.plant: Quadrotor
        """To be set before the first step."""
        self.struck_s = math.inf
        """From when on it counts."""
        self.off_m = 0.0
        """Farthest from the reference, or sideways from where there was none any more."""
        self.highest_m = 0.0
        """Highest above where it was struck, or above the highest point of the course since, whichever is higher."""
        self.sideways_m = 0.0
        """Farthest sideways from where it was struck, carried along as far as the course has gone since."""
        self.fastest_m_s = 0.0
        """Fastest that it moved."""
        self._floor = floor_z_m
        self._on_look = on_look
        self._over = False
        self._upright = 1.0
        self._referred_s = -math.inf
        self._from: Vec3 | None = None
        self._struck: Vec3 = (0.0, 0.0, 0.0)
        self._told: Vec3 | None = None
        """The reference when it was struck, or the first one after."""
        self._before: Vec3 = (0.0, 0.0, 0.0)
        self._course: Vec3 = (0.0, 0.0, 0.0)
        self._top = math.inf

    @property
    def tilt_deg(self) -> float:
        """Farthest that it leant."""
        return math.degrees(math.acos(max(-1.0, min(1.0, self._upright))))

    @property
    def led(self) -> bool:
        """Whether there was a course since it was struck."""
        return self._told is not None

    def strike(self, time_s: float) -> Vec3:
        """From now on it counts; where that is [m, NED]."""
        self.struck_s = time_s
        self._struck = self._course = place = self.plant.truth(time_s).position_ned
        self._top = place[2]
        self._told = self._before if time_s - self._referred_s <= RECENT_S else None
        return place

    def end(self) -> None:
        """Nothing counts any more."""
        self._over = True

    def step(self, time_s: float, position: Vec3) -> None:
        """One step of the plant."""
        if self._over or time_s < self.struck_s:
            return
        self._upright = min(self._upright, so3.third_column(self.plant.attitude)[2])
        self.fastest_m_s = max(self.fastest_m_s, math.hypot(*self.plant.velocity))
        self.highest_m = max(self.highest_m, self._top - position[2])
        self.sideways_m = max(self.sideways_m, math.dist(self._course[:2], position[:2]))
        if self._on_look is not None:
            self._on_look(self)
        if self._floor - position[2] < OFF_FLOOR_M:
            return
        if time_s - self._referred_s > RECENT_S:
            self._from = self._from or position
            self.off_m = max(self.off_m, math.dist(self._from[:2], position[:2]))

    def tick(self, tick: Tick, *, follows: bool) -> None:
        """One command; ``follows`` where there is a reference that it follows."""
        if follows:
            self.refer(tick.time_s, tick.reference.position_ned, tick.reference.velocity_ned, tick.estimate.time_s)

    def refer(self, time_s: float, position: Vec3, velocity: Vec3, at_s: float) -> None:
        """At ``time_s`` it is told to be at ``position`` with ``velocity`` at ``at_s``."""
        self._referred_s, self._from = time_s, None
        back = time_s - at_s
        x, y, z = (p + back * v for p, v in zip(position, velocity, strict=True))
        self._before = x, y, z
        if self._over or time_s < self.struck_s:
            return
        if self._told is None:
            self._told = self._before
        north, east, down = (s + p - q for s, p, q in zip(self._struck, self._before, self._told, strict=True))
        self._course = north, east, down
        self._top = min(self._top, down)
        self.off_m = max(self.off_m, math.dist(self._before, self.plant.truth(time_s).position_ned))
