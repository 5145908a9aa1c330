"""Where poses come from: every kind of source, by the name that a configuration gives it (``kind = "vicon"``)."""

from groundstation.config import ConfigError
from groundstation.poses.mavlink import MavlinkPoseConfig, MavlinkPoseSource
from groundstation.poses.port import PoseSource
from groundstation.poses.tlog import TlogConfig
from groundstation.poses.vicon import ViconConfig
from links.mavlink import MavlinkLink
from links.port import CommandLink

PoseConfig = ViconConfig | MavlinkPoseConfig | TlogConfig
"""The configuration of one source; a new source adds its own here."""


def make_source(config: PoseConfig, link: CommandLink) -> PoseSource:
    """The source that ``config`` describes; the autopilot's own estimate shares the connection of ``link``.

    Raises:
        ConfigError: the link has no such connection.
    """
    if isinstance(config, MavlinkPoseConfig):
        if not isinstance(link, MavlinkLink):
            raise ConfigError("pose.kind", "'mavlink' needs link.kind = 'mavlink': no other link brings poses")
        return MavlinkPoseSource(config, link)
    return config.build()
