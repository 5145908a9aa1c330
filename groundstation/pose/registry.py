"""Registry of pose sources: every kind, by the name that a configuration gives it (``kind = "vicon"``)."""

from groundstation.config import ConfigError
from groundstation.core.messages import Others, PoseSource
from groundstation.pose.recorded import CsvConfig, TlogConfig
from groundstation.pose.sources import (
    JsonConfig,
    LibmotioncaptureConfig,
    MavlinkPoseConfig,
    MavlinkPoseSource,
    NatNetConfig,
    QualisysConfig,
    ViconConfig,
    VisionConfig,
)
from links.core import CommandLink
from links.mavlink import MavlinkLink

PoseConfig = (
    ViconConfig
    | NatNetConfig
    | QualisysConfig
    | LibmotioncaptureConfig
    | MavlinkPoseConfig
    | VisionConfig
    | JsonConfig
    | TlogConfig
    | CsvConfig
)
"""The configuration of one source; a new source adds its own here."""

ShowsOthers = ViconConfig | NatNetConfig | QualisysConfig | LibmotioncaptureConfig | JsonConfig
"""The sources that show other bodies too."""


def make_source(config: PoseConfig, link: CommandLink, others: Others | None = None) -> PoseSource:
    """The source that ``config`` describes; the autopilot's own estimate shares the connection of ``link``.

    ``others`` are further bodies to look for, where the source shows them.

    Raises:
        ConfigError: the link has no such connection.
    """
    if isinstance(config, MavlinkPoseConfig):
        if not isinstance(link, MavlinkLink):
            raise ConfigError("pose.kind", "'mavlink' needs link.kind = 'mavlink': no other link brings poses")
        return MavlinkPoseSource(config, link)
    if isinstance(config, ShowsOthers):
        return config.build(others)
    return config.build()
