"""Poses that a bridge sends as MAVLink VISION_POSITION_ESTIMATE, to a socket of their own.

Not on the link's connection: that hears one autopilot only, and an autopilot does not send these on.
"""

from typing import Annotated

import msgspec

from groundstation.core.geometry import Alignment, Body, World, frames_of
from groundstation.pose.intake import DatagramSource, Intake
from groundstation.pose.sources.vision_codec import VisionReader
from links.io import beyond, parse_address


class VisionConfig(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="vision"
):
    """MAVLink VISION_POSITION_ESTIMATE over UDP, as sent by bridges from motion capture to autopilots."""

    listen: str = "127.0.0.1:14551"
    """Address that the bridge sends to, host:port of this machine."""
    system_id: Annotated[int, msgspec.Meta(ge=1, le=255)] | None = None
    """MAVLink system of the bridge; without it, whoever sends such messages is believed."""
    world: World = "ned"
    """Axes of position and angles; by the message's definition ``ned``."""
    body: Body = "frd"
    """Axes of the body; by the message's definition ``frd``."""
    alignment: Alignment = Alignment()
    """How these axes lie against ours, beyond their names."""
    latency_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.02
    """Shortest time from the instant that the bridge stamps to the arrival here [s]."""

    def __post_init__(self) -> None:
        """Check what the types cannot.

        Raises:
            ValueError: ``listen`` is no address.
        """
        parse_address(self.listen)

    @property
    def real(self) -> str | None:
        """The key by which real poses may come, and its value; None where all stays on this machine."""
        return beyond("listen", self.listen)

    def build(self) -> DatagramSource:
        """The source of this config."""
        intake = Intake(self.latency_s, frames_of(self))
        return DatagramSource("MAVLink poses", self.listen, VisionReader(intake, self.system_id))
