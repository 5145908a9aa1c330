"""Where poses come from: every kind of source, by the name that a configuration gives it (``kind = "vicon"``)."""

from groundstation.poses.port import PoseSource
from groundstation.poses.vicon import ViconConfig
from links.mavlink import MavlinkLink

PoseConfig = ViconConfig


def make_source(config: PoseConfig, link: MavlinkLink) -> PoseSource:
    """The source that ``config`` describes; sources that share the autopilot's connection take ``link``."""
    return config.build()
