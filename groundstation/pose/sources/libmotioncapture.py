"""Poses by libmotioncapture's back ends (VRPN, Vicon DataStream ...), from a watched child.

Its calls never return without an answer of the server, and it gives no stamps: so it runs in a
process of its own, which is restarted whenever it ends or falls silent, and each frame is stamped
as the library hands it over.
"""

import asyncio
import contextlib
import json
import os
from collections.abc import Callable
from importlib.util import find_spec
from typing import Annotated, ClassVar, Literal

import msgspec

from groundstation.core.geometry import Alignment, BodyAxes, LabAlignment, LabAxes, frames_of
from groundstation.core.messages import Others, Pose, PoseKind, Sentence, SourceError, notice
from groundstation.machine import cancel_task
from groundstation.pose.sources.intake import ANSWER_S, Intake, ReaderSource
from groundstation.pose.sources.json_codec import MAX_NAME, JsonReader
from groundstation.runtime import describe_install
from links.core import NEWS_S, REOPEN_S
from links.io import is_loopback, open_child


class LibmotioncaptureConfig(PoseKind, frozen=True, kw_only=True, tag="libmotioncapture"):
    """VRPN, Vicon DataStream and others; needs the extra ``motioncapture``."""

    shows_others: ClassVar[bool] = True
    body_key: ClassVar[str] = "name"
    backend: Annotated[
        Literal["vrpn", "vicon", "optitrack", "qualisys", "mock"],
        msgspec.Meta(
            description="What it speaks; `vicon` is the DataStream (TCP 801). `mock` makes bodies "
            "up, and never flies a vehicle."
        ),
    ] = "vrpn"
    hostname: Annotated[
        str, msgspec.Meta(min_length=1, description="Name or address of the tracking computer.")
    ] = "127.0.0.1"
    options: Annotated[
        dict[str, str],
        msgspec.Meta(
            description="Further parameters of the back end, by libmotioncapture's own names, such "
            "as `frequency` of `mock`."
        ),
    ] = msgspec.field(default_factory=dict)
    name: Annotated[
        str,
        msgspec.Meta(min_length=1, max_length=MAX_NAME, description="Name of the vehicle's body."),
    ] = "quad"
    world: LabAxes = "nwu"
    body: BodyAxes = "flu"
    alignment: LabAlignment = Alignment()
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="From the cameras' exposure until the library hands the frame over [s]: "
            "it is not reported, and a frame that is delayed before counts as new.",
        ),
    ] = 0.02

    @property
    def real(self) -> str | None:
        """The key by which real poses may come, and its value.

        None where all stays on this machine.
        """
        made_up = self.backend == "mock"
        return None if made_up or is_loopback(self.hostname) else f"hostname = {self.hostname}"

    @property
    def never_flies(self) -> tuple[str, Sentence] | None:
        """Refusal of made-up bodies."""
        if self.backend == "mock":
            return "pose.backend", notice("pose.made_up")
        return None

    @property
    def stream(self) -> tuple[object, ...]:
        """Key of the camera stream, equal for all vehicles that it shows."""
        return (self.kind, self.backend, self.hostname)

    def build(self, others: Others | None = None) -> "LibmotioncaptureSource":
        """The source of this config; ``others`` are further bodies to look for."""
        return LibmotioncaptureSource(self, others)


class LibmotioncaptureSource(ReaderSource):
    """Implements :class:`groundstation.core.messages.pose.PoseSource`.

    A child that ends is started again.

    Reason for drops beside those of JSON: child_lost.
    """

    def __init__(self, config: LibmotioncaptureConfig, others: Others | None = None) -> None:
        intake = Intake(config.latency_s, frames_of(config), others=others)
        super().__init__(JsonReader(config.name, intake, intake))
        self._config = config
        self._names = (config.name, *(others.names if others is not None else ()))
        self._task: asyncio.Task[None] | None = None
        self._child: asyncio.subprocess.Process | None = None

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Start the child; ``deliver`` is called on the event loop for each pose."""
        if find_spec("motioncapture") is None:
            raise SourceError(
                notice(
                    "package.missing",
                    kind="libmotioncapture",
                    package="motioncapture",
                    command=describe_install("motioncapture"),
                )
            )
        self._begin(deliver, asyncio.get_running_loop().time)
        if not await self._open():
            await self._end()
            config = self._config
            raise SourceError(
                notice("libmotioncapture.silent", backend=config.backend, hostname=config.hostname)
            )
        self._task = asyncio.create_task(self._stay())

    async def close(self) -> None:
        """End the child; no pose is delivered afterwards."""
        self._deliver = None
        task, self._task = self._task, None
        try:
            if task is not None:
                await cancel_task(task)
        finally:
            await self._end()

    async def _open(self) -> bool:
        """Start the child; return whether it connects in time."""
        config = self._config
        options = json.dumps({"hostname": config.hostname, **config.options})
        words = (str(os.getpid()), config.backend, options, json.dumps(self._names))
        module = "groundstation.pose.sources.motioncapture_child"
        self._child = await open_child(module, *words, stderr=asyncio.subprocess.DEVNULL)
        return bool(await self._line(ANSWER_S))

    async def _line(self, within_s: float) -> bytes:
        """Return the child's next line; empty if it has ended, or is silent for a time [s]."""
        assert self._child is not None and self._child.stdout is not None, "it runs, with a pipe"
        try:
            async with asyncio.timeout(within_s):
                return await self._child.stdout.readline()
        except (TimeoutError, ValueError):  # ValueError: longer than any line of ours
            return b""

    async def _end(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            with contextlib.suppress(ProcessLookupError):
                child.kill()
            await child.wait()

    async def _stay(self) -> None:
        """Deliver the child's poses, and start it again after ``NEWS_S`` of silence, until
        cancelled.
        """
        while True:
            while line := await self._line(NEWS_S):
                self._take(line.strip())
            opened = False
            while not opened:
                self._reader.intake.drop("child_lost")
                await self._end()
                await asyncio.sleep(REOPEN_S)
                opened = await self._open()
