"""Writes MCAP files: the same bytes as the package ``mcap`` writes, in a fraction of its time a message.

That package makes an object of every message and writes each of its fields by a call. Here a message is packed at once
into the chunk that it becomes part of; all else of the format is small and rare.
Source: mcap.dev/spec; what is written is what ``mcap`` 1.6 writes with compression zstd and checksums of all data.
"""

import struct
import zlib
from collections.abc import Mapping
from typing import NamedTuple, Protocol

from zstandard import ZstdCompressor

MAGIC = b"\x89MCAP0\r\n"
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
        self._put(_record(_HEADER, _text("") + _text(library)))

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Facts of the whole recording."""
        record = _record(_METADATA, _text(name) + _texts(data))
        self._metadata.append((self._file.tell(), len(record), name))
        self._put(record)

    def add_channel(self, topic: str, schema_name: str, schema: bytes) -> int:
        """A channel of JSON messages with a JSON schema; returns its number."""
        number = len(self._channels) + 1
        about = _text(schema_name) + _text("jsonschema") + len(schema).to_bytes(4, "little") + schema
        self._schemas.append(_record(_SCHEMA, struct.pack("<H", number) + about))
        self._channels.append(
            _record(_CHANNEL, struct.pack("<HH", number, number) + _text(topic) + _text("json") + _texts({}))
        )
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
            self._close_chunk()

    def flush(self) -> None:
        """Close the chunk, and have all that was added written."""
        self._close_chunk()
        self._file.flush()

    def finish(self) -> None:
        """Write the index; nothing may be added afterwards."""
        self._close_chunk()
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
                _record(_METADATA_INDEX, struct.pack("<QQ", at, length) + _text(name))
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

    def _close_chunk(self) -> None:
        """Write the messages since the last chunk, if there are any."""
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
        record = _record(_CHUNK, about + _text(COMPRESSION) + struct.pack("<Q", len(packed)) + packed)
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


def _text(text: str) -> bytes:
    data = text.encode()
    return len(data).to_bytes(4, "little") + data


def _texts(texts: Mapping[str, str]) -> bytes:
    data = b"".join(_text(key) + _text(value) for key, value in texts.items())
    return len(data).to_bytes(4, "little") + data


def _chunk_index(chunk: _Closed) -> bytes:
    places = b"".join(struct.pack("<HQ", channel, at) for channel, at in chunk.places.items())
    return _record(
        _CHUNK_INDEX,
        struct.pack("<QQQQI", chunk.first_ns, chunk.last_ns, chunk.offset, chunk.length, len(places))
        + places
        + struct.pack("<Q", chunk.index_length)
        + _text(COMPRESSION)
        + struct.pack("<QQ", chunk.compressed, chunk.size),
    )
