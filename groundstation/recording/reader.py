"""Reads recordings, also those that were cut off: whatever stands before the damage."""

import struct
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from mcap.exceptions import McapError
from mcap.records import Channel, DataEnd, Message, Metadata
from mcap.stream_reader import StreamReader

from groundstation.recording.headline import Count, Headline

MAGIC = b"\x89MCAP0\r\n"
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
                for record in StreamReader(file, validate_crcs=True, record_size_limit=_RECORD_BYTES).records:
                    match record:
                        case Message():
                            name = names.get(record.channel_id)
                            if name is not None:
                                yield Entry(name, record.log_time, record.data)
                        case Channel():
                            if not topics or record.topic in topics:
                                names[record.id] = record.topic
                        case Metadata(name="about"):
                            self.about = dict(record.metadata)
                        case Metadata(name="result"):
                            self.result = dict(record.metadata)
                        case DataEnd():
                            self.whole = True
        except (McapError, struct.error, ValueError, EOFError, MemoryError, _decompression_error()):
            self.whole = False


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
