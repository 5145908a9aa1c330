"""Poses from Qualisys Track Manager, through Qualisys' own package qtm-rt (qualisys_codec.py has the bytes)."""

import asyncio
import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, ClassVar

import msgspec

from groundstation.core.geometry import Alignment, BodyAxes, LabAlignment, LabAxes, frames_of
from groundstation.core.messages import Others, Pose, PoseKind, PoseStatus, SourceError, notice
from groundstation.machine import cancel_task
from groundstation.pose.sources.intake import Intake
from groundstation.pose.sources.qualisys_codec import QualisysReader, body_names
from groundstation.runtime import describe_install
from links.io import beyond, parse_address
from links.text import printable

if TYPE_CHECKING:
    from groundstation.pose.sources.qualisys_connection import QtmConnection

ANSWER_S = 5.0
"""Timeout for QTM's answer [s]."""
BEAT_S = 0.1
"""A frame with more or fewer bodies than QTM has named makes us ask anew within this time [s]."""
LOOK_BEATS = 10
"""After so many beats QTM is asked in any case: one body may have taken the place of another."""
AGAIN_S = 1.0
"""Pause before a lost connection is opened anew [s]."""


class QualisysConfig(PoseKind, frozen=True, kw_only=True, tag="qualisys"):
    """Qualisys Track Manager over TCP; needs the extra ``qualisys``."""

    shows_others: ClassVar[bool] = True
    body_key: ClassVar[str] = "name"
    address_key: ClassVar[str] = "server"
    stamp_field: ClassVar[str] = "QTM's time stamp"
    stamp_unit_s: ClassVar[float] = 1e-6
    name: Annotated[
        str, msgspec.Meta(min_length=1, max_length=256, description="Name of the vehicle's 6DOF body in QTM.")
    ] = "quad"
    server: Annotated[str, msgspec.Meta(description="QTM's little-endian RT port, host:port.")] = "127.0.0.1:22223"
    world: LabAxes = "nwu"
    body: BodyAxes = "flu"
    alignment: LabAlignment = Alignment()
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0, le=1.0, description="Shortest time from the instant that QTM stamps to the arrival here [s]."
        ),
    ] = 0.015

    def __post_init__(self) -> None:
        parse_address(self.server, "server")

    @property
    def real(self) -> str | None:
        """The key by which real poses may come, and its value; None where all stays on this machine."""
        return beyond("server", self.server)

    def build(self, others: Others | None = None) -> "QualisysSource":
        """The source of this config; ``others`` are further bodies to look for."""
        return QualisysSource(self, others)


class QualisysSource:
    """Implements :class:`groundstation.core.messages.pose.PoseSource`; a connection that breaks is opened anew."""

    def __init__(self, config: QualisysConfig, others: Others | None = None) -> None:
        self._config = config
        intake = Intake(config.latency_s, frames_of(config), others=others)
        self._reader = QualisysReader(config.name, intake)
        self._deliver: Callable[[Pose], None] | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now; connection_lost and broken_stream beside the reader's reasons."""
        return self._reader.status

    @property
    def other_objects(self) -> tuple[str, ...]:
        """Names of the bodies that QTM streams: tells a misspelt name from a silent stream."""
        return self._reader.names

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Connect and ask for the stream; ``deliver`` is called on the event loop for each pose."""
        self._deliver = deliver
        try:
            connection = await self._open()
        except ModuleNotFoundError:
            raise SourceError(
                notice(
                    "package.missing",
                    what='pose.kind = "qualisys"',
                    package="qtm-rt",
                    command=describe_install("qualisys"),
                )
            ) from None
        self._task = asyncio.create_task(self._stay(connection))

    async def close(self) -> None:
        """Disconnect; no pose is delivered afterwards."""
        self._deliver = None
        task, self._task = self._task, None
        if task is not None:
            await cancel_task(task)

    async def _stay(self, connection: "QtmConnection") -> None:
        """Keep a connection until cancelled."""
        while True:
            try:
                beat = 0
                while not await _happens(connection.lost, BEAT_S):
                    beat += 1
                    if self._reader.other_bodies or beat % LOOK_BEATS == 0:
                        await self._learn_names(connection)
                self._reader.drop("connection_lost")
            finally:
                connection.close()
            connection = await self._open_again()

    async def _learn_names(self, connection: "QtmConnection") -> None:
        """Ask which bodies there are; an answer that is none leaves things as they were."""
        with contextlib.suppress(OSError, ValueError):
            self._reader.names = body_names(await connection.parameters())

    async def _open_again(self) -> "QtmConnection":
        while True:
            await asyncio.sleep(AGAIN_S)
            with contextlib.suppress(OSError):
                return await self._open()

    async def _open(self) -> "QtmConnection":
        from groundstation.pose.sources.qualisys_connection import connect

        host, port = parse_address(self._config.server)
        loop = asyncio.get_running_loop()

        def take(content: bytes) -> None:
            if self._deliver is not None:
                for pose in self._reader.read(content, loop.time()):
                    if self._deliver is not None:
                        self._deliver(pose)

        connection = await connect(host, port, ANSWER_S, self._reader.drop)
        try:
            self._reader.names = body_names(await connection.parameters())
            await connection.stream(take)
        except ValueError as error:
            connection.close()
            why = printable(str(error))
            raise SourceError(notice("qualisys.bodies", server=self._config.server, why=why)) from None
        except BaseException:
            connection.close()
            raise
        return connection


async def _happens(event: asyncio.Event, within_s: float) -> bool:
    """Whether ``event`` is set within a time [s]."""
    try:
        async with asyncio.timeout(within_s):
            return await event.wait()
    except TimeoutError:
        return False
