"""A pose source, heard without flying: no command link is opened, so nothing that moves a vehicle can leave."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import msgspec

from groundstation.core.messages import Overheard, Pose, PoseEvent, PoseSource
from groundstation.pose import GatedSource, make_source
from groundstation.pose.sources import MavlinkPoseConfig
from groundstation.settings import Config
from links import make_link
from links.mavlink import MavlinkConnection, MavlinkLink, MavlinkLinkConfig


class Ears(msgspec.Struct, frozen=True):
    """What is open."""

    source: PoseSource
    """Behind the gate."""
    connection: MavlinkConnection | None
    """To the autopilot, where that was wanted; only what it is asked for, and our heartbeat, leave on it."""
    names: Callable[[], tuple[str, ...]]
    """The bodies that the source has, where it has told."""


@asynccontextmanager
async def ears(
    config: Config,
    deliver: Callable[[Pose], None],
    *,
    raw: Callable[[Pose], None] | None = None,
    tell: Callable[[PoseEvent], None],
    autopilot: Callable[[MavlinkConnection], None] | None = None,
) -> AsyncIterator[Ears]:
    """Listen to the poses of ``config`` for as long as the block lasts.

    ``deliver`` gets those that pass the gate, ``raw`` every one, ``tell`` what happens to them. The autopilot is
    connected to where poses come by it, or where ``autopilot`` is given: it may ask for messages before.

    Raises:
        ConfigError: the poses need another link.
        SourceError: the source can't be started.
        LinkError: the autopilot does not answer.
    """
    settings = config.link
    if isinstance(settings, MavlinkLinkConfig):  # what it sends to others is none of our business
        settings = msgspec.structs.replace(settings, quiet=False)
    link = make_link(settings, thrust_max_n=config.full_thrust_n, thrust_curve=config.thrust_curve)
    inner = make_source(config.pose, link)
    heard = inner if raw is None else Overheard(inner, raw)
    source = GatedSource(heard, config.gate, lost_s=config.flight.coast_s, tell=tell)
    connection = None
    if isinstance(link, MavlinkLink) and (autopilot is not None or isinstance(config.pose, MavlinkPoseConfig)):
        connection = link.connection
        if autopilot is not None:
            autopilot(connection)
    try:
        await source.start(deliver)
        if connection is not None:
            await connection.open()
        yield Ears(source, connection, lambda: getattr(inner, "other_objects", ()))
    finally:
        await source.close()
        if connection is not None:
            connection.close()
        await asyncio.sleep(0)  # sockets are released in the loop's next turn
