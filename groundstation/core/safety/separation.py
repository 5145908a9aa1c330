"""How near other vehicles may come: a distance, and how far from it both must begin to brake. Sans-IO."""

import math
from typing import Annotated, Literal, NamedTuple

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.messages import Others

AHEAD_S = 0.5
"""Longest time that the speed of another is believed to last [s]."""


class SeparationConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Other vehicles in the same room. Config section ``[separation]``; a fleet file fills in ``others`` itself."""

    others: Annotated[tuple[str, ...], msgspec.Meta(max_length=64)] = ()
    """Names of their objects in the capture system. None: nobody is kept away from."""
    distance_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 0.6
    """Least distance between the vehicles' centres [m]."""
    braking_m_s2: Annotated[float, msgspec.Meta(ge=0.1, le=20.0)] = 1.0
    """Deceleration that is counted on, of both [m/s²]; ``takeoff.transit_m_s2`` is what a hold brakes with."""
    reaction_s: Annotated[float, msgspec.Meta(ge=0.0, le=2.0)] = 0.3
    """Time that passes before both brake [s]."""
    stale_s: Annotated[float, msgspec.Meta(ge=0.05, le=5.0)] = 0.3
    """Where another has not been seen for so long, nobody knows where it is [s]: a warning."""
    unknown: Literal["warn", "hold", "land"] = "hold"
    """What follows where that lasts."""
    unknown_s: Annotated[float, msgspec.Meta(ge=0.0, le=60.0)] = 1.0
    """For how long [s]."""


class Near(NamedTuple):
    """The other vehicle that leaves least room."""

    name: str
    distance_m: float
    room_m: float
    """What is left of the distance beyond ``distance_m`` once both have braked [m]; below 0 they must brake now."""
    beneath: bool
    """Whether a landing would go down upon it."""


class Separation:
    """One vehicle's distance to the others. Times are on the event loop's clock [s]."""

    def __init__(self, config: SeparationConfig, others: Others) -> None:
        """``others`` is kept up to date by the pose source."""
        self.config = config
        self._others = others

    def unknown(self, now_s: float) -> tuple[str, ...]:
        """Those of whom nobody knows where they are."""
        return self._others.unseen(now_s - self.config.stale_s)

    def nearest(self, position: Vec3, velocity: Vec3, now_s: float) -> Near | None:
        """The one that leaves least room to a vehicle at ``position`` [m] with ``velocity`` [m/s], both NED.

        One that is too near already comes before those that only might be.
        One that is not seen for a moment goes on as it went; None where none was ever seen.
        """
        c, nearest, least = self.config, None, (True, math.inf)
        for name in self._others.names:
            sight = self._others.seen(name)
            if sight is None:
                continue
            x, y, z = sight.at(min(now_s, sight.time_s + AHEAD_S))
            away = (position[0] - x, position[1] - y, position[2] - z)
            distance = math.hypot(*away)
            room = distance - c.distance_m
            for speed in (-_along(away, distance, velocity), _along(away, distance, sight.velocity_ned)):
                if not speed <= 0.0:
                    room -= speed * c.reaction_s + 0.5 * speed * speed / c.braking_m_s2
            rank = distance >= c.distance_m, room
            if not rank >= least:
                beneath = math.hypot(away[0], away[1]) < c.distance_m and away[2] < 0.0
                nearest, least = Near(name, distance, room, beneath), rank
        return nearest


def _along(away: Vec3, distance: float, velocity: Vec3) -> float:
    """Speed along ``away`` [m/s]; all of it where two are at the same place."""
    if distance < 1e-6:
        return math.hypot(*velocity)
    return (away[0] * velocity[0] + away[1] * velocity[1] + away[2] * velocity[2]) / distance
