"""Registry of pose sources: every kind by its name in a configuration (``kind = "vicon"``)."""

from groundstation.config import ConfigError
from groundstation.core.messages import Others, PoseSource, notice
from groundstation.pose.recorded_codec import TlogRecord
from groundstation.pose.sources import (
    JsonConfig,
    LibmotioncaptureConfig,
    MavlinkPoseConfig,
    MavlinkPoseSource,
    NatNetConfig,
    PoseDecoder,
    QualisysConfig,
    ViconConfig,
    VisionConfig,
    decoder_for,
)
from links.core import CommandLink
from links.mavlink import MavlinkLink
from links.mavlink.protocol import ARDUPILOT, PX4


def pose_decoder(records: list[TlogRecord], latency_s: float) -> PoseDecoder | None:
    """Return the decoder for ``records`` of one vehicle, of ODOMETRY if they have it.

    None without pose messages.
    """
    names = {record.message.get_type() for record in records}
    for autopilot in (PX4, ARDUPILOT):
        decoder = decoder_for(autopilot, latency_s, recorded=True)
        if names.issuperset(decoder.messages):
            return decoder
    return None


PoseConfig = (
    ViconConfig
    | NatNetConfig
    | QualisysConfig
    | LibmotioncaptureConfig
    | MavlinkPoseConfig
    | VisionConfig
    | JsonConfig
)
"""Configuration of one source; a new source adds its own here."""


def make_source(config: PoseConfig, link: CommandLink, others: Others | None = None) -> PoseSource:
    """Make the source that ``config`` describes.

    The autopilot's own estimate shares the connection of ``link``.

    ``others`` are further bodies to look for, if the source shows them.

    Raises:
        ConfigError: the link has no such connection.
    """
    if isinstance(config, MavlinkPoseConfig):
        if not isinstance(link, MavlinkLink):
            raise ConfigError("pose.kind", notice("pose.no_link"))
        return MavlinkPoseSource(config, link)
    return config.build(others)
