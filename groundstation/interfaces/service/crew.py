"""Who watches a flight and asks of it: clients of the socket, and MQTT. A flight ends with none of them."""

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any, Protocol

from groundstation.config import dump
from groundstation.core.messages import Snapshot
from groundstation.flight import Flight, Outcome
from groundstation.interfaces.api import Core, Server
from groundstation.runtime import Latest, Quiet, __version__
from groundstation.settings import Config


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
            from groundstation.interfaces.mqtt import publish_forever

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
