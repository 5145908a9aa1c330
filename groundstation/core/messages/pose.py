"""What every pose source delivers, and the port it implements."""

from collections.abc import Callable
from typing import Literal, Protocol, runtime_checkable

import msgspec

from groundstation.core.geometry import Quat, Vec3


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
    rate_hz: float = 0.0
    """Poses per second by the source's own stamps [1/s]; 0 before the second pose."""
    latency_s: float = 0.0
    """From the instant of a pose to its arrival here, averaged over some fifty poses [s]."""
    latency_max_s: float = 0.0
    """The longest of them [s]."""
    drift: float = 0.0
    """How much slower than ours, or than the rate it was told to have, the source's clock runs, as a share."""
    gaps: int = 0
    """How often poses were missing between two stamps."""
    clock_steps: int = 0
    """How often the source's clock leapt ahead."""
    clock_restarts: int = 0
    """How often it began anew."""
    late_s: float = 0.0
    """How much later than at their best poses come now, and go on to [s]; 0 where they do not."""


class PoseEvent(msgspec.Struct, frozen=True):
    """Something about the poses that the operator and the safety rules should know."""

    kind: Literal["dropping", "passed", "lost", "back", "late", "punctual", "reset", "moved"]
    """``dropping`` begins and ``passed`` ends an outbreak; ``lost``: no pose for as long as commands may rest on one,
    ``back``: there is one again; ``late``: they come later than they did, ``punctual``: no longer; ``reset``,
    ``moved``: poses are elsewhere, as the source said or did not say."""
    reason: str
    """Of an outbreak: what the pose or datagram was dropped for; else empty."""
    text: str
    """For the operator."""


class SourceError(OSError):
    """A source can't be started; the text says why, and what to look at."""


class PoseSource(Protocol):
    """Where poses come from. ``start`` and ``close`` run on the event loop; neither blocks it."""

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        ...

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Begin to listen; ``deliver`` is called on the event loop for each pose, in order of arrival.

        Raises:
            SourceError: it can't.
        """
        ...

    async def close(self) -> None:
        """Stop listening; no pose is delivered afterwards."""
        ...


@runtime_checkable
class Distrusts(Protocol):
    """Whoever goes on by our poses beside the flight, and must stop where they have been found to be wrong."""

    def distrust(self) -> None:
        """Our poses are wrong: for the rest of this flight, nothing is to rest on them."""
        ...


class Overheard:
    """A source whose poses somebody else sees too, before they are delivered."""

    def __init__(self, source: PoseSource, hear: Callable[[Pose], None]) -> None:
        """``hear`` sees every pose of ``source``."""
        self._source = source
        self._hear = hear

    @property
    def status(self) -> PoseStatus:
        """The source's."""
        return self._source.status

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Start the source."""

        def both(pose: Pose) -> None:
            self._hear(pose)
            deliver(pose)

        await self._source.start(both)

    async def close(self) -> None:
        """Close the source."""
        await self._source.close()
