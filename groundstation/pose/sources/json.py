"""Poses from a home-made tracker that sends JSON (json_codec.py has the schema)."""

from typing import Annotated

import msgspec

from groundstation.core.geometry import Alignment, Body, World, frames_of
from groundstation.core.messages import Others
from groundstation.pose.sources.datagram import DatagramSource
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.json_codec import MAX_NAME, JsonReader
from links.io import beyond, parse_address


class JsonConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="json"):
    """JSON objects over UDP, one or an array of them a datagram."""

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=MAX_NAME)] = "quad"
    """Name of the vehicle's body."""
    listen: str = "127.0.0.1:51002"
    """Address that the tracker sends to, host:port of this machine."""
    world: World = "nwu"
    """Axes of the lab frame; ``nwu`` is the usual z-up frame, its x axis taken as north."""
    body: Body = "flu"
    """Axes of the body: ``flu`` is x forward, y left, z up."""
    alignment: Alignment = Alignment()
    """How these axes lie against ours, beyond their names."""
    latency_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.02
    """Shortest time from the instant that the tracker stamps to the arrival here [s]."""
    rate_hz: Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] = 50.0
    """Frames per second [1/s], for a tracker that numbers its frames and has no clock; found by itself if wrong."""

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

    def build(self, others: Others | None = None) -> DatagramSource:
        """The source of this config; ``others`` are further bodies to look for."""
        intake, frames = (
            Intake(self.latency_s, frames_of(self), frame_s=seconds, others=others)
            for seconds in (1.0, 1.0 / self.rate_hz)
        )
        return DatagramSource("JSON poses", self.listen, JsonReader(self.name, intake, frames))
