"""Poses from a CSV file, or from the folder of an earlier run, played back (csv_codec.py has the columns)."""

import asyncio
import io
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import msgspec

from groundstation.core.geometry import Alignment, Body, World, frames_of
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.intake import Intake
from groundstation.pose.recorded.csv_codec import COLUMNS, Row, rows
from groundstation.pose.recorded.playback import Speed, contents, no_poses, play

IN_RUN_FOLDER = "poses.csv"
"""What a run's folder calls its poses."""


class CsvConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="csv"):
    """Recorded poses: a CSV file t,x,y,z,qw,qx,qy,qz, or the folder of a run."""

    path: str
    """The file, or the folder that ``--out`` of a run has written."""
    speed: Speed = 1.0
    """Pace: 1 as recorded, 2 twice as fast, "max" as fast as possible."""
    world: World = "ned"
    """Axes of the file's positions; a run's folder has ``ned``."""
    body: Body = "frd"
    """Axes of the body; a run's folder has ``frd``."""
    alignment: Alignment = Alignment()
    """How these axes lie against ours, beyond their names."""

    @property
    def real(self) -> None:
        """None: they were recorded, and never fly anything."""
        return None

    def build(self) -> "CsvSource":
        """The source of this config."""
        return CsvSource(self)


class CsvSource:
    """Implements :class:`groundstation.core.messages.pose.PoseSource`; falls silent where the recording ends."""

    def __init__(self, config: CsvConfig) -> None:
        """Nothing is read yet."""
        self._config = config
        self._intake = Intake(0.0, frames_of(config))
        self._deliver: Callable[[Pose], None] | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now; malformed rows beside the intake's reasons."""
        return self._intake.status

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Read the whole file, then begin to play it.

        Raises:
            SourceError: the file can't be read, or holds no poses; the text says what to look for.
        """
        recorded = self._read()
        self._deliver = deliver
        items = [(row.arrival_s, row) for row in recorded]
        self._task = asyncio.create_task(play(items, self._config.speed, self._take))

    def _read(self) -> list[Row]:
        path = Path(self._config.path)
        if path.is_dir():
            path /= IN_RUN_FOLDER
        dropped: Counter[str] = self._intake.dropped
        recorded = list(rows(io.StringIO(contents(path).decode("utf-8", "replace"), newline=None), dropped))
        if not recorded:
            raise no_poses(path, dropped, f"expected rows {COLUMNS}, the last optional")
        return recorded

    def _take(self, row: Row, arrival_s: float) -> None:
        age_s = row.arrival_s - row.t_s
        pose = self._intake.pose(row.arrival_s, arrival_s, row.position, row.attitude, age_s=age_s)
        if pose is not None and self._deliver is not None:
            self._deliver(pose)

    async def close(self) -> None:
        """Stop playing; no pose is delivered afterwards."""
        self._deliver = None
        if self._task is not None:
            self._task.cancel()
            self._task = None
