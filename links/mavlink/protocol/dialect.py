"""MAVLink's messages as classes, and their payloads. Sans-IO.

What a message holds is read from pymavlink's dialect ardupilotmega, which has all of ``common``, when the message is
first met: importing the dialect makes 301 classes at once, which takes longer than a whole flight of seconds in
simulation. The names are pymavlink's, too.

On the wire the fields stand by the size of their types, largest first, the later ones (extensions) behind them in
their own order; zeros at the end are left out. What the definition says goes into the frame's checksum as one more
byte, made by the same CRC-16/MCRF4XX.
Source: mavlink.io/en/guide/serialization.html; the same bytes as pymavlink 2.4.50.
"""

import re
import struct
from collections.abc import Callable
from functools import cached_property
from operator import itemgetter
from pkgutil import get_data
from typing import Any, ClassVar, NamedTuple

import msgspec

_CODES = {
    "double": "d", "float": "f", "uint64_t": "Q", "int64_t": "q", "uint32_t": "I", "int32_t": "i", "uint16_t": "H",
    "int16_t": "h", "uint8_t": "B", "int8_t": "b", "char": "s",
}  # fmt: skip


class _Field(NamedTuple):
    name: str
    code: str
    """Of :mod:`struct`."""
    length: int
    """Of an array or a text; 0 for a single number."""
    later: bool


class MavlinkMessage(msgspec.Struct, eq=False, gc=False):
    """A message, its fields in the definition's order; an array is a tuple. Text is given as bytes, told as ``str``."""

    msg_number: ClassVar[int]
    msg_name: ClassVar[str]
    crc_extra: ClassVar[int]
    """What the definition adds to the checksum; as a byte, ``crc_byte``."""
    crc_byte: ClassVar[bytes]
    wire: ClassVar[struct.Struct]
    """The payload, nothing left out."""
    to_wire: ClassVar[Any]
    """All values of a message → what ``wire`` packs."""
    from_wire: ClassVar[Any]
    """What ``wire`` unpacked → the fields."""

    def get_type(self) -> str:
        """Its name, such as HEARTBEAT."""
        return self.msg_name

    def get_srcSystem(self) -> int:  # noqa: N802  # pymavlink's names
        """The system that sent it; 0 where it was made here."""
        frame: bytes = self._frame  # type: ignore[attr-defined]
        return (frame[5] if frame[0] == 0xFD else frame[3]) if frame else 0

    def get_srcComponent(self) -> int:  # noqa: N802
        """The component that sent it; 0 where it was made here."""
        frame: bytes = self._frame  # type: ignore[attr-defined]
        return (frame[6] if frame[0] == 0xFD else frame[4]) if frame else 0

    def get_seq(self) -> int:
        """The sender's sequence number; 0 where it was made here."""
        frame: bytes = self._frame  # type: ignore[attr-defined]
        return (frame[4] if frame[0] == 0xFD else frame[2]) if frame else 0

    def get_msgbuf(self) -> bytes:
        """The frame that it came in; empty where it was made here."""
        frame: bytes = self._frame  # type: ignore[attr-defined]
        return frame

    def pack_payload(self) -> bytes:
        """Its fields on the wire, zeros at the end left out, but for the first byte.

        Raises:
            struct.error: a whole number does not fit its field, or an array is too short.
            OverflowError: a number is larger than a 32-bit float can hold.
        """
        whole: bytes = self.wire.pack(*self.to_wire(msgspec.structs.astuple(self)))
        return whole.rstrip(b"\0") or whole[:1]


def _read(source: str, name: str) -> tuple[list[_Field], list[int], int]:
    """What pymavlink's class of a message says: its fields, their order on the wire, and its byte of the checksum."""
    start = source.index(f"class MAVLink_{name.lower()}_message(MAVLink_message):")
    text = source[start : source.index("def pack(", start)]

    def words(key: str) -> list[str]:
        """One of its lists, as it is written."""
        found = re.search(rf"^    {key} = \[(.*)\]$", text, re.MULTILINE)
        assert found is not None, f"pymavlink's {name} has no {key}"
        return [word.strip().strip('"') for word in found[1].split(",")]

    names, kinds, ordered = words("fieldnames"), words("fieldtypes"), words("ordered_fieldnames")
    lengths = dict(zip(ordered, map(int, words("array_lengths")), strict=True))
    # What was added to a message later may be left out: only such a parameter has a default.
    later = set(re.findall(r"(\w+): [^=,]*(?:\[[^\]]*\])? = ", text[text.index("def __init__(") :].split("):", 1)[0]))
    fields = [_Field(key, _CODES[kind], lengths[key], key in later) for key, kind in zip(names, kinds, strict=True)]
    extra = re.search(r"^    crc_extra = (\d+)$", text, re.MULTILINE)
    assert extra is not None, f"pymavlink's {name} has no crc_extra"
    return fields, [names.index(key) for key in ordered], int(extra[1])


def _make_class(number: int, name: str, source: str) -> type[MavlinkMessage]:
    """The class of one message of pymavlink's ``source``."""
    fields, order, extra = _read(source, name)
    wire = struct.Struct("<" + "".join(f"{fields[n].length or ''}{fields[n].code}" for n in order))
    texts = {f.name for f in fields if f.code == "s"}
    made = msgspec.defstruct(
        name,
        [_declare(field) for field in fields] + [("_frame", bytes, b"")],
        bases=(MavlinkMessage,),
        namespace={
            "__doc__": f"MAVLink's {name}.",
            "msg_number": number,
            "msg_name": name,
            "crc_extra": extra,
            "crc_byte": bytes([extra]),
            "wire": wire,
            "to_wire": staticmethod(_flattener(fields, order)),
            "from_wire": staticmethod(_gatherer(fields, order)),
            **{key: property(_text_of(key)) for key in texts},
        },
        eq=False,
        gc=False,
    )
    assert issubclass(made, MavlinkMessage)
    return made


def _declare(field: _Field) -> tuple[str, type, Any] | tuple[str, type]:
    name = f"_{field.name}" if field.code == "s" else field.name
    if not field.later:
        return name, object
    return name, object, b"" if field.code == "s" else (0,) * field.length if field.length else 0


def _text_of(name: str) -> Callable[[Any], str]:
    raw = f"_{name}"

    def text(message: Any) -> str:
        data: bytes = getattr(message, raw)
        return data.split(b"\0", 1)[0].decode("ascii", errors="replace")

    return text


def _flattener(fields: list[_Field], order: list[int]) -> Callable[[Any], tuple[Any, ...]]:
    """What brings a message's values into the order of the wire, arrays laid out."""
    layout = [(n, 0 if fields[n].code == "s" else fields[n].length) for n in order]
    if len(layout) > 1 and not any(length for _, length in layout):
        return itemgetter(*order)

    def flat(values: Any) -> tuple[Any, ...]:
        wire: list[Any] = []
        for n, length in layout:
            if length:
                wire += values[n][:length]
            else:
                wire.append(values[n])
        return tuple(wire)

    return flat


def _gatherer(fields: list[_Field], order: list[int]) -> Callable[[Any], tuple[Any, ...]]:
    """What brings numbers from the wire into the definition's order, those of an array in a tuple."""
    start, places = 0, {}
    for n in order:
        length = 0 if fields[n].code == "s" else fields[n].length
        places[n] = slice(start, start + length) if length else start
        start += length or 1
    if len(fields) == 1:
        return lambda numbers: (numbers[places[0]],)
    return itemgetter(*(places[n] for n in range(len(fields))))


class MavlinkDialect:
    """All messages: ``MAVLink_heartbeat_message`` is a class, ``MAVLINK_MSG_ID_HEARTBEAT`` its number."""

    def __init__(self) -> None:
        """No class is made yet."""
        self._kinds: dict[int, type[MavlinkMessage] | None] = {}

    @cached_property
    def _source(self) -> str:
        source = get_data("pymavlink.dialects.v20", "ardupilotmega.py")
        assert source is not None, "pymavlink is installed as files"
        return source.decode()

    @cached_property
    def _numbers(self) -> dict[str, int]:
        source = self._source
        begin = source.index("\nMAVLINK_MSG_ID_")
        found = re.findall(
            r"^MAVLINK_MSG_ID_(\w+) = (\d+)$", source[begin : source.index("\nclass ", begin)], re.MULTILINE
        )
        return {name: int(number) for name, number in found}

    @cached_property
    def _names(self) -> dict[int, str]:
        return {number: name for name, number in self._numbers.items()}

    def kind(self, number: int) -> type[MavlinkMessage] | None:
        """The class of message ``number``; None where the dialect has none."""
        try:
            return self._kinds[number]
        except KeyError:
            name = self._names.get(number)
            if name is None:
                return None  # not kept: anybody may send any number
            made = self._kinds[number] = _make_class(number, name, self._source)
            return made

    def number(self, name: str) -> int:
        """The number of the message called ``name``, such as ODOMETRY.

        Raises:
            KeyError: the dialect has none.
        """
        return self._numbers[name]

    def __getattr__(self, name: str) -> Any:
        try:
            if name.startswith("MAVLINK_MSG_ID_"):
                return self.number(name.removeprefix("MAVLINK_MSG_ID_"))
            if name.startswith("MAVLink_"):
                return self.kind(self.number(name.removeprefix("MAVLink_").removesuffix("_message").upper()))
        except KeyError:
            pass
        raise AttributeError(name)


DIALECT = MavlinkDialect()
