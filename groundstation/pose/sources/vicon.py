"""Poses from a Vicon system: listens for the UDP Object Stream (vicon_codec.py has the bytes)."""

from typing import Annotated, ClassVar

import msgspec

from groundstation.core.geometry import Alignment, Body, LabAlignment, LabAxes, frames_of
from groundstation.core.messages import Others
from groundstation.pose.sources.datagram import AtAddress, DatagramSource
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.vicon_codec import ViconReader, name_bytes


class ViconConfig(AtAddress, frozen=True, kw_only=True, tag="vicon"):
    """Vicon Tracker's UDP Object Stream, which carries no time stamps and no validity flags."""

    shows_others: ClassVar[bool] = True
    is_relayed: ClassVar[bool] = True
    body_key: ClassVar[str] = "object"
    object: Annotated[str, msgspec.Meta(description="Name of the vehicle's object in Tracker.")] = (
        "quad"
    )
    listen: Annotated[
        str, msgspec.Meta(description="Address that Tracker sends to, host:port of this machine.")
    ] = "127.0.0.1:51001"
    world: LabAxes = "nwu"
    body: Annotated[
        Body, msgspec.Meta(description="Axes of the object: `flu` is x forward, y left, z up.")
    ] = "flu"
    alignment: LabAlignment = Alignment()
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="Shortest time from the cameras' exposure to the arrival here [s]; the "
            "datagram does not state it. A frame later than its number implies "
            "counts as that much older.",
        ),
    ] = 0.02
    rate_hz: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=1000.0,
            description="Frames per second that the cameras take [1/s]; where it is wrong, the "
            "true rate is found within three seconds.",
        ),
    ] = 50.0
    drop_frozen: Annotated[
        bool,
        msgspec.Meta(
            description="Drop a pose that equals the one before to the last bit: nothing was "
            "measured, as when the object is hidden. Only a simulation without noise "
            "turns this off."
        ),
    ] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        name_bytes(self.object)

    def build(self, others: Others | None = None) -> DatagramSource:
        """Make the source; ``others`` are further bodies to look for."""
        intake = Intake(self.latency_s, frames_of(self), frame_s=1.0 / self.rate_hz, others=others)
        return DatagramSource(
            "Vicon poses",
            self.listen,
            ViconReader(self.object, intake, drop_frozen=self.drop_frozen),
        )
