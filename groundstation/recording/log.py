"""One recording being written: records in, an MCAP file and a .tlog out.

The MAVLink traffic of a flight as .tlog, for Mission Planner, MAVProxy and QGroundControl.

The form is in groundstation/pose/recorded_codec.py: each frame behind the microseconds since 1970, big-endian.

A file that survives a full disk: what can't be written yet waits in memory, up to a limit.
"""

import fcntl
import math
import os
import platform
import subprocess
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

from groundstation.recording.channels import CHANNELS, schema
from groundstation.recording.headline import Count
from groundstation.recording.mcap_writer import McapWriter
from groundstation.recording.messages import Messages, address
from groundstation.recording.records import About, Ended, Lost, Opened, Posed, Received, Record, Sent, Ticked, Told
from groundstation.runtime import __version__
from links.mavlink.protocol import frame_end

PATIENCE_BYTES = 16 << 20
"""So much may wait for room; at more, writing ends for good. About a minute and a half of flight."""


class PatientFile:
    """Binary, only to be written from its beginning to its end. Never raises once it is open."""

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        """Make the file, which must not exist; ``tell`` takes warnings for the operator.

        Raises:
            OSError: it can't be made.
        """
        self._path = path
        self._tell = tell
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        fcntl.flock(self._fd, fcntl.LOCK_EX)  # while it lasts, nobody tidies this file away
        self._waiting = bytearray()
        self._size = 0
        self._trouble = ""
        self._torn = False

    @property
    def alive(self) -> bool:
        """False once writing has ended."""
        return self._fd >= 0

    def write(self, data: bytes) -> int:
        """Take ``data``; it reaches the disk with :meth:`flush`."""
        self._size += len(data)
        if self.alive:
            self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Bytes taken so far."""
        return self._size

    def flush(self) -> None:
        """Hand all that waits to the operating system, as far as there is room."""
        while self._waiting and self.alive:
            try:
                written = os.write(self._fd, self._waiting)
            except OSError as error:
                self._fail(error.strerror or str(error))
                return
            del self._waiting[:written]
        if self._trouble and self.alive:
            self._trouble = ""
            self._tell(f"recording to {self._path} goes on, nothing is lost")

    def sync(self) -> None:
        """Have all that was written reach the disk itself, and tell where it did not.

        What writing takes, the operating system only keeps for the disk: that it has no room after all (a thin volume,
        a network's), or is broken, it finds out some ten seconds later, and tells whoever asks.
        """
        if not self.alive or self._torn:
            return
        try:
            os.fdatasync(self._fd)
        except OSError as error:
            self._torn = True
            why = error.strerror or str(error)
            self._tell(f"WARNING: parts of {self._path} are lost from here on, the flight goes on: {why}")

    def _fail(self, why: str) -> None:
        if not self._trouble:
            self._tell(f"WARNING: recording waits, the flight goes on: {self._path}: {why}")
        self._trouble = why
        if len(self._waiting) > PATIENCE_BYTES:
            self._tell(f"WARNING: recording has ended, the flight goes on: {self._path}: {why}")
            self._close()

    def close(self) -> None:
        """Flush, and close."""
        self.flush()
        if self._waiting:
            self._tell(f"WARNING: the end of {self._path} is missing: {self._trouble}")
        if self.alive:
            self._close()

    def _close(self) -> None:
        os.close(self._fd)
        self._fd = -1
        self._waiting.clear()


_LONGEST_FRAME = 293
"""A frame of MAVLink 2 with its signature; what waits longer for its end is none."""


class TlogCutter:
    """Cuts the bytes of one direction into the records of a .tlog. Sans-IO."""

    def __init__(self, *, datagrams: bool) -> None:
        """``datagrams``: bytes come in whole frames; on a stream they may be cut anywhere."""
        self._datagrams = datagrams
        self._pending = b""

    def records(self, data: bytes, stamp_ns: int) -> bytes:
        """The records of the frames that ``data`` brings to an end at ``stamp_ns`` [ns since 1970]."""
        data = self._pending + data
        stamp = (stamp_ns // 1000).to_bytes(8, "big")
        found = bytearray()
        start, size = 0, len(data)
        while start < size:
            end = frame_end(data, start)
            if end > size:
                break
            if end:
                found += stamp + data[start:end]
                start = end
            else:
                start += 1
        self._pending = b"" if self._datagrams else data[start : start + _LONGEST_FRAME]
        return bytes(found)


FLUSH_S = 0.25
"""A chunk is closed and written after so long [s]: no more than that is lost to whatever happens."""
PACKAGES = ("mcap", "msgspec", "numpy", "pymavlink", "zstandard")
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
        self._writer = McapWriter(self._file, f"groundstation {__version__}")
        self._writer.add_metadata("about", facts(about))
        self._channels = {
            topic: self._writer.add_channel(topic, name, schema(name, message))
            for topic, (name, message) in CHANNELS.items()
        }
        self.flush()

    def write(self, record: Record) -> None:
        """Take one record; it reaches the disk within ``FLUSH_S`` of flight, or with :meth:`flush`."""
        time_s = 0.0
        add, channels, encode, stamp = self._writer.add_message, self._channels, self._encode, self._messages.stamp
        for topic, time_s, message in self._messages.of(record):
            add(channels[topic], stamp(time_s), encode(message))
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
            case Received(time_s, wire, _, _, data):
                self._frames(wire, 0, time_s, data)
            case Sent(time_s, wire, _, data):
                self._frames(wire, 1, time_s, data)
            case Ticked(tick):
                error = math.dist(tick.estimate.motion.position, tick.reference.position_ned)
                self._count.ticked(tick.flight_time_s, error)
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
    packages = ", ".join([f"groundstation {__version__}", *(f"{name} {_version(name)}" for name in PACKAGES)])
    return _texts(
        {
            **msgspec.to_builtins(about),
            "version": __version__,
            "git": git_commit(),
            "python": platform.python_version(),
            "system": platform.platform(),
            "packages": packages,
        }
    )


def git_commit() -> str:
    """The commit of the program's own folder, ``-dirty`` where it was changed since; empty outside a clone."""
    folder = Path(__file__).parents[2]
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
