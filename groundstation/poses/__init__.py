"""Where poses come from: every kind of source, by the name that a configuration gives it (``kind = "vicon"``)."""

from groundstation.poses.mavlink import MavlinkPoseConfig, MavlinkPoseSource
from groundstation.poses.port import PoseSource
from groundstation.poses.tlog import TlogConfig
from groundstation.poses.vicon import ViconConfig
from links.mavlink import MavlinkLink

PoseConfig = ViconConfig | MavlinkPoseConfig | TlogConfig
"""The configuration of one source; a new source adds its own here."""


def make_source(config: PoseConfig, link: MavlinkLink) -> PoseSource:
    """The source that ``config`` describes; the autopilot's own estimate shares the connection of ``link``."""
    if isinstance(config, MavlinkPoseConfig):
        return MavlinkPoseSource(config, link)
    return config.build()
