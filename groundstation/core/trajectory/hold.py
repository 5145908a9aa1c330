"""Hold: stay at one point."""

import math

import msgspec

from groundstation.core.geometry import Vec3
from groundstation.core.trajectory.port import Degrees, Point, Reference


class HoldConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="hold"):
    """A point to stay at."""

    position_ned: Point = (0.0, 0.0, -1.0)
    """The point [m], world NED; 1 m up is -1 in the third place."""
    yaw_deg: Degrees = 0.0
    """Heading [deg], from north towards east."""

    def build(self) -> "Hold":
        """The trajectory of this config."""
        return Hold(self.position_ned, math.radians(self.yaw_deg))


class Hold:
    """One reference for all time. See the port for ``at`` and ``position_at``."""

    __slots__ = ("_reference",)

    duration_s: float | None = None
    """It never ends."""
    joints_s = (0.0,)
    """Nothing ever happens."""

    def __init__(self, position_ned: Vec3, yaw_rad: float) -> None:
        self._reference = Reference(position_ned, yaw_rad=yaw_rad)

    def position_at(self, time_s: float) -> Vec3:
        """The point [m], world NED."""
        return self._reference.position_ned

    def at(self, time_s: float) -> Reference:
        """The reference at rest."""
        return self._reference
