"""The two ends of a flight: the command link and the pose source that a configuration names."""

from collections.abc import Mapping
from typing import Any

from groundstation.core.messages import Others, PoseSource
from groundstation.pose import make_source
from groundstation.settings import Config
from links import make_link
from links.core import CommandLink
from links.mavlink import MavlinkLink


def make_ends(
    config: Config, wires: Mapping[str, Any] | None = None, others: Others | None = None
) -> tuple[CommandLink, PoseSource]:
    """The link and the pose source that ``config`` names; nothing is opened yet.

    ``wires`` is what a simulation puts in the place of the link's hardware; see :func:`links.make.make_link`.
    ``others`` are further bodies that the source looks for.

    Raises:
        ConfigError: the poses need another link.
    """
    link = make_link(config.link, thrust_max_n=config.full_thrust_n, thrust_curve=config.thrust_curve, **(wires or {}))
    if isinstance(link, MavlinkLink):
        link.shares_poses = config.shares_poses
    return link, make_source(config.pose, link, others)
