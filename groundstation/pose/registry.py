"""Registry of pose sources: every kind by its name in a configuration (``kind = "vicon"``), and the recorded ones.

A CSV file, the folder of an earlier run, or a .tlog is read whole and played back: as it was recorded, faster or
slower, or as fast as it can be taken (recorded_codec.py has the forms of the files).
"""

import asyncio
import io
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeAlias, TypeVar

import msgspec

from groundstation.config import ConfigError
from groundstation.core.geometry import Alignment, Body, LabAlignment, World, frames_of
from groundstation.core.messages import Others, Pose, PoseKind, PoseSource, PoseStatus, Sentence, SourceError, notice
from groundstation.machine import sleep_until
from groundstation.pose.recorded_codec import (
    CSV_COLUMNS,
    CsvRow,
    Sender,
    TlogReader,
    TlogRecord,
    describe_senders,
    find_autopilots,
    read_csv,
)
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

T = TypeVar("T")

Speed: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0, le=1000.0)] | Literal["max"]
"""1 is the pace of the recording, 2 twice as fast; ``max`` waits for nothing."""
BREATH = 100
"""At full speed, others on the event loop get a turn after so many."""


async def play(items: Iterable[tuple[float, T]], speed: Speed, take: Callable[[T, float], None]) -> None:
    """Call ``take(item, when_s)`` for each (recorded time [s], item), in order.

    ``when_s`` is the item's time on the event loop's clock at the pace of the recording [s], whatever the speed: so
    speeds and rates come out as they were; played faster, items come before their time.
    """
    begun_s = asyncio.get_running_loop().time()
    first_s: float | None = None
    for count, (time_s, item) in enumerate(items):
        if first_s is None:
            first_s = time_s
        after_s = time_s - first_s
        if speed != "max":
            await sleep_until(begun_s + after_s / speed)
        elif count % BREATH == 0:
            await asyncio.sleep(0)
        take(item, begun_s + after_s)


_MCAP = b"\x89MCAP0\r\n"
"""First bytes of a recording of our own."""


def read_recording(path: Path) -> bytes:
    """All of the file ``path``, as ``pose.path`` names it.

    Raises:
        SourceError: it can't be read, or it is a recording that has to be exported first.
    """
    try:
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a path that no system takes
        why = getattr(error, "strerror", None) or error
        raise SourceError(notice("pose.path_unreadable", path=path, why=why)) from None
    if data.startswith(_MCAP):
        raise SourceError(notice("pose.path_of_flight", path=path))
    return data


def report_no_poses(path: Path, dropped: Mapping[str, int], expected: str | Sentence) -> SourceError:
    """Return the error for a file without poses; ``dropped`` counts its contents."""
    found = ", ".join(f"{count} {reason}" for reason, count in sorted(dropped.items())) or "nothing at all"
    return SourceError(notice("pose.path_empty", path=path, found=found, expected=expected))


class RecordedSource:
    """Plays a recording from its first pose to its last, and falls silent there."""

    def __init__(self, speed: Speed) -> None:
        self._speed: Speed = speed
        self._task: asyncio.Task[None] | None = None

    def _play(
        self,
        items: Iterable[tuple[float, T]],
        decode: Callable[[T, float], Pose | None],
        deliver: Callable[[Pose], None],
    ) -> None:
        def take(item: T, arrival_s: float) -> None:
            pose = decode(item, arrival_s)
            if pose is not None and self._task is not None:
                deliver(pose)

        self._task = asyncio.create_task(play(items, self._speed, take))

    async def close(self) -> None:
        """Stop playing; no pose is delivered afterwards."""
        if self._task is not None:
            self._task.cancel()
            self._task = None


IN_RUN_FOLDER = "poses.csv"
"""Name of the file of poses in a run's folder."""


class CsvConfig(PoseKind, frozen=True, kw_only=True, tag="csv"):
    """Recorded poses: a CSV file t,x,y,z,qw,qx,qy,qz, or the folder of a run."""

    recorded: ClassVar[bool] = True
    path: Annotated[str, msgspec.Meta(description="The file, or the folder that `--out` of a run has written.")]
    speed: Annotated[
        Speed, msgspec.Meta(description='Pace: 1 as recorded, 2 twice as fast, "max" as fast as possible.')
    ] = 1.0
    world: Annotated[World, msgspec.Meta(description="Axes of the file's positions; a run's folder has `ned`.")] = "ned"
    body: Annotated[Body, msgspec.Meta(description="Axes of the body; a run's folder has `frd`.")] = "frd"
    alignment: LabAlignment = Alignment()

    @property
    def real(self) -> None:
        """None: they were recorded, and never fly anything."""
        return None

    def build(self, others: Others | None = None) -> "CsvSource":
        """The source of this config; it shows no ``others``."""
        return CsvSource(self)


class CsvSource(RecordedSource):
    """Implements :class:`groundstation.core.messages.pose.PoseSource` on a CSV file."""

    def __init__(self, config: CsvConfig) -> None:
        super().__init__(config.speed)
        self._config = config
        self._intake = Intake(0.0, frames_of(config))

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now; malformed rows beside the intake's reasons."""
        return self._intake.status

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Read the whole file, then begin to play it."""
        self._play([(row.arrival_s, row) for row in self._read()], self._decode, deliver)

    def _read(self) -> list[CsvRow]:
        path = Path(self._config.path)
        if path.is_dir():
            path /= IN_RUN_FOLDER
        dropped: Counter[str] = self._intake.dropped
        recorded = list(read_csv(io.StringIO(read_recording(path).decode("utf-8", "replace"), newline=None), dropped))
        if not recorded:
            raise report_no_poses(path, dropped, f"expected rows {CSV_COLUMNS}, the last optional")
        return recorded

    def _decode(self, row: CsvRow, arrival_s: float) -> Pose | None:
        age_s = row.arrival_s - row.t_s
        return self._intake.pose(row.arrival_s, arrival_s, row.position, row.attitude, age_s=age_s)


class TlogConfig(PoseKind, frozen=True, kw_only=True, tag="tlog"):
    """A .tlog file of a flight on PX4 or ArduPilot."""

    recorded: ClassVar[bool] = True
    path: Annotated[str, msgspec.Meta(description="The file.")]
    system_id: Annotated[
        int, msgspec.Meta(ge=1, le=255, description="MAVLink system of the vehicle whose poses are played.")
    ] = 1
    component_id: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=255)] | None,
        msgspec.Meta(
            description="MAVLink component whose poses are played; without it the autopilot's, by its heartbeats."
        ),
    ] = None
    latency_s: Annotated[
        float,
        msgspec.Meta(
            ge=0.0,
            le=1.0,
            description="Time from the instant that the autopilot stamps to the earliest arrival in the log [s].",
        ),
    ] = 0.01
    speed: Annotated[
        Speed, msgspec.Meta(description='Pace: 1 as recorded, 2 twice as fast, "max" as fast as possible.')
    ] = 1.0

    @property
    def real(self) -> None:
        """None: they were recorded, and never fly anything."""
        return None

    def build(self, others: Others | None = None) -> "TlogSource":
        """The source of this config; it shows no ``others``."""
        return TlogSource(self)


class TlogSource(RecordedSource):
    """Implements :class:`groundstation.core.messages.pose.PoseSource` on a .tlog."""

    def __init__(self, config: TlogConfig) -> None:
        super().__init__(config.speed)
        self._config = config
        self._reader = TlogReader(b"")
        self._decoder: PoseDecoder | None = None

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now: of the file and of the messages."""
        if self._decoder is None:
            return PoseStatus(accepted=0, dropped=dict(self._reader.dropped))
        status = self._decoder.intake.status
        return msgspec.structs.replace(status, dropped=dict(self._reader.dropped + self._decoder.intake.dropped))

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Read the whole file, then begin to play it."""
        records, decoder = self._read()
        self._decoder = decoder
        self._play(
            [record for record in records if record.message.get_type() in decoder.messages], decoder.decode, deliver
        )

    def _read(self) -> tuple[list[TlogRecord], PoseDecoder]:
        path, system, component = Path(self._config.path), self._config.system_id, self._config.component_id
        self._reader = TlogReader(read_recording(path))
        everything = list(self._reader)
        fault = self._reader.find_fault()
        if fault:
            raise SourceError(notice("pose.path_fault", path=path, fault=fault))
        wanted = {Sender(system, component)} if component else set(find_autopilots(everything))
        records = [one for one in everything if one.sender in wanted and one.sender.system == system]
        decoder = pose_decoder(records, self._config.latency_s)
        if decoder is None:
            found = self._reader.dropped + Counter(f"messages of {one.sender}" for one in everything)
            expected = notice(
                "tlog.no_poses_of",
                of="the autopilot" if component is None else f"component {component}",
                system=system,
                found=describe_senders(everything),
            )
            raise report_no_poses(path, found, expected)
        return records, decoder


def pose_decoder(records: list[TlogRecord], latency_s: float) -> PoseDecoder | None:
    """The decoder for ``records`` of one vehicle: of ODOMETRY where it is there; None where nothing makes poses."""
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
    | TlogConfig
    | CsvConfig
)
"""The configuration of one source; a new source adds its own here."""


def make_source(config: PoseConfig, link: CommandLink, others: Others | None = None) -> PoseSource:
    """The source that ``config`` describes; the autopilot's own estimate shares the connection of ``link``.

    ``others`` are further bodies to look for, where the source shows them.

    Raises:
        ConfigError: the link has no such connection.
    """
    if isinstance(config, MavlinkPoseConfig):
        if not isinstance(link, MavlinkLink):
            raise ConfigError("pose.kind", "'mavlink' needs link.kind = 'mavlink': no other link brings poses")
        return MavlinkPoseSource(config, link)
    return config.build(others)
