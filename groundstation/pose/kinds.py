"""Where poses come from: every kind of source, by the name that a configuration gives it (``kind = "vicon"``)."""

from groundstation.config.loader import ConfigError
from groundstation.core.messages.bodies import Others
from groundstation.core.messages.pose import PoseSource
from groundstation.pose.recorded.csv import CsvConfig
from groundstation.pose.recorded.tlog import TlogConfig
from groundstation.pose.sources.json import JsonConfig
from groundstation.pose.sources.mavlink import MavlinkPoseConfig, MavlinkPoseSource
from groundstation.pose.sources.natnet import NatNetConfig
from groundstation.pose.sources.qualisys import QualisysConfig
from groundstation.pose.sources.vicon import ViconConfig
from groundstation.pose.sources.vision import VisionConfig
from links.core.port import CommandLink
from links.mavlink.link import MavlinkLink

PoseConfig = (
    ViconConfig | NatNetConfig | QualisysConfig | MavlinkPoseConfig | VisionConfig | JsonConfig | TlogConfig | CsvConfig
)
"""The configuration of one source; a new source adds its own here."""

Recorded = TlogConfig | CsvConfig
"""The sources that play recordings: they must never fly a vehicle."""


ShowsOthers = ViconConfig | NatNetConfig | QualisysConfig | JsonConfig
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
