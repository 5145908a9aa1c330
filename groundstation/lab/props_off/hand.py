"""One vehicle held armed, its motors idling, until told to let go; and one that is disarmed, whatever it was.

Thrust never leaves that is more than idling: none at all over MAVLink, where arming alone turns the motors and an
ArduPilot in GUIDED takes off by any; ``flight.idle_thrust`` over a radio. However this ends, the motors are ordered off
first, by force.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Literal

import msgspec

from groundstation.core import Pilot
from groundstation.core.messages import Pose, PoseSource, SourceError
from groundstation.pose import GatedSource
from groundstation.runtime import to_the_end
from groundstation.settings import Config
from links.core import CommandLink, LinkError
from links.mavlink.protocol import MavlinkLinkConfig

Event = Literal["arming", "armed", "silent", "lost", "disarmed", "failed", "off"]


class News(msgspec.Struct, frozen=True):
    """What has become of the vehicle."""

    event: Event
    """``arming``: from here on the motors may turn. ``armed``: they do. ``silent``: nothing leaves any more. ``lost``:
    the link is. ``disarmed``: the vehicle tells so. ``failed``: it can't go on. ``off``: the order to stop was
    acknowledged, and that is the last."""
    at_s: float
    """On the machine's monotonic clock [s]."""
    text: str = ""
    """Why."""
    pose_s: float | None = None
    """Stamp of the newest pose [s, the same clock]."""
    firmware: str = ""
    """What the autopilot runs, as it tells itself."""


Tell = Callable[[News], None]


def idle_n(config: Config) -> float:
    """The thrust that is sent [N]."""
    return 0.0 if isinstance(config.link, MavlinkLinkConfig) else config.flight.idle_thrust * config.weight_n


async def hold(config: Config, link: CommandLink, source: PoseSource, ordered: Awaitable[object], tell: Tell) -> None:
    """Arm, and hold it idling until ``ordered`` is done; then, or where it can't go on, the motors are ordered off."""
    loop = asyncio.get_running_loop()
    begun = False

    def note(news: News) -> None:
        nonlocal begun
        begun = begun or news.event == "arming"
        tell(news)

    pilot = Pilot(config.vehicle, config.controller, config.flight.coast_s, config.flight.floor_z_m)
    source = GatedSource(source, config.gate, lost_s=config.flight.coast_s, tell=lambda event: None)
    come = asyncio.Event()

    def take(pose: Pose) -> None:
        pilot.pose(pose)
        come.set()

    async def let_go() -> None:
        await asyncio.gather(end, work, return_exceptions=True)
        await _off(link, source, tell, begun=begun)

    end = asyncio.ensure_future(ordered)
    work = asyncio.ensure_future(_held(config, link, source, pilot, take, come, note))
    try:
        await asyncio.wait({end, work}, return_when=asyncio.FIRST_COMPLETED)
        if work.done():
            work.result()
    except (LinkError, SourceError, TimeoutError) as error:
        tell(News("failed", loop.time(), str(error) or f"no pose within {config.flight.pose_wait_s:g} s"))
    finally:
        for task in (end, work):
            task.cancel()
        await to_the_end(let_go())


async def disarm(link: CommandLink, source: PoseSource, tell: Tell) -> None:
    """Order the motors off, whatever somebody before has left; that one is gone."""
    try:
        await link.connect()
    except LinkError as error:
        tell(News("failed", asyncio.get_running_loop().time(), str(error)))
    finally:
        await to_the_end(_off(link, source, tell, begun=True))


async def _held(
    config: Config,
    link: CommandLink,
    source: PoseSource,
    pilot: Pilot,
    take: Callable[[Pose], None],
    come: asyncio.Event,
    tell: Tell,
) -> None:
    loop, thrust_n = asyncio.get_running_loop(), idle_n(config)
    pilot.stand()
    await source.start(take)
    await link.connect()
    await asyncio.wait_for(come.wait(), config.flight.pose_wait_s)
    await link.examine()
    if link.status.unfit:
        raise LinkError(link.status.unfit)
    if link.status.state == "armed":
        raise LinkError("its motors are on already: somebody else has armed it")
    tell(News("arming", loop.time()))
    await link.arm(lambda: pilot.idle(loop.time(), thrust_n))
    tell(News("armed", loop.time(), firmware=link.status.firmware))
    told: set[Event] = set()
    while True:  # also after the link has fallen silent: poses that come back must not start the motors again
        now = loop.time()
        link.send(pilot.idle(now, thrust_n))
        for event in _seen(config, link):
            if event not in told:
                told.add(event)
                newest = pilot.newest_pose
                tell(News(event, now, link.status.text, None if newest is None else newest.time_s))
        await asyncio.sleep(link.period_s)


def _seen(config: Config, link: CommandLink) -> list[Event]:
    status = link.status
    seen: list[Event] = []
    if status.state == "lost":
        seen.append("lost")
    if isinstance(config.link, MavlinkLinkConfig) and status.state == "connected":  # no radio tells
        seen.append("disarmed")
    if status.phase == "over":
        seen.append("silent")
    return seen


async def _off(link: CommandLink, source: PoseSource, tell: Tell, *, begun: bool) -> None:
    """Order the motors off where we may have started them (``begun``), and close both ends."""
    loop = asyncio.get_running_loop()
    was = link.status.state
    try:
        if begun and was not in ("closed", "connecting"):
            await link.kill()
            tell(News("off", loop.time(), was))
    except LinkError as error:
        tell(News("failed", loop.time(), str(error)))
    finally:
        await link.close()
        await source.close()
