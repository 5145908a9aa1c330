"""MAVLink pose sources: the autopilot's own estimate, and messages of a mocap bridge.

The estimate comes over the connection of the MAVLink link. A bridge's VISION_POSITION_ESTIMATE
comes to a socket of its own: the link's connection receives one autopilot only, and an autopilot
does not forward these.
"""

from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar

import msgspec

from groundstation.core.geometry import Alignment, Body, LabAlignment, World, frames_of
from groundstation.core.messages import Others, Pose, PoseKind, PoseStatus
from groundstation.pose.sources.datagram import AtAddress, DatagramSource
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.mavlink_codec import PoseDecoder, VisionReader, decoder_for
from links.mavlink import MavlinkLink
from links.mavlink.protocol import Message, RoundTrip


class MavlinkPoseConfig(PoseKind, frozen=True, kw_only=True, tag="mavlink"):
    """The autopilot's estimate: ODOMETRY from PX4, LOCAL_POSITION_NED and ATTITUDE_QUATERNION from
    ArduPilot.
    """

    by_autopilot: ClassVar[bool] = True
    shares_link: ClassVar[bool] = True
    real: ClassVar[str | None] = None  # the link has its own
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="Time from the instant that the autopilot stamps to the earliest arrival "
            "here [s].",
        ),
    ] = 0.01
    rate_hz: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=1000.0,
            description="Rate of poses to request [1/s]. PX4's estimator gives up to 124, "
            "ArduPilot's up to 250.",
        ),
    ] = 100.0


class MavlinkPoseSource:
    """Implements :class:`groundstation.core.messages.PoseSource` on the connection of a link."""

    def __init__(self, config: MavlinkPoseConfig, link: MavlinkLink) -> None:
        self._config = config
        self._connection = link.connection
        self._decoder: PoseDecoder | None = None
        self._deliver: Callable[[Pose], None] | None = None
        self._unsubscribe: Callable[[], None] | None = None
        self._trip: RoundTrip | None = None

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        if self._decoder is None:
            return PoseStatus(accepted=0, dropped={})
        return self._decoder.intake.status

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Read the link's messages from now on; it requests them as it connects."""
        self._connection.request(self._choose)
        self._deliver = deliver
        self._unsubscribe = self._connection.subscribe(self._take)

    async def close(self) -> None:
        """Stop reading; no pose is delivered afterwards."""
        self._deliver = None
        if self._unsubscribe is not None:
            self._unsubscribe()
            self._unsubscribe = None

    def _choose(self, autopilot: int) -> Mapping[str, float]:
        """Choose the messages to request from ``autopilot``, and their rates [Hz]."""
        decoder = decoder_for(autopilot, self._config.latency_s)
        if type(self._decoder) is not type(decoder):  # a new connection keeps the counts
            self._decoder = decoder
        return dict.fromkeys(decoder.messages, self._config.rate_hz)

    def _take(self, message: Message, arrival_s: float) -> None:
        if self._decoder is not None and self._deliver is not None:
            trip = self._connection.timesync.newest
            if trip is not None and trip is not self._trip:
                self._trip = trip
                self._decoder.intake.clock.apply_exchange(trip.offset_s + 0.5 * trip.rtt_s)
            pose = self._decoder.decode(message, arrival_s)
            if pose is not None:
                self._deliver(pose)


class VisionConfig(AtAddress, frozen=True, kw_only=True, tag="vision"):
    """MAVLink VISION_POSITION_ESTIMATE over UDP, as sent by bridges from motion capture to
    autopilots.
    """

    shares_link: ClassVar[bool] = True
    stamp_field: ClassVar[str] = "usec"
    stamp_unit_s: ClassVar[float] = 1e-6
    listen: Annotated[
        str,
        msgspec.Meta(description="Address that the bridge sends to, host:port of this machine."),
    ] = "127.0.0.1:14551"
    system_id: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=255)] | None,
        msgspec.Meta(
            description="MAVLink system of the bridge; without it, any sender of such messages is "
            "accepted."
        ),
    ] = None
    component_id: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=255)] | None,
        msgspec.Meta(
            description="MAVLink component of the bridge; without it, any of that system."
        ),
    ] = None
    world: Annotated[
        World,
        msgspec.Meta(description="Axes of position and angles; by the message's definition `ned`."),
    ] = "ned"
    body: Annotated[
        Body, msgspec.Meta(description="Axes of the body; by the message's definition `frd`.")
    ] = "frd"
    alignment: LabAlignment = Alignment()
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="Shortest time from the instant that the bridge stamps to the arrival "
            "here [s].",
        ),
    ] = 0.02

    def build(self, others: Others | None = None) -> DatagramSource:
        """Make the source; it shows no ``others``."""
        intake = Intake(self.latency_s, frames_of(self))
        return DatagramSource(
            "MAVLink poses", self.listen, VisionReader(intake, self.system_id, self.component_id)
        )
