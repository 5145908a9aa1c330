"""What every pose source delivers, and the port it implements."""

from collections.abc import Callable
from typing import Protocol

import msgspec

from groundstation.ops import Quat, Vec3


class Pose(msgspec.Struct, frozen=True, gc=False):
    """One pose of the vehicle as its source measured it, in our frames and on our clock."""

    id: int
    """Running number of accepted poses of this source, from 0."""
    time_s: float
    """When the pose was true, on the event loop's clock [s]."""
    arrival_s: float
    """When its bytes reached us, on the event loop's clock [s]."""
    position_ned: Vec3
    """Position [m], world NED."""
    attitude: Quat
    """Unit quaternion w, x, y, z, body FRD to world NED."""
    velocity_ned: Vec3 | None = None
    """The source's own velocity [m/s], world NED, where it sends one."""
    reset_count: int = 0
    """Changes whenever the source moved its own origin or attitude (MAVLink reset_counter)."""


class PoseStatus(msgspec.Struct, frozen=True):
    """What a source can tell about itself, for screens and telemetry."""

    accepted: int
    """Poses delivered."""
    dropped: dict[str, int]
    """Datagrams or records dropped, counted by reason."""


class PoseSource(Protocol):
    """Where poses come from. ``start`` and ``close`` run on the event loop; neither blocks it."""

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        ...

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Begin to listen; ``deliver`` is called on the event loop for each pose, in order of arrival."""
        ...

    async def close(self) -> None:
        """Stop listening; no pose is delivered afterwards."""
        ...
