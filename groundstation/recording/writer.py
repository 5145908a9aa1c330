"""Writer of a recording: records in, an MCAP file and a .tlog out.

The package ``mcap`` writes the MCAP file; its chunk is closed and written every ``FLUSH_S``.
The .tlog has the MAVLink traffic, for Mission Planner, MAVProxy and QGroundControl; its form
stands in groundstation/pose/recorded_codec.py.
Both files survive a full disk: what fitted can be read.
"""

import errno
import fcntl
import os
import platform
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from groundstation.core.messages import EndRecord, Say, notice
from groundstation.recording.channels import (
    CHANNELS,
    ChannelForm,
    MessageMaker,
    address,
    describe_channels,
)
from groundstation.recording.headline import FlightHeadline, HeadlineCounter
from groundstation.recording.records import (
    About,
    Peer,
    ReceivedRecord,
    Record,
    SentRecord,
    WireRecord,
)
from groundstation.runtime import __version__
from links.mavlink.protocol import MOST_SENDERS, find_frame_end

if TYPE_CHECKING:
    from mcap.writer import Writer


def begin_mcap(output: Any, library: str, about: dict[str, str]) -> "Writer":
    """Begin an MCAP file in ``output``, which has write, tell and flush; ``library`` names us."""
    from mcap.writer import Writer

    writer = Writer(output, enable_data_crcs=True)
    writer.start(library=library)
    writer.add_metadata("about", about)
    return writer


def add_channel(writer: "Writer", form: ChannelForm) -> int:
    """Add a channel with its schema to the file; return its number."""
    topic, schema_name, schema, schema_encoding, encoding = form
    return writer.register_channel(
        topic, encoding, writer.register_schema(schema_name, schema_encoding, schema)
    )


class LastingFile:
    """Binary, written from its beginning to its end.

    Never raises once it is open: the first error ends it.
    """

    def __init__(self, path: Path, tell: Say) -> None:
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
        self._alive = True

    def write(self, data: bytes) -> int:
        """Take ``data``; it reaches the disk with :meth:`flush`."""
        self._size += len(data)
        if self._alive:
            self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Bytes taken so far."""
        return self._size

    def flush(self) -> None:
        """Hand all that waits to the operating system."""
        try:
            while self._alive and self._waiting:
                del self._waiting[: os.write(self._fd, self._waiting)]
        except OSError as error:
            self._end(error)

    def sync(self) -> None:
        """Have all that was written reach the disk itself.

        What writing takes, the operating system only keeps for the disk: that it has no room after
        all (a thin volume, a network's), or is broken, it finds out some ten seconds later, and
        tells whoever asks. A file that somebody has removed takes all of it, and keeps nothing.
        """
        if self._alive:
            try:
                os.fdatasync(self._fd)
                if self.is_removed:
                    raise FileNotFoundError(errno.ENOENT, "the file was removed")
            except OSError as error:
                self._end(error)

    @property
    def is_removed(self) -> bool:
        """Whether nobody can find it any more, while it is open here."""
        return os.fstat(self._fd).st_nlink == 0 and not self._path.exists()

    @property
    def has_ended(self) -> bool:
        """Whether an error has ended it."""
        return not self._alive

    def _end(self, error: OSError) -> None:
        """Write nothing more, and tell the operator why."""
        if self._alive:
            self._alive = False
            self._tell(notice("recording.ended", path=self._path, why=error.strerror or str(error)))

    def close(self) -> None:
        """Flush, and close."""
        self.flush()
        os.close(self._fd)


class TlogCutter:
    """Cuts the bytes of one direction into the records of a .tlog. Sans-IO."""

    def __init__(self) -> None:
        self._unfinished: dict[Peer, bytes] = {}

    def records(self, data: bytes, stamp_ns: int, peer: Peer = None) -> bytes:
        """The records of the frames that ``data`` brings to an end at ``stamp_ns`` [ns since 1970].

        With a ``peer``, ``data`` is a datagram to or from that address, whose bytes are a stream of
        their own. A datagram that is one whole frame ends what was unfinished there.
        """
        stamp = (stamp_ns // 1000).to_bytes(8, "big")
        unfinished = self._unfinished.pop(peer, b"")
        if data and find_frame_end(data, 0) == len(data) and (peer is not None or not unfinished):
            return stamp + data
        data = unfinished + data
        found = bytearray()
        start, size = 0, len(data)
        while start < size:
            end = find_frame_end(data, start)
            if end > size:
                break
            if end:
                found += stamp + data[start:end]
                start = end
            else:
                start += 1
        if start < size:
            self._unfinished[peer] = data[start:]  # less than a frame
            if len(self._unfinished) > MOST_SENDERS:
                self._unfinished.pop(next(iter(self._unfinished)))
        return bytes(found)


FLUSH_S = 0.15
"""A chunk is closed and written after this time [s].

With the 0.03 s that records wait in the flight's process, and the time that a busy machine takes, a
crash loses less than 0.25 s (tests/e2e/test_recorder_process.py kills recorders at random)."""
PACKAGES = ("mcap", "msgspec", "numpy", "pymavlink", "zstandard")
"""Packages whose versions are noted beside ours."""


class FlightLog:
    """Writes NAME.mcap and, once MAVLink passes, NAME.tlog. Never raises once it is open."""

    def __init__(self, path: Path, about: About, *, epoch_ns: int, tell: Say) -> None:
        """Make the file at ``path`` (NAME.mcap).

        ``epoch_ns`` is the wall time of the event loop's zero [ns].

        ``tell`` takes warnings for the operator.

        Raises:
            OSError: it can't be made, or is there already.
        """
        self.path = path
        self._tell = tell
        self._file = LastingFile(path, tell)
        self._tlog: LastingFile | None = None
        self._mavlink = about.mavlink
        self._cutters: dict[int, tuple[TlogCutter, TlogCutter]] = {}
        self._messages = MessageMaker(epoch_ns)
        self._count = HeadlineCounter()
        self._encoder = msgspec.json.Encoder()
        self._flushed_s = 0.0
        self._has_end = False
        """Whether the flight has said how it ended."""
        self._writer = begin_mcap(self._file, f"groundstation {__version__}", about_texts(about))
        self._channels = {
            form[0]: add_channel(self._writer, form) for form in describe_channels(CHANNELS)
        }
        self.flush()

    def write(self, record: Record) -> None:
        """Take one record; it reaches the disk within ``FLUSH_S`` of flight, or with :meth:`flush`.

        Raises:
            Exception: the record can't be encoded (a controller of the user's own may put anything
                into a tick); it is left out.
        """
        time_s = self._flushed_s
        messages = [
            (*message, self._encoder.encode(message[2])) for message in self._messages.of(record)
        ]
        for topic, time_s, message, data in messages:
            stamp_ns = self._messages.stamp(time_s)
            self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns)
            self._count.add(message)
        self._note(record)
        if time_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = time_s
            self.flush()

    @property
    def headline(self) -> FlightHeadline:
        """The figures so far, whether or not they have reached the disk."""
        return self._count.headline()

    @property
    def is_removed(self) -> bool:
        """Whether somebody has removed NAME.mcap since it was made."""
        return self._file.is_removed

    @property
    def has_ended(self) -> bool:
        """Whether an error has ended NAME.mcap before the flight's end."""
        return self._file.has_ended

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

    def close(self, true_rms_m: float | None = None, true_max_m: float | None = None) -> None:
        """Write the result and the index, and close.

        Whoever knows the truth tells the error by it [m].
        """
        with suppress(ValueError):
            headline = self._count.headline()
            reason = headline.reason
            if not self._has_end:
                reason = notice("recording.no_end", reason=reason).text
            headline = msgspec.structs.replace(
                headline, reason=reason, true_rms_m=true_rms_m, true_max_m=true_max_m
            )
            self._writer.add_metadata("result", _texts(msgspec.to_builtins(headline)))
            self._writer.finish()
            self._file.flush()
        self.leave()

    def leave(self) -> None:
        """Close it as it stands, without an end: what was written is there, and whoever reads it
        sees it cut off.
        """
        self._file.close()
        if self._tlog is not None:
            self._tlog.close()

    def _note(self, record: Record) -> None:
        """Write the bytes of a MAVLink wire to the .tlog; note the end of the flight."""
        match record:
            case ReceivedRecord() | SentRecord():
                if record.wire in self._cutters:
                    self._frames(record)
            case WireRecord(_, wire, _, local, remote):
                if self._mavlink and self._mavlink in (address(local), address(remote)):
                    self._cutters[wire] = TlogCutter(), TlogCutter()
            case EndRecord(_, state, reason):
                self._count.end_flight(state, reason)
                self._has_end = True

    def _frames(self, record: ReceivedRecord | SentRecord) -> None:
        if self._tlog is None:
            try:
                self._tlog = LastingFile(self.path.with_suffix(".tlog"), self._tell)
            except OSError as error:
                self._tell(notice("recording.no_tlog", why=error))
                self._cutters.clear()
                return
        cutter = self._cutters[record.wire][type(record) is SentRecord]
        stamp_ns = self._messages.stamp(record.time_s)
        self._tlog.write(cutter.records(record.data, stamp_ns, record.peer))


def about_texts(about: About) -> dict[str, str]:
    """The first record of a recording: everything known before the flight, and what flies it."""
    return _texts(
        {
            **msgspec.to_builtins(about),
            "version": __version__,
            "git": git_commit(),
            "python": platform.python_version(),
            "system": platform.platform(),
            "packages": ", ".join([f"groundstation {__version__}", *map(_name_version, PACKAGES)]),
        }
    )


def _name_version(package: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return f"{package} unknown"


def git_commit() -> str:
    """The commit of the program's own folder, ``-dirty`` where it was changed since.

    Empty outside a clone.
    """
    folder = Path(__file__).parents[2]
    if not (folder / ".git").exists():
        return ""
    # Not `git describe --dirty`, which takes three times as long: it looks through all commits for
    # a name.
    command = [
        "git",
        "-C",
        str(folder),
        "status",
        "--porcelain=v2",
        "--branch",
        "--untracked-files=no",
    ]
    try:
        done = subprocess.run(  # noqa: S603  # our own words, no shell
            command,
            capture_output=True,
            check=False,
            encoding="utf-8",
            errors="replace",
            timeout=5.0,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    told = [line for line in done.stdout.splitlines() if line.startswith("# branch.oid ")]
    changed = any(not line.startswith("#") for line in done.stdout.splitlines())
    return told[0].split()[-1] + ("-dirty" if changed else "") if told else ""


def _texts(values: dict[str, object]) -> dict[str, str]:
    return {key: "" if value is None else str(value) for key, value in values.items()}
