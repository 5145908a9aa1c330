"""Writer of a recording: records in, an MCAP file and a .tlog out.

The .tlog has the MAVLink traffic, for Mission Planner, MAVProxy and QGroundControl;
groundstation/pose/recorded_codec.py has its form. Both files survive a full disk: what can't be written yet waits in
memory, up to a limit.

The MCAP file has the bytes that the package ``mcap`` writes, in a fraction of its time a message: that package makes an
object of every message and writes each of its fields by a call. Here a message is packed at once into the chunk that it
becomes part of; all else of the format is small and rare.
Source: mcap.dev/spec; what is written is what ``mcap`` 1.6 writes with compression zstd and checksums of all data.
"""

import fcntl
import io
import math
import os
import platform
import struct
import subprocess
import sys
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, Protocol

import msgspec
from zstandard import ZstdCompressor

from groundstation.core.messages import EndRecord, PoseRecord, Say, Severity, TickRecord
from groundstation.recording.channels import CHANNELS, Message, MessageMaker, address, describe_channels
from groundstation.recording.records import (
    MAGIC,
    About,
    HeadlineCounter,
    LineRecord,
    LossRecord,
    Peer,
    ReceivedRecord,
    Record,
    SentRecord,
    WireRecord,
)
from groundstation.runtime import __version__
from links.mavlink.protocol import MOST_SENDERS, frame_end

CHUNK_BYTES = 1 << 20
"""A chunk is closed at the latest when it has grown longer."""
COMPRESSION = "zstd"

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = 0x0B, 0x0C, 0x0D, 0x0E, 0x0F
_HEAD = struct.Struct("<BQHIQQ")
"""What precedes a message's data: operation, length from here on, channel, sequence, log and publish time [ns]."""
_BEFORE = _HEAD.size - 9
"""So much of it counts for the length."""


class Output(Protocol):
    """What a recording is written to."""

    def write(self, data: bytes) -> int:
        """Take ``data``."""
        ...

    def tell(self) -> int:
        """Bytes taken so far."""
        ...

    def flush(self) -> None:
        """Pass on all that was taken."""
        ...


class _Chunk:
    """The messages since the last chunk."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.index: dict[int, list[int]] = {}
        """Channel → stamp and offset of each of its messages, one after the other."""
        self.first_ns = self.last_ns = 0


class _Closed(NamedTuple):
    """A chunk that was written."""

    first_ns: int
    last_ns: int
    offset: int
    length: int
    places: dict[int, int]
    """Channel → where its part of the index is."""
    index_length: int
    compressed: int
    size: int


class McapWriter:
    """One file, from its beginning to its end."""

    def __init__(self, file: Output, library: str) -> None:
        """Begin it; ``library`` says who writes."""
        self._file = file
        self._compress = ZstdCompressor().compress
        self._crc = zlib.crc32(MAGIC)
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._chunk = _Chunk()
        self._closed: list[_Closed] = []
        self._metadata: list[tuple[int, int, str]] = []
        self._counts: dict[int, int] = {}
        self._first_ns = self._last_ns = 0
        file.write(MAGIC)
        self._put(_record(_HEADER, _string("") + _string(library)))

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Facts of the whole recording."""
        record = _record(_METADATA, _string(name) + _string_map(data))
        self._metadata.append((self._file.tell(), len(record), name))
        self._put(record)

    def add_channel(
        self, topic: str, schema_name: str, schema: bytes, schema_encoding: str = "jsonschema", encoding: str = "json"
    ) -> int:
        """A channel of messages in ``encoding``, with their schema; returns its number."""
        number = len(self._channels) + 1
        about = _string(schema_name) + _string(schema_encoding) + len(schema).to_bytes(4, "little") + schema
        self._schemas.append(_record(_SCHEMA, struct.pack("<H", number) + about))
        told = _string(topic) + _string(encoding) + _string_map({})
        self._channels.append(_record(_CHANNEL, struct.pack("<HH", number, number) + told))
        self._chunk.data += self._schemas[-1]
        self._chunk.data += self._channels[-1]
        return number

    def add_message(self, channel: int, stamp_ns: int, data: bytes) -> None:
        """A message, logged and published at ``stamp_ns`` [ns since 1970]."""
        chunk = self._chunk
        index, inside = chunk.index, chunk.data
        if not index or stamp_ns < chunk.first_ns:
            chunk.first_ns = stamp_ns
        chunk.last_ns = max(chunk.last_ns, stamp_ns)
        entries = index.get(channel)
        if entries is None:
            entries = index[channel] = []
        entries.append(stamp_ns)
        entries.append(len(inside))
        inside += _HEAD.pack(_MESSAGE, _BEFORE + len(data), channel, 0, stamp_ns, stamp_ns)
        inside += data
        if len(inside) > CHUNK_BYTES:
            self.close_chunk()

    def flush(self) -> None:
        """Close the chunk, and have all that was added written."""
        self.close_chunk()
        self._file.flush()

    def finish(self) -> None:
        """Write the index; nothing may be added afterwards."""
        self.close_chunk()
        self._put(_record(_DATA_END, struct.pack("<I", self._crc)))
        begin = self._file.tell()
        summary = bytearray()
        offsets: list[bytes] = []
        groups = {
            _SCHEMA: self._schemas,
            _CHANNEL: self._channels,
            _STATISTICS: [self._statistics()],
            _CHUNK_INDEX: [_chunk_index(chunk) for chunk in self._closed],
            0x0A: [],  # attachments, of which there are none
            _METADATA_INDEX: [
                _record(_METADATA_INDEX, struct.pack("<QQ", at, length) + _string(name))
                for at, length, name in self._metadata
            ],
        }
        for operation, records in groups.items():
            start = len(summary)
            summary += b"".join(records)
            offsets.append(
                _record(_SUMMARY_OFFSET, struct.pack("<BQQ", operation, begin + start, len(summary) - start))
            )
        offsets_begin = begin + len(summary)
        summary += b"".join(offsets)
        foot = struct.pack("<BQQQ", _FOOTER, 20, begin, offsets_begin)
        crc = zlib.crc32(foot, zlib.crc32(summary))
        self._file.write(bytes(summary))
        self._file.write(foot + struct.pack("<I", crc) + MAGIC)
        self._file.flush()

    def _put(self, record: bytes) -> None:
        self._crc = zlib.crc32(record, self._crc)
        self._file.write(record)

    def close_chunk(self) -> None:
        """Hand the messages since the last chunk to the file, if there are any."""
        chunk = self._chunk
        if not chunk.index:
            return
        self._chunk = _Chunk()
        if not self._closed or chunk.first_ns < self._first_ns:
            self._first_ns = chunk.first_ns
        self._last_ns = max(self._last_ns, chunk.last_ns)
        packed = self._compress(chunk.data)
        about = struct.pack("<QQQI", chunk.first_ns, chunk.last_ns, len(chunk.data), zlib.crc32(chunk.data))
        offset = self._file.tell()
        record = _record(_CHUNK, about + _string(COMPRESSION) + struct.pack("<Q", len(packed)) + packed)
        self._put(record)
        begin, places, indices = self._file.tell(), {}, bytearray()
        for channel, entries in chunk.index.items():
            places[channel] = begin + len(indices)
            count = len(entries)
            indices += _record(_MESSAGE_INDEX, struct.pack(f"<HI{count}Q", channel, 8 * count, *entries))
            self._counts[channel] = self._counts.get(channel, 0) + count // 2
        self._put(bytes(indices))
        self._closed.append(
            _Closed(
                chunk.first_ns, chunk.last_ns, offset, len(record), places, len(indices), len(packed), len(chunk.data)
            )
        )

    def _statistics(self) -> bytes:
        counts = b"".join(struct.pack("<HQ", channel, count) for channel, count in self._counts.items())
        return _record(
            _STATISTICS,
            struct.pack(
                "<QHIIIIQQI", sum(self._counts.values()), len(self._schemas), len(self._channels), 0,
                len(self._metadata), len(self._closed), self._first_ns, self._last_ns, len(counts),
            ) + counts,
        )  # fmt: skip


def _record(operation: int, content: bytes) -> bytes:
    return struct.pack("<BQ", operation, len(content)) + content


def _string(text: str) -> bytes:
    data = text.encode()
    return len(data).to_bytes(4, "little") + data


def _string_map(texts: Mapping[str, str]) -> bytes:
    data = b"".join(_string(key) + _string(value) for key, value in texts.items())
    return len(data).to_bytes(4, "little") + data


def _chunk_index(chunk: _Closed) -> bytes:
    places = b"".join(struct.pack("<HQ", channel, at) for channel, at in chunk.places.items())
    return _record(
        _CHUNK_INDEX,
        struct.pack("<QQQQI", chunk.first_ns, chunk.last_ns, chunk.offset, chunk.length, len(places))
        + places
        + struct.pack("<Q", chunk.index_length)
        + _string(COMPRESSION)
        + struct.pack("<QQ", chunk.compressed, chunk.size),
    )


PATIENCE_BYTES = 16 << 20
"""So much may wait for room; at more, writing ends for good. About a minute and a half of flight."""


class PatientFile:
    """Binary, only to be written from its beginning to its end. Never raises once it is open."""

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
            self._tell(
                f"WARNING: parts of {self._path} are lost from here on, the flight goes on: {why}", Severity.WARNING
            )

    def _fail(self, why: str) -> None:
        if not self._trouble:
            self._tell(f"WARNING: recording waits, the flight goes on: {self._path}: {why}", Severity.WARNING)
        self._trouble = why
        if len(self._waiting) > PATIENCE_BYTES:
            self._tell(f"WARNING: recording has ended, the flight goes on: {self._path}: {why}", Severity.WARNING)
            self._close()

    def close(self) -> None:
        """Flush, and close."""
        self.flush()
        if self._waiting:
            self._tell(f"WARNING: the end of {self._path} is missing: {self._trouble}", Severity.WARNING)
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

    def __init__(self) -> None:
        self._unfinished: dict[Peer, bytes] = {}

    def records(self, data: bytes, stamp_ns: int, peer: Peer = None) -> bytes:
        """The records of the frames that ``data`` brings to an end at ``stamp_ns`` [ns since 1970].

        With a ``peer``, ``data`` is a datagram to or from that address, whose bytes are a stream of
        their own. A datagram that is one whole frame ends what was unfinished there.
        """
        stamp = (stamp_ns // 1000).to_bytes(8, "big")
        unfinished = self._unfinished.pop(peer, b"")
        if data and frame_end(data, 0) == len(data) and (peer is not None or not unfinished):
            return stamp + data
        data = unfinished + data
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
        rest = data[start : start + _LONGEST_FRAME]
        if rest:
            self._unfinished[peer] = rest
            if len(self._unfinished) > MOST_SENDERS:
                self._unfinished.pop(next(iter(self._unfinished)))
        return bytes(found)


FLUSH_S = 0.25
"""A chunk is closed and written after so long [s]: no more than that is lost to whatever happens."""
_LIBC = "CS_GNU_LIBC_VERSION"
PACKAGES = ("mcap", "msgspec", "numpy", "pymavlink", "zstandard")
"""Whose versions are noted beside ours."""


class FlightLog:
    """Writes NAME.mcap and, once MAVLink passes, NAME.tlog. Never raises once it is open."""

    def __init__(self, path: Path, about: About, *, epoch_ns: int, tell: Say) -> None:
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
        self._messages = MessageMaker(epoch_ns)
        self._count = HeadlineCounter()
        self._encoder = msgspec.json.Encoder()
        self._flushed_s = 0.0
        self._writer = McapWriter(self._file, f"groundstation {__version__}")
        self._writer.add_metadata("about", about_texts(about))
        self._channels = {form[0]: self._writer.add_channel(*form) for form in describe_channels(CHANNELS)}
        self.flush()

    def write(self, *records: Record) -> None:
        """Take records in their order; they reach the disk within ``FLUSH_S`` of flight, or with :meth:`flush`.

        What can't be made a message, or encoded, is left out; in the end the first exception of it is raised.
        """
        messages, ends, failures = list[Message](), list[int](), list[Exception]()
        for record in records:
            try:
                messages += self._messages.of(record)
                self._note(record)
            except Exception as error:  # noqa: BLE001  # a controller of the user's own may put anything into a tick
                failures.append(error)
            ends.append(len(messages))
        at, passed, stamped_s = 0, False, math.nan
        encoded = self._encode(messages, failures)
        add, channels, stamp_ns = self._writer.add_message, self._channels, 0
        for end in ends:
            time_s = 0.0
            while at < end:
                topic, time_s, _ = messages[at]
                if time_s != stamped_s:  # all that is said of a command has its time
                    stamped_s, stamp_ns = time_s, self._messages.stamp(time_s)
                if line := encoded[at]:
                    add(channels[topic], stamp_ns, line[:-1])
                at += 1
            if time_s - self._flushed_s >= FLUSH_S:
                self._flushed_s, passed = time_s, True
                self._writer.close_chunk()
        if passed:
            self.flush()
        if failures:
            raise failures[0]

    def _encode(self, messages: list[Message], failures: list[Exception]) -> list[bytes]:
        """A line each, all in one go; empty where a message can't be encoded, and ``failures`` gets the reason."""
        try:  # bytes.split would look at every byte by itself
            return io.BytesIO(self._encoder.encode_lines([message for _, _, message in messages])).readlines()
        except Exception:  # noqa: BLE001  # as above: one by one, to know which
            encoded = []
            for _, _, message in messages:
                try:
                    encoded.append(self._encoder.encode(message) + b"\n")
                except Exception as error:  # noqa: BLE001  # as above
                    failures.append(error)
                    encoded.append(b"")
            return encoded

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
        """Write the result and the index, and close; whoever knows the truth tells the error by it [m]."""
        with suppress(ValueError):
            headline = msgspec.structs.replace(self._count.headline(), true_rms_m=true_rms_m, true_max_m=true_max_m)
            self._writer.add_metadata("result", _texts(msgspec.to_builtins(headline)))
            self._writer.finish()
        self.leave()

    def leave(self) -> None:
        """Close it as it stands, without an end: what was written is there, and whoever reads it sees it cut off."""
        self._file.close()
        if self._tlog is not None:
            self._tlog.close()

    def _note(self, record: Record) -> None:
        """What the headline and the .tlog want of a record."""
        if type(record) is ReceivedRecord or type(record) is SentRecord:  # most are
            if record.wire in self._cutters:
                self._frames(record)
            return
        match record:
            case TickRecord(tick):
                error = math.dist(tick.estimate.motion.position, tick.reference.position_ned)
                self._count.count_command(tick.flight_time_s, error)
            case PoseRecord():
                self._count.count_pose()
            case WireRecord(_, wire, _, local, remote):
                if self._mavlink and self._mavlink in (address(local), address(remote)):
                    self._cutters[wire] = TlogCutter(), TlogCutter()
            case LineRecord(_, state, text):
                self._count.enter_state(state, text)
            case EndRecord(_, state, reason):
                self._count.end_flight(state, reason)
            case LossRecord(_, count):
                self._count.count_missing(count)

    def _frames(self, record: ReceivedRecord | SentRecord) -> None:
        if self._tlog is None:
            try:
                self._tlog = PatientFile(self.path.with_suffix(".tlog"), self._tell)
            except OSError as error:
                self._tell(f"WARNING: no .tlog of this flight: {error}", Severity.WARNING)
                self._cutters.clear()
                return
        cutter = self._cutters[record.wire][type(record) is SentRecord]
        stamp_ns = self._messages.stamp(record.time_s)
        self._tlog.write(cutter.records(record.data, stamp_ns, record.peer))


def about_texts(about: About) -> dict[str, str]:
    """The first record of a recording: everything known before the flight, and what flies it."""
    packages = ", ".join([f"groundstation {__version__}", *_list_packages(PACKAGES)])
    return _texts(
        {
            **msgspec.to_builtins(about),
            "version": __version__,
            "git": git_commit(),
            "python": platform.python_version(),
            "system": _system(),
            "packages": packages,
        }
    )


def _system() -> str:
    """Kernel, machine and C library, as platform.platform() has them, which starts a program to know the processor."""
    uname = os.uname()
    with suppress(ValueError, OSError):  # another C library
        return f"{uname.sysname}-{uname.release}-{uname.machine}-with-{(os.confstr(_LIBC) or '').replace(' ', '')}"
    return f"{uname.sysname}-{uname.release}-{uname.machine}"


def git_commit() -> str:
    """The commit of the program's own folder, ``-dirty`` where it was changed since; empty outside a clone."""
    folder = Path(__file__).parents[2]
    if not (folder / ".git").exists():
        return ""
    # Not `git describe --dirty`, which takes three times as long: it looks through all commits for a name.
    command = ["git", "-C", str(folder), "status", "--porcelain=v2", "--branch", "--untracked-files=no"]
    try:
        done = subprocess.run(command, capture_output=True, check=False, text=True, timeout=5.0)  # noqa: S603  # our own words, no shell
    except (OSError, subprocess.TimeoutExpired):
        return ""
    told = [line for line in done.stdout.splitlines() if line.startswith("# branch.oid ")]
    changed = any(not line.startswith("#") for line in done.stdout.splitlines())
    return told[0].split()[-1] + ("-dirty" if changed else "") if told else ""


def _list_packages(packages: Iterable[str]) -> Iterator[str]:
    """Names and versions, as the folders NAME-VERSION.dist-info tell; importlib.metadata takes 20 ms to say the same.

    Source: PyPA, Recording installed projects.
    """
    found: dict[str, str] = {}
    for folder in sys.path:
        with suppress(OSError):
            for name in os.listdir(folder):  # noqa: PTH208  # only the names, of hundreds
                package, _, version = name.removesuffix(".dist-info").partition("-")
                if name.endswith(".dist-info"):
                    found.setdefault(package, version)
    return (f"{name} {found.get(name, 'unknown')}" for name in packages)


def _texts(values: dict[str, object]) -> dict[str, str]:
    return {key: "" if value is None else str(value) for key, value in values.items()}
