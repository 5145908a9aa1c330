"""Reads recordings, also those that were cut off or damaged: whatever stands before that."""

import os
import struct
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import msgspec

from groundstation.config import ConfigError
from groundstation.core.messages import notice
from groundstation.machine import is_being_written
from groundstation.recording.channels import CHANNELS
from groundstation.recording.headline import TOPICS, FlightHeadline, HeadlineCounter
from groundstation.recording.records import MAGIC

if TYPE_CHECKING:
    from numpy.typing import NDArray

_RECORD = struct.Struct("<BQ")
"""Head of a record: its kind, and its number of bytes."""


@contextmanager
def refuse_recordings(*more: type[Exception]) -> Iterator[None]:
    """Tell the operator why a recording can't be read here, or what ``more`` is wrong with it.

    Raises:
        ConfigError: in the place of NoRecording, OSError and ``more``.
    """
    wrong: tuple[type[Exception], ...] = (NoRecording, *more)
    try:
        yield
    except wrong as error:
        raise ConfigError("LOG", str(error)) from None
    except OSError as error:
        says = notice("file.unread", path=error.filename or "it", why=error.strerror)
        raise ConfigError("LOG", says) from None
    except ValueError as error:  # a name that no file can have
        raise ConfigError("LOG", notice("file.unread", path="it", why=error)) from None


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
        """Decode it as nested dictionaries, for tables."""
        found: dict[str, Any] = msgspec.json.decode(self.data)
        return found

    def message(self) -> Any:
        """Decode it as the message type of its channel (groundstation/recording/channels.py)."""
        return msgspec.json.decode(self.data, type=CHANNELS[self.topic][1])


class Recording:
    """One recording. Iterating again reads again."""

    def __init__(self, path: Path) -> None:
        """Look at the beginning of the file.

        Raises:
            NoRecording: it is none, or was cut off before it began.
            OSError: it can't be read.
        """
        self.path = path
        if path.is_fifo():  # opening one waits for its writer, and it can't be read twice
            raise NoRecording(notice("recording.pipe", path=path))
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise NoRecording(notice("recording.no_mcap", path=path))
        self.about: dict[str, str] = {}
        """The first record (records.About), and versions; every value as text."""
        self.result: dict[str, str] = {}
        """The headline (headline.FlightHeadline) as text; empty until the end was read."""
        self.whole = False
        """True once the end was read and nothing was damaged."""
        self.damaged_at: int | None = None
        """Where the damage begins that ended the reading [byte]; None where the recording is whole
        or was cut off."""
        next(self._records(()), None)
        if not self.about and self.damaged_at is not None:
            raise NoRecording(notice("recording.damaged", path=path, at=self.damaged_at))
        if not self.about:
            raise NoRecording(notice("recording.no_flight", path=path))

    def entries(self, topics: Collection[str] = ()) -> Iterator[Entry]:
        """The messages on ``topics`` (none: all) in the order in which things happened, up to the
        end or the damage.
        """
        yield from (entry for entry in self._records(topics) if entry is not None)

    def follow(self) -> Iterator[Entry | None]:
        """All messages, also of a flight that is still being recorded: None wherever there is no
        more yet.
        """
        yield from self._records((), growing=True)

    @property
    def trouble(self) -> str:
        """Why not all of the flight could be read, for "the recording …"; empty where it could."""
        if self.damaged_at is not None and self.result:
            return f"is damaged somewhere before byte {self.damaged_at}, but in no message"
        if self.damaged_at is not None:
            return f"is damaged at byte {self.damaged_at}: the rest is not read"
        return "" if self.whole else "was cut off"

    @property
    def remark(self) -> str:
        """The trouble, to end a sentence about what the recording holds; empty without any."""
        return f"; the recording {self.trouble}" if self.trouble else ""

    def headline(self) -> FlightHeadline:
        """The figures of the flight: as written at its end, or else counted up to the damage."""
        count = HeadlineCounter()
        for entry in self.entries(TOPICS):
            count.add(entry.message())
        headline = from_texts(self.result) if self.result else count.headline()
        if not self.trouble:
            return headline
        return msgspec.structs.replace(
            headline, reason=f"{headline.reason} (the recording {self.trouble})"
        )

    def _records(self, topics: Collection[str], *, growing: bool = False) -> Iterator[Entry | None]:
        """The messages on ``topics``.

        Where it is ``growing``, None instead of an end that is none.
        """
        from mcap.records import (
            Chunk,
            DataEnd,
            Metadata,
        )  # only now: a flight that reads none needs no mcap

        from groundstation.recording.strict_reader import DAMAGE, StrictReader, read_messages

        self.whole, self.damaged_at, self.result = False, None, {}
        names: dict[int, str] = {}
        with self.path.open("rb") as file:
            at = len(MAGIC)
            try:
                records = StrictReader(file).records
                while True:
                    while growing and not _is_next_whole(file) and is_being_written(self.path):
                        yield None
                    record = next(records, None)
                    match record:
                        case None:
                            break
                        case Chunk():
                            for topic, message in read_messages(record, topics, names):
                                yield Entry(topic, message.log_time, message.data)
                        case Metadata(name="about"):
                            self.about = dict(record.metadata)
                        case Metadata(name="result"):
                            self.result = dict(record.metadata)
                        case DataEnd():
                            self.whole = True
                    at = file.tell()
            except DAMAGE:
                self.whole = False
                if not _ends_early(file):
                    self.damaged_at = at


def _is_next_whole(file: BinaryIO) -> bool:
    """Whether all of the record that comes next in ``file`` has been written."""
    at = max(file.tell(), len(MAGIC))
    left = os.fstat(file.fileno()).st_size - at - _RECORD.size
    return left >= 0 and left >= _RECORD.unpack(os.pread(file.fileno(), _RECORD.size, at))[1]


def _ends_early(file: BinaryIO) -> bool:
    """Whether ``file`` was read to its end, and that is none: it was cut off there."""
    reached = file.tell()
    size = file.seek(0, os.SEEK_END)
    file.seek(-len(MAGIC), os.SEEK_END)
    return reached == size and file.read() != MAGIC


def quick_headline(path: Path) -> tuple[dict[str, str], FlightHeadline, bool]:
    """About, headline, and whether the recording has its end: from its index where there is one.

    Nothing between is read: damage there shows in whatever reads the messages.

    Raises:
        NoRecording, OSError: see :class:`Recording`.
    """
    from mcap.reader import make_reader

    from groundstation.recording.strict_reader import DAMAGE

    found: dict[str, dict[str, str]] = {}
    with suppress(*DAMAGE, OSError), path.open("rb") as file:  # the last of a file of a few bytes
        found = {
            metadata.name: dict(metadata.metadata) for metadata in make_reader(file).iter_metadata()
        }
    if "about" in found and "result" in found:
        return found["about"], from_texts(found["result"]), True
    recording = Recording(path)
    headline = recording.headline()
    return recording.about, headline, recording.whole


def from_texts(result: dict[str, str]) -> FlightHeadline:
    """The headline as the recording has it."""
    return msgspec.convert(
        {
            key: None if value == "" and key.endswith("_m") else value
            for key, value in result.items()
        },
        FlightHeadline,
        strict=False,
    )


def flatten(value: Any, name: str = "") -> dict[str, Any]:
    """Return the leaves of nested objects and arrays by dotted names, such as ``rates_rad_s.x``."""
    if isinstance(value, dict):
        parts = value.items()
    elif isinstance(value, list):
        parts = dict(enumerate(value)).items()
    else:
        return {name: value}
    leaves: dict[str, Any] = {}
    for key, part in parts:
        dotted = f"{name}.{key}" if name else str(key)
        if isinstance(part, dict | list):
            leaves |= flatten(part, dotted)
        else:
            leaves[dotted] = part
    return leaves


def tabulate(
    entries: Iterable[Entry], topics: Collection[str]
) -> "dict[str, dict[str, NDArray[Any]]]":
    """Return those of ``entries`` on each of ``topics`` as columns of equal length, named as
    ``rates_rad_s.x``.

    Numbers are floats, what is left out NaN; columns of texts are of objects. A column that comes
    later has its place.
    """
    import numpy as np  # the recorder needs none

    def column(values: list[Any]) -> "NDArray[Any]":
        # None is NaN as a float.
        return np.array(values, dtype=object if str in set(map(type, values)) else float)

    rows: dict[str, list[dict[str, Any]]] = {topic: [] for topic in topics}
    names: dict[str, dict[str, None]] = {topic: {} for topic in topics}
    for entry in entries:
        if entry.topic in rows:
            row = flatten(entry.value())
            names[entry.topic].update(dict.fromkeys(row))
            rows[entry.topic].append(row)
    return {
        topic: {name: column([row.get(name) for row in rows[topic]]) for name in names[topic]}
        for topic in topics
    }
