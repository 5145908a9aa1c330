"""The composition root: one config into a link, a source, a flight, and whoever watches it."""

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from typing import Any, Protocol

from groundstation import __version__
from groundstation.api.desk import Core
from groundstation.api.register import Running
from groundstation.api.server import Server
from groundstation.broadcast import Latest
from groundstation.company import Company, body_of
from groundstation.config import dump
from groundstation.flight import Flight, Outcome
from groundstation.hold_to_run import make_hold
from groundstation.mission import State
from groundstation.pilot import Tick
from groundstation.poses import ShowsOthers, make_source
from groundstation.poses.forward import Forwarding
from groundstation.poses.gated import Gated
from groundstation.poses.others import Others
from groundstation.poses.port import Overheard, Pose, PoseEvent, PoseSource
from groundstation.quiet import Quiet
from groundstation.recorded import Give, RecordedFlight, about
from groundstation.settings import Config
from groundstation.snapshot import Snapshot
from links import make_link
from links.mavlink import MavlinkLink
from links.port import CommandLink


def make_ends(
    config: Config, wires: Mapping[str, Any] | None = None, others: Others | None = None
) -> tuple[CommandLink, PoseSource]:
    """The link and the pose source that ``config`` names; nothing is opened yet.

    ``wires`` is what a simulation puts in the place of the link's hardware; see :func:`links.make_link`. ``others`` are
    further bodies that the source looks for.

    Raises:
        ConfigError: the poses need another link.
    """
    link = make_link(config.link, thrust_max_n=config.full_thrust_n, thrust_curve=config.thrust_curve, **(wires or {}))
    if isinstance(link, MavlinkLink):
        link.shares_poses = config.shares_poses
    return link, make_source(config.pose, link, others)


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
    quiet: Quiet | None = None,
    running: Callable[[], Sequence[Running]] = tuple,
) -> Flight:
    """The parts that ``config`` names, put together; nothing is opened yet.

    ``on_pose`` sees every pose first, also those that the gate will drop; ``give`` takes what is to be recorded.
    ``wires``: see :func:`make_ends`. ``quiet`` hears of each command that left.
    ``running`` tells what else flies from this machine.

    Raises:
        ConfigError: the poses need another link.
    """
    bodies = None
    if isinstance(config.pose, ShowsOthers):
        bodies = Others(config.separation.others, own=body_of(config) if config.flight.start == "floor" else None)
    link, source = make_ends(config, wires, bodies)
    hold = make_hold(config.operator, link)
    if on_pose is not None:
        source = Overheard(source, on_pose)

    def tell(event: PoseEvent) -> None:
        flight.pose_event(event)

    source = Gated(source, config.gate, lost_s=config.flight.coast_s, tell=tell)
    if config.forwards is not None:
        assert isinstance(link, MavlinkLink), "only a MAVLink section says so"
        source = Forwarding(source, link, config.forwards)
    told: dict[str, Any] = {"confirm": confirm, "on_tick": on_tick, "on_event": on_event, "on_state": on_state}
    told |= {"others": bodies if config.separation.others else None, "quiet": quiet, "hold": hold}
    told |= {"company": Company(config, bodies, running, None if hold is None else hold.hold)}
    flight = (
        Flight(config, link, source, **told)
        if give is None
        else RecordedFlight(config, link, source, give=give, **told)
    )
    return flight


@asynccontextmanager
async def recorder(
    config: Config, say: Callable[[str], None], quiet: Quiet, keep: Callable[[], bool] = lambda: True
) -> AsyncIterator[Give | None]:
    """What records a flight in real time, in a process of its own; None where ``recording.enabled`` is false.

    Records are handed over when it is ``quiet``. ``keep`` is asked at the end whether the recording shall stay.
    """
    if not config.recording.enabled:
        yield None
        return
    from groundstation.recording.process import RecorderProcess

    process = RecorderProcess(config.recording, about(config), say, quiet)
    try:
        yield process.give
    finally:
        await process.close(keep=keep())


class Watched(Core, Protocol):
    """What clients watch and ask: a flight, or a daemon with one flight after the other."""

    def snapshot(self) -> Snapshot:
        """As it is now."""
        ...


@asynccontextmanager
async def crew(
    config: Config, core: Watched, say: Callable[[str], None], quiet: Quiet | None = None, *, needed: bool = False
) -> AsyncIterator[Server]:
    """Who watches ``core`` and asks of it: clients of the socket, and MQTT. What fails is told of and left behind.

    Snapshots are made, and sent to clients, when it is ``quiet``.

    Raises:
        ApiError: the socket can't be served, where it is ``needed``.
    """
    latest: Latest[Snapshot] = Latest()
    quiet = quiet or Quiet()
    server = Server(
        config.status,
        config.vehicle.name,
        latest,
        core,
        quiet=quiet,
        pid=os.getpid(),
        version=__version__,
        config_text=dump(config),
        log=say,
    )
    serve = asyncio.create_task(server.serve() if needed else _guarded("status socket", server.serve(), say))
    tasks: list[asyncio.Task[Any]] = [
        serve,
        asyncio.create_task(_guarded("snapshots", _publish(core, latest, quiet), say)),
    ]
    try:
        if needed:
            serving = asyncio.create_task(server.serving.wait())
            tasks.append(serving)
            await asyncio.wait({serve, serving}, return_when=asyncio.FIRST_COMPLETED)
            if serve.done():
                serve.result()
        if config.mqtt.enabled:
            from groundstation.telemetry.mqtt import publish_forever

            tasks.append(
                asyncio.create_task(_guarded("MQTT", publish_forever(config.mqtt, latest, server.desk.from_afar), say))
            )
        try:
            yield server
        finally:
            latest.put(core.snapshot())
            await asyncio.sleep(0.1)  # the last word reaches whoever watches
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def watched(flight: Flight, config: Config, say: Callable[[str], None], quiet: Quiet) -> Outcome:
    """Run ``flight`` with its crew."""
    async with crew(config, flight, say, quiet):
        return await flight.run()


async def _publish(core: Watched, latest: Latest[Snapshot], quiet: Quiet) -> None:
    while True:
        latest.put(core.snapshot())
        await asyncio.sleep(0.1)
        await quiet.moment()


async def _guarded(what: str, work: Awaitable[None], say: Callable[[str], None]) -> None:
    """A screen or a broker must not end a flight: say what failed and go on without it."""
    try:
        await work
    except Exception as error:  # noqa: BLE001  # whatever it is, the flight goes on
        say(f"{what} stopped: {error}")
