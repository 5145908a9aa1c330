"""Registry of pose sources: every kind by its name in a configuration (``kind = "vicon"``), and the recorded one.

A CSV file, or the folder of an earlier run, is read whole and played back at the pace of the recording
(recorded_codec.py has the form of the file).
"""

import asyncio
import io
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, ClassVar

import msgspec

from groundstation.config import ConfigError
from groundstation.core.geometry import Alignment, Body, LabAlignment, World, frames_of
from groundstation.core.messages import Others, Pose, PoseKind, PoseSource, PoseStatus, SourceError, notice
from groundstation.machine import sleep_until
from groundstation.pose.recorded_codec import CSV_COLUMNS, CsvRow, TlogRecord, read_csv
from groundstation.pose.sources import (
    Intake,
    JsonConfig,
    LibmotioncaptureConfig,
    MavlinkPoseConfig,
    MavlinkPoseSource,
    NatNetConfig,
    PoseDecoder,
    QualisysConfig,
    ViconConfig,
    VisionConfig,
    decoder_for,
)
from links.core import CommandLink
from links.mavlink import MavlinkLink
from links.mavlink.protocol import ARDUPILOT, PX4

_MCAP = b"\x89MCAP0\r\n"
"""First bytes of a recording of our own."""
IN_RUN_FOLDER = "poses.csv"
"""Name of the file of poses in a run's folder."""


class CsvConfig(PoseKind, frozen=True, kw_only=True, tag="csv"):
    """Recorded poses: a CSV file t,x,y,z,qw,qx,qy,qz, or the folder of a run."""

    recorded: ClassVar[bool] = True
    real: ClassVar[str | None] = None
    path: Annotated[str, msgspec.Meta(description="The file, or the folder that `--out` of a run has written.")]
    world: Annotated[World, msgspec.Meta(description="Axes of the file's positions; a run's folder has `ned`.")] = "ned"
    body: Annotated[Body, msgspec.Meta(description="Axes of the body; a run's folder has `frd`.")] = "frd"
    alignment: LabAlignment = Alignment()

    def build(self, others: Others | None = None) -> "CsvSource":
        """Make the source; it shows no ``others``."""
        return CsvSource(self)


class CsvSource:
    """Implements :class:`groundstation.core.messages.pose.PoseSource` on a CSV file."""

    def __init__(self, config: CsvConfig) -> None:
        self._config = config
        self._intake = Intake(0.0, frames_of(config))
        self._task: asyncio.Task[None] | None = None

    @property
    def status(self) -> PoseStatus:
        """Present counters; reasons for drops beside the intake's: malformed."""
        return self._intake.status

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Read the whole file, then begin to play it."""
        self._task = asyncio.create_task(self._play(self._read(), deliver))

    async def close(self) -> None:
        """Stop playing; no pose is delivered afterwards."""
        if self._task is not None:
            self._task.cancel()

    def _read(self) -> list[CsvRow]:
        path = Path(self._config.path)
        if path.is_dir():
            path /= IN_RUN_FOLDER
        try:
            data = path.read_bytes()
        except (OSError, ValueError) as error:  # ValueError: the path has a NUL
            why = getattr(error, "strerror", None) or error
            raise SourceError(notice("pose.path_unreadable", path=path, why=why)) from None
        if data.startswith(_MCAP):
            raise SourceError(notice("pose.path_of_flight", path=path))
        dropped = self._intake.dropped
        rows = list(read_csv(io.StringIO(data.decode("utf-8", "replace"), newline=None), dropped))
        if not rows:
            found = ", ".join(f"{count} {reason}" for reason, count in sorted(dropped.items())) or "nothing at all"
            expected = f"expected rows {CSV_COLUMNS}, the last optional"
            raise SourceError(notice("pose.path_empty", path=path, found=found, expected=expected))
        return rows

    async def _play(self, rows: list[CsvRow], deliver: Callable[[Pose], None]) -> None:
        ahead_s = asyncio.get_running_loop().time() - rows[0].arrival_s
        for row in rows:
            arrival_s = row.arrival_s + ahead_s
            await sleep_until(arrival_s)
            age_s = row.arrival_s - row.t_s
            pose = self._intake.pose(row.arrival_s, arrival_s, row.position, row.attitude, age_s=age_s)
            if pose is not None:
                deliver(pose)


def pose_decoder(records: list[TlogRecord], latency_s: float) -> PoseDecoder | None:
    """Return the decoder for ``records`` of one vehicle, of ODOMETRY if they have it; None without pose messages."""
    names = {record.message.get_type() for record in records}
    for autopilot in (PX4, ARDUPILOT):
        decoder = decoder_for(autopilot, latency_s, recorded=True)
        if names.issuperset(decoder.messages):
            return decoder
    return None


PoseConfig = (
    ViconConfig
    | NatNetConfig
    | QualisysConfig
    | LibmotioncaptureConfig
    | MavlinkPoseConfig
    | VisionConfig
    | JsonConfig
    | CsvConfig
)
"""Configuration of one source; a new source adds its own here."""


def make_source(config: PoseConfig, link: CommandLink, others: Others | None = None) -> PoseSource:
    """Make the source that ``config`` describes; the autopilot's own estimate shares the connection of ``link``.

    ``others`` are further bodies to look for, if the source shows them.

    Raises:
        ConfigError: the link has no such connection.
    """
    if isinstance(config, MavlinkPoseConfig):
        if not isinstance(link, MavlinkLink):
            raise ConfigError("pose.kind", "'mavlink' needs link.kind = 'mavlink': no other link brings poses")
        return MavlinkPoseSource(config, link)
    return config.build(others)
