"""One recording being written: records in, an MCAP file and a .tlog out."""

import math
import platform
import subprocess
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, Any, cast

import msgspec
from mcap.writer import CompressionType, Writer

import groundstation
from groundstation.recording.channels import CHANNELS
from groundstation.recording.headline import Count
from groundstation.recording.messages import Messages, address
from groundstation.recording.patient_file import PatientFile
from groundstation.recording.records import About, Ended, Lost, Opened, Posed, Received, Record, Sent, Ticked, Told
from groundstation.recording.schema import schema
from groundstation.recording.tlog import TlogCutter

FLUSH_S = 0.25
"""A chunk is closed and written after so long [s]: no more than that is lost to whatever happens."""
PACKAGES = ("mcap", "msgspec", "numpy", "pymavlink")
"""Whose versions are noted beside ours."""


class FlightLog:
    """Writes NAME.mcap and, once MAVLink passes, NAME.tlog. Never raises once it is open."""

    def __init__(self, path: Path, about: About, *, epoch_ns: int, tell: Callable[[str], None]) -> None:
        """Make the file at ``path`` (NAME.mcap); ``epoch_ns`` is the wall time of the event loop's zero [ns].

        ``tell`` takes warnings for the operator.

        Raises:
            OSError: it can't be made, or is there already.
        """
        self.path = path
        self._tell = tell
        self._file = PatientFile(path, tell)
        self._tlog: PatientFile | None = None
        self._mavlink = about.mavlink
        self._cutters: dict[int, tuple[TlogCutter, TlogCutter]] = {}
        self._messages = Messages(epoch_ns)
        self._count = Count()
        self._encode = msgspec.json.Encoder().encode
        self._flushed_s = 0.0
        # Any: some of its methods have no types
        self._writer: Any = Writer(cast(IO[bytes], self._file), compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._writer.start(library=f"groundstation {groundstation.__version__}")
        self._writer.add_metadata("about", facts(about))
        self._channels = {
            topic: self._writer.register_channel(
                topic, "json", self._writer.register_schema(name, "jsonschema", schema(name, message))
            )
            for topic, (name, message) in CHANNELS.items()
        }
        self.flush()

    def write(self, record: Record) -> None:
        """Take one record; it reaches the disk within ``FLUSH_S`` of flight, or with :meth:`flush`."""
        time_s = 0.0
        for topic, time_s, message in self._messages.of(record):
            stamp = self._messages.stamp(time_s)
            self._writer.add_message(self._channels[topic], stamp, self._encode(message), stamp)
        self._note(record)
        if time_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = time_s
            self.flush()

    def flush(self) -> None:
        """Write what there is."""
        self._writer.flush()
        if self._tlog is not None:
            self._tlog.flush()

    def sync(self) -> None:
        """Wait until what is written has reached the disk."""
        self._file.sync()
        if self._tlog is not None:
            self._tlog.sync()

    def close(self) -> None:
        """Write the result and the index, and close."""
        with suppress(ValueError):
            self._writer.add_metadata("result", _texts(msgspec.to_builtins(self._count.headline())))
            self._writer.finish()
        self._file.close()
        if self._tlog is not None:
            self._tlog.close()

    def _note(self, record: Record) -> None:
        """What the headline and the .tlog want of a record."""
        match record:
            case Ticked(tick):
                error = math.dist(tick.estimate.motion.position, tick.reference.position_ned)
                self._count.ticked(tick.flight_time_s, error)
            case Received(time_s, wire, _, _, data):
                self._frames(wire, 0, time_s, data)
            case Sent(time_s, wire, _, data):
                self._frames(wire, 1, time_s, data)
            case Posed():
                self._count.posed()
            case Opened(_, wire, kind, local, remote):
                if self._mavlink and self._mavlink in (address(local), address(remote)):
                    datagrams = kind == "udp"
                    self._cutters[wire] = TlogCutter(datagrams=datagrams), TlogCutter(datagrams=datagrams)
            case Told(_, state, text):
                self._count.told(state, text)
            case Ended(_, state, reason):
                self._count.ended(state, reason)
            case Lost(_, count):
                self._count.lost(count)

    def _frames(self, wire: int, direction: int, time_s: float, data: bytes) -> None:
        cutters = self._cutters.get(wire)
        if cutters is None:
            return
        if self._tlog is None:
            try:
                self._tlog = PatientFile(self.path.with_suffix(".tlog"), self._tell)
            except OSError as error:
                self._tell(f"WARNING: no .tlog of this flight: {error}")
                self._cutters.clear()
                return
        self._tlog.write(cutters[direction].records(data, self._messages.stamp(time_s)))


def facts(about: About) -> dict[str, str]:
    """The first record of a recording: everything known before the flight, and what flies it."""
    packages = ", ".join(
        [f"groundstation {groundstation.__version__}", *(f"{name} {_version(name)}" for name in PACKAGES)]
    )
    return _texts(
        {
            **msgspec.to_builtins(about),
            "version": groundstation.__version__,
            "git": git_commit(),
            "python": platform.python_version(),
            "system": platform.platform(),
            "packages": packages,
        }
    )


def git_commit() -> str:
    """The commit of the program's own folder, ``-dirty`` where it was changed since; empty outside a clone."""
    folder = Path(groundstation.__file__).parents[1]
    if not (folder / ".git").exists():
        return ""
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=40", "--match="]
    try:
        done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=5.0)  # noqa: S603  # our own words, no shell
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return done.stdout.strip()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "unknown"


def _texts(values: dict[str, object]) -> dict[str, str]:
    return {key: "" if value is None else str(value) for key, value in values.items()}
