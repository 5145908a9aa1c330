"""Reads recordings, also those that were cut off: whatever stands before the damage."""

import struct
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Metadata
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from groundstation.recording.headline import Count, Headline

MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")
"""How each begins: its kind, and how many bytes follow."""
_MESSAGE = struct.Struct("<HIQQ")
"""How a message begins: its channel, its number, and two times."""
_RECORD_BYTES = 1 << 28
"""No record of ours is longer: a length beyond it is damage."""


class NoRecording(Exception):
    """The file is no recording of a flight; the text says what it is instead."""


class Entry(NamedTuple):
    """One message."""

    topic: str
    stamp_ns: int
    """Wall time [ns since 1970]; in virtual time, since its beginning."""
    data: bytes
    """JSON."""

    def value(self) -> dict[str, Any]:
        """What it says, as in groundstation/recording/channels.py."""
        found: dict[str, Any] = msgspec.json.decode(self.data)
        return found


class Recording:
    """One recording. Iterating again reads again."""

    def __init__(self, path: Path) -> None:
        """Look at the beginning of the file.

        Raises:
            NoRecording: it is none, or was cut off before it began.
            OSError: it can't be read.
        """
        self.path = path
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise NoRecording(f"{path} is no MCAP file")
        self.about: dict[str, str] = {}
        """The first record (records.About), and versions; every value as text."""
        self.result: dict[str, str] = {}
        """The headline (headline.Headline) as text; empty before the end was read, and where it is missing."""
        self.whole = False
        """True once the end was read and nothing was damaged."""
        next(self._records(()), None)
        if not self.about:
            raise NoRecording(f"{path} is no recording of a flight, or was cut off before it began")

    def entries(self, topics: Collection[str] = ()) -> Iterator[Entry]:
        """The messages on ``topics`` (none: all) in the order in which things happened, up to the end or the damage."""
        yield from self._records(topics)

    def headline(self) -> Headline:
        """The figures of the flight: as written at its end, or else counted up to the damage."""
        count = Count()
        for entry in self.entries(("/command", "/errors", "/measured", "/mission", "/lost")):
            count.read(entry.topic, entry.value())
        if self.result:
            return from_texts(self.result)
        headline = count.headline()
        return msgspec.structs.replace(headline, reason=f"{headline.reason} (the recording was cut off)")

    def _records(self, topics: Collection[str]) -> Iterator[Entry]:
        self.whole = False
        names: dict[int, str] = {}
        try:
            with self.path.open("rb") as file:
                reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=_RECORD_BYTES)
                for record in reader.records:
                    match record:
                        case Chunk():
                            yield from _messages(record, topics, names)
                        case Metadata(name="about"):
                            self.about = dict(record.metadata)
                        case Metadata(name="result"):
                            self.result = dict(record.metadata)
                        case DataEnd():
                            self.whole = True
        except (McapError, struct.error, ValueError, EOFError, MemoryError, _decompression_error()):
            self.whole = False


def _messages(chunk: Chunk, topics: Collection[str], names: dict[int, str]) -> Iterator[Entry]:
    """What a chunk holds on ``topics``; ``names`` keeps the channels. mcap's own way makes a call of every integer.

    All of it is looked through before the first is given: of a damaged chunk nothing is.
    """
    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    data = stream.read(size)
    found = []
    at = 0
    while at < size:
        kind, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if kind == Opcode.MESSAGE:
            channel, _, stamp_ns, _ = _MESSAGE.unpack_from(data, at)
            name = names.get(channel)
            if name is not None:
                found.append(Entry(name, stamp_ns, data[at + _MESSAGE.size : at + length]))
        elif kind == Opcode.CHANNEL:
            record = Channel.read(ReadDataStream(BytesIO(data[at : at + length])))
            if not topics or record.topic in topics:
                names[record.id] = record.topic
        at += length
    yield from found


def quick_headline(path: Path) -> tuple[dict[str, str], Headline, bool]:
    """About, headline, and whether the recording is whole: from its index where there is one.

    Raises:
        NoRecording, OSError: see :class:`Recording`.
    """
    from mcap.reader import make_reader

    found: dict[str, dict[str, str]] = {}
    try:
        with path.open("rb") as file:
            found = {metadata.name: dict(metadata.metadata) for metadata in make_reader(file).iter_metadata()}
    except (McapError, struct.error, ValueError, EOFError, MemoryError):
        pass
    if "about" in found and "result" in found:
        return found["about"], from_texts(found["result"]), True
    recording = Recording(path)
    headline = recording.headline()
    return recording.about, headline, recording.whole


def from_texts(result: dict[str, str]) -> Headline:
    """The headline as the recording has it."""
    return msgspec.convert(
        {key: None if value == "" and key in ("rms_m", "max_m") else value for key, value in result.items()},
        Headline,
        strict=False,
    )


def _decompression_error() -> type[Exception]:
    import zstandard

    error: type[Exception] = zstandard.ZstdError
    return error
