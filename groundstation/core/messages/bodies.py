"""Where the other bodies of a pose stream are: only name, place and speed, as every vehicle sees every one. Sans-IO."""

import math
from collections import Counter, deque
from collections.abc import Iterable
from typing import NamedTuple

from groundstation.core.geometry import Vec3

BASE_S = 0.1
"""Speeds are measured over at least this time [s]."""
GAP_S = 0.5
"""Places further apart than this say nothing of the speed between them [s]."""
FAR_M = 1e6
"""Nothing is further from an origin than this; more is absurd [m]. An autopilot's may lie beyond the horizon."""
BODIES_MAX = 64
"""So many bodies are remembered that were not looked for."""


class Sight(NamedTuple):
    """One body as it was seen last."""

    time_s: float
    """When it was there, on the event loop's clock [s]."""
    position_ned: Vec3
    """[m]"""
    velocity_ned: Vec3
    """[m/s]; zero where it has not been seen for long enough."""

    def at(self, time_s: float) -> Vec3:
        """Where it is at ``time_s`` [s] if it keeps its speed."""
        dt = time_s - self.time_s
        (x, y, z), (u, v, w) = self.position_ned, self.velocity_ned
        return x + dt * u, y + dt * v, z + dt * w


class Others:
    """The bodies whose names are looked for, beside the vehicle's own; before take-off, every one."""

    def __init__(self, names: Iterable[str], own: str | None = None) -> None:
        """None of them has been seen yet. With ``own``, the vehicle's, all bodies but that one count, too."""
        self.names = tuple(names)
        """Those that are looked for."""
        self._recent: dict[str, deque[tuple[float, Vec3]]] = {name: deque() for name in self.names}
        self._own = own
        self.every = own is not None
        """Whether bodies count that nobody looks for."""
        self.dropped: Counter[str] = Counter()
        """Places that were none, by reason: not_finite, absurd."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """All that were seen or are looked for."""
        return tuple(self._recent)

    def __contains__(self, name: str) -> bool:
        """Whether ``name`` counts."""
        if not self.every or name in self.names:
            return name in self.names
        return name != self._own and (name in self._recent or len(self._recent) < BODIES_MAX)

    def see(self, name: str, time_s: float, position_ned: Vec3) -> None:
        """``name`` was at ``position_ned`` [m] at ``time_s`` [s]; what is not newer than the last is ignored."""
        recent = self._recent.setdefault(name, deque())
        x, y, z = position_ned
        if not math.isfinite(x + y + z + time_s):
            self.dropped["not_finite"] += 1
            return
        if max(abs(x), abs(y), abs(z)) > FAR_M:
            self.dropped["absurd"] += 1
            return
        if recent and not 0.0 < time_s - recent[-1][0] < GAP_S:
            if time_s <= recent[-1][0]:
                return
            recent.clear()
        recent.append((time_s, position_ned))
        while len(recent) > 2 and recent[1][0] <= time_s - BASE_S:
            recent.popleft()

    def unseen(self, since_s: float) -> tuple[str, ...]:
        """Those that have not been seen since ``since_s`` [s], or never."""
        recent = {name: self._recent[name] for name in self.names}
        return tuple(name for name, seen in recent.items() if not seen or not seen[-1][0] >= since_s)

    def seen(self, name: str) -> Sight | None:
        """``name`` as it was seen last; None where it never was."""
        recent = self._recent[name]
        if not recent:
            return None
        (then, (x, y, z)), (now, (u, v, w)) = recent[0], recent[-1]
        dt = now - then
        if dt < 0.5 * BASE_S:
            return Sight(now, (u, v, w), (0.0, 0.0, 0.0))
        return Sight(now, (u, v, w), ((u - x) / dt, (v - y) / dt, (w - z) / dt))
