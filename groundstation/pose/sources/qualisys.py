"""Poses from Qualisys Track Manager by its package qtm-rt (bytes: qualisys_codec.py)."""

import asyncio
import contextlib
import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, ClassVar

import msgspec

from groundstation.core.geometry import Alignment, BodyAxes, LabAlignment, LabAxes, frames_of
from groundstation.core.messages import Others, Pose, SourceError, notice
from groundstation.machine import cancel_task, wait_at_most
from groundstation.pose.sources.datagram import AtAddress
from groundstation.pose.sources.intake import ANSWER_S, Intake, ReaderSource
from groundstation.pose.sources.qualisys_codec import QualisysReader, body_names
from groundstation.runtime import describe_install
from links.core import REOPEN_S
from links.io import parse_address
from links.text import printable

if TYPE_CHECKING:
    from groundstation.pose.sources.qualisys_connection import QtmConnection

BEAT_S = 0.1
"""Period at which the number of streamed bodies is compared with the names [s]."""
LOOK_BEATS = 10
"""Periods between questions for names [-]: one body may have replaced another."""


class QualisysConfig(AtAddress, frozen=True, kw_only=True, tag="qualisys"):
    """Qualisys Track Manager over TCP; needs the extra ``qualisys``."""

    shows_others: ClassVar[bool] = True
    body_key: ClassVar[str] = "name"
    address_key: ClassVar[str] = "server"
    stamp_field: ClassVar[str] = "QTM's time stamp"
    stamp_unit_s: ClassVar[float] = 1e-6
    name: Annotated[
        str,
        msgspec.Meta(
            min_length=1, max_length=256, description="Name of the vehicle's 6DOF body in QTM."
        ),
    ] = "quad"
    server: Annotated[str, msgspec.Meta(description="QTM's little-endian RT port, host:port.")] = (
        "127.0.0.1:22223"
    )
    world: LabAxes = "nwu"
    body: BodyAxes = "flu"
    alignment: LabAlignment = Alignment()
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="Shortest time from the instant that QTM stamps to the arrival here [s].",
        ),
    ] = 0.015

    def build(self, others: Others | None = None) -> "QualisysSource":
        """The source of this config; ``others`` are further bodies to look for."""
        return QualisysSource(self, others)


class QualisysSource(ReaderSource):
    """Implements :class:`groundstation.core.messages.pose.PoseSource`.

    A lost connection is reopened.
    """

    _reader: QualisysReader

    def __init__(self, config: QualisysConfig, others: Others | None = None) -> None:
        super().__init__(
            QualisysReader(config.name, Intake(config.latency_s, frames_of(config), others=others))
        )
        self._config = config
        self._task: asyncio.Task[None] | None = None

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Connect and ask for the stream; ``deliver`` is called on the event loop for each pose."""
        self._begin(deliver, asyncio.get_running_loop().time)
        try:
            connection = await self._open()
        except ModuleNotFoundError:
            raise SourceError(
                notice(
                    "package.missing",
                    kind="qualisys",
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
                for beat in itertools.count(1):
                    await wait_at_most(connection.lost.wait(), BEAT_S)
                    if connection.lost.is_set():
                        break
                    if self._reader.other_bodies or beat % LOOK_BEATS == 0:
                        with contextlib.suppress(OSError, ValueError):  # the old names are kept
                            self._reader.names = body_names(await connection.parameters())
                self._reader.intake.drop("connection_lost")
            finally:
                connection.close()
            connection = await self._open_again()

    async def _open_again(self) -> "QtmConnection":
        while True:
            await asyncio.sleep(REOPEN_S)
            with contextlib.suppress(OSError):
                return await self._open()

    async def _open(self) -> "QtmConnection":
        from groundstation.pose.sources.qualisys_connection import connect

        host, port = parse_address(self._config.server)
        connection = await connect(host, port, ANSWER_S, self._reader.intake.drop)
        try:
            self._reader.names = body_names(await connection.parameters())
            await connection.stream(self._take)
        except BaseException as error:
            connection.close()
            if isinstance(error, ValueError):
                why = printable(str(error))
                raise SourceError(
                    notice("qualisys.bodies", server=self._config.server, why=why)
                ) from None
            raise
        return connection
