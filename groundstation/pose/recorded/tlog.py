"""Poses from a recorded flight: a .tlog played back at the pace at which it was recorded, or another."""

import asyncio
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import msgspec

from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.recorded.playback import Speed, contents, no_poses, play
from groundstation.pose.recorded.tlog_codec import Record, TlogReader
from groundstation.pose.sources import Decoder, decoder_for
from links.mavlink.protocol import ARDUPILOT, PX4, Message


class TlogConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="kind", tag="tlog"):
    """A .tlog file of a flight on PX4 or ArduPilot."""

    path: str
    """The file."""
    system_id: Annotated[int, msgspec.Meta(ge=1, le=255)] = 1
    """MAVLink system of the vehicle whose poses are played."""
    latency_s: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.01
    """Time from the instant that the autopilot stamps to the earliest arrival in the log [s]."""
    speed: Speed = 1.0
    """Pace: 1 as recorded, 2 twice as fast, "max" as fast as possible."""

    @property
    def real(self) -> None:
        """None: they were recorded, and never fly anything."""
        return None

    def build(self) -> "TlogSource":
        """The source of this config."""
        return TlogSource(self)


class TlogSource:
    """Implements :class:`groundstation.core.messages.pose.PoseSource`; falls silent where the recording ends."""

    def __init__(self, config: TlogConfig) -> None:
        """Nothing is read yet."""
        self._config = config
        self._reader = TlogReader(b"")
        self._decoder: Decoder | None = None
        self._task: asyncio.Task[None] | None = None

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now: of the file and of the messages."""
        if self._decoder is None:
            return PoseStatus(accepted=0, dropped=dict(self._reader.dropped))
        status = self._decoder.status
        return msgspec.structs.replace(status, dropped=dict(self._reader.dropped + self._decoder.dropped))

    async def start(self, deliver: Callable[[Pose], None]) -> None:
        """Read the whole file, then begin to play it.

        Raises:
            SourceError: the file can't be read, or holds no messages that make poses; the text says what to look for.
        """
        records, decoder = self._read()
        self._decoder = decoder

        def take(message: Message, arrival_s: float) -> None:
            pose = decoder.decode(message, arrival_s)
            if pose is not None and self._task is not None:
                deliver(pose)

        wanted = [(time_s, message) for time_s, message in records if message.get_type() in decoder.messages]
        self._task = asyncio.create_task(play(wanted, self._config.speed, take))

    def _read(self) -> tuple[list[Record], Decoder]:
        path, system = Path(self._config.path), self._config.system_id
        self._reader = TlogReader(contents(path))
        everything = list(self._reader)
        records = [record for record in everything if record.message.get_srcSystem() == system]
        decoder = pose_decoder(records, self._config.latency_s)
        if decoder is None:
            found = self._reader.dropped + Counter(
                f"messages of system {record.message.get_srcSystem()}" for record in everything
            )
            wanted = "ODOMETRY, or LOCAL_POSITION_NED and ATTITUDE_QUATERNION"
            raise no_poses(path, found, f"expected {wanted} of system {system}: check pose.system_id, or record them")
        return records, decoder

    async def close(self) -> None:
        """Stop playing; no pose is delivered afterwards."""
        if self._task is not None:
            self._task.cancel()
            self._task = None


def pose_decoder(records: list[Record], latency_s: float) -> Decoder | None:
    """The decoder for ``records`` of one vehicle: of ODOMETRY where it is there; None where nothing makes poses."""
    names = {record.message.get_type() for record in records}
    for autopilot in (PX4, ARDUPILOT):
        decoder = decoder_for(autopilot, latency_s, recorded=True)
        if names.issuperset(decoder.messages):
            return decoder
    return None
