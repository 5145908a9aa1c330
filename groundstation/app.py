"""The composition root: one config into a link, a source, a flight, and whoever watches it."""

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from importlib.metadata import version
from typing import Any

from groundstation.broadcast import Latest
from groundstation.config import dump
from groundstation.flight import Flight, Outcome
from groundstation.mission import State
from groundstation.pilot import Tick
from groundstation.poses import make_source
from groundstation.poses.forward import Forwarding
from groundstation.poses.gated import Gated
from groundstation.poses.port import Overheard, Pose, PoseEvent, PoseSource
from groundstation.recorded import Give, RecordedFlight, about
from groundstation.settings import Config
from groundstation.snapshot import Snapshot
from links import make_link
from links.mavlink import MavlinkLink, MavlinkLinkConfig
from links.port import CommandLink


def make_ends(config: Config, wires: Mapping[str, Any] | None = None) -> tuple[CommandLink, PoseSource]:
    """The link and the pose source that ``config`` names; nothing is opened yet.

    ``wires`` is what a simulation puts in the place of the link's hardware; see :func:`links.make_link`.

    Raises:
        ConfigError: the poses need another link.
    """
    link = make_link(config.link, thrust_max_n=config.full_thrust_n, thrust_curve=config.thrust_curve, **(wires or {}))
    return link, make_source(config.pose, link)


def make_flight(
    config: Config,
    *,
    confirm: Callable[[], Awaitable[bool]],
    on_tick: Callable[[Tick], None] | None = None,
    on_event: Callable[[str], None] | None = None,
    on_pose: Callable[[Pose], None] | None = None,
    wires: Mapping[str, Any] | None = None,
    give: Give | None = None,
    on_state: Callable[[State, str], None] | None = None,
) -> Flight:
    """The parts that ``config`` names, put together; nothing is opened yet.

    ``on_pose`` sees every pose first, also those that the gate will drop; ``give`` takes what is to be recorded.
    ``wires``: see :func:`make_ends`.

    Raises:
        ConfigError: the poses need another link.
    """
    link, source = make_ends(config, wires)
    if on_pose is not None:
        source = Overheard(source, on_pose)

    def tell(event: PoseEvent) -> None:
        flight.pose_event(event)

    source = Gated(source, config.gate, lost_s=config.flight.coast_s, tell=tell)
    if isinstance(link, MavlinkLink) and isinstance(config.link, MavlinkLinkConfig) and config.link.forward.enabled:
        source = Forwarding(source, link, config.link.forward)
    told: dict[str, Any] = {"confirm": confirm, "on_tick": on_tick, "on_event": on_event, "on_state": on_state}
    flight = (
        Flight(config, link, source, **told)
        if give is None
        else RecordedFlight(config, link, source, give=give, **told)
    )
    return flight


@asynccontextmanager
async def recorder(config: Config, say: Callable[[str], None]) -> AsyncIterator[Give | None]:
    """What records a flight in real time, in a process of its own; None where ``recording.enabled`` is false."""
    if not config.recording.enabled:
        yield None
        return
    from groundstation.recording.process import RecorderProcess

    process = RecorderProcess(config.recording, about(config), say)
    try:
        yield process.give
    finally:
        await process.close()


async def watched(flight: Flight, config: Config, say: Callable[[str], None]) -> Outcome:
    """Run ``flight`` with its status socket and telemetry; a watcher that fails is told of and left behind."""
    from groundstation.api.server import Server

    latest: Latest[Snapshot] = Latest()
    server = Server(
        config.status,
        config.vehicle.name,
        latest,
        flight,
        pid=os.getpid(),
        version=version("groundstation"),
        config_text=dump(config),
        log=say,
    )
    crew = [asyncio.create_task(_guarded("snapshots", _publish(flight, latest), say))]
    crew.append(asyncio.create_task(_guarded("status socket", server.serve(), say)))
    if config.mqtt.enabled:
        from groundstation.telemetry.mqtt import publish_forever

        crew.append(asyncio.create_task(_guarded("MQTT", publish_forever(config.mqtt, latest), say)))
    try:
        return await flight.run()
    finally:
        latest.put(flight.snapshot())
        await asyncio.sleep(0.1)  # the last word reaches whoever watches
        for task in crew:
            task.cancel()
        await asyncio.gather(*crew, return_exceptions=True)


async def _publish(flight: Flight, latest: Latest[Snapshot]) -> None:
    while True:
        latest.put(flight.snapshot())
        await asyncio.sleep(0.1)


async def _guarded(what: str, work: Awaitable[None], say: Callable[[str], None]) -> None:
    """A screen or a broker must not end a flight: say what failed and go on without it."""
    try:
        await work
    except Exception as error:  # noqa: BLE001  # whatever it is, the flight goes on
        say(f"{what} stopped: {error}")
