"""MAVLink on the wire: bytes to messages, commands to frames, signatures, and the status that messages tell. Sans-IO.

    byte 0      0xFD (MAVLink 2; 0xFE is MAVLink 1, which has a header of 6 bytes and no flags)
    byte 1      length n of the payload
    byte 2, 3   flags: incompatible (bit 0: 13 bytes of signature follow the frame), compatible
    byte 4      sequence number of the sender
    byte 5, 6   system and component of the sender
    byte 7..9   message number, little-endian
    10 .. 9+n   payload, its trailing zeros left out
    last 2      CRC-16/MCRF4XX over byte 1 .. 9+n and one more byte that the message's definition gives

Messages are those of the dialect ardupilotmega: with ``common``, all of which it has, some of ArduPilot's have no name.
What a message holds is read from pymavlink's definition when the message is first met: importing the dialect makes 301
classes at once, which takes longer than a whole flight of seconds in simulation. The names are pymavlink's, too. In the
payload fields stand by the size of their types, largest first, the later ones (extensions) behind them in their own
order; zeros at the end are left out.
Source: mavlink.io/en/guide/serialization.html; the same bytes as pymavlink 2.4.50.

Signing: which frames are ours to believe, and the proof that a frame is from us. A signed frame has bit 0 of its
incompatible flags set and 13 more bytes behind the checksum:

    byte 0       link id
    byte 1..6    time stamp: units of 10 µs since 2015-01-01 UTC, little-endian; it grows with every frame
    byte 7..12   first 6 bytes of SHA-256 over the key and the whole frame up to here

Source: mavlink.io/en/guide/message_signing.html; the same bytes as pymavlink 2.4.50.
"""

import math
import re
import struct
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from hashlib import sha256
from hmac import compare_digest
from operator import itemgetter
from pkgutil import get_data
from typing import Any, ClassVar, NamedTuple, TypeAlias

import msgspec
from fastcrc.crc16 import mcrf4xx

from links.text import printable

KEY_BYTES = 32
SIGNED = 0x01
"""Bit of the incompatible flags of a frame that is signed."""
SIGNATURE_BYTES = 13
TICKS_PER_S = 100_000
"""Units of the time stamp in a second."""
MINUTE = 60 * TICKS_PER_S
"""A sender that nobody has heard yet may be this far behind our own time stamp."""

_RADIO_STATUS = 109  # telemetry radios put it in by themselves, and know no key


class Signer:
    """Signs what leaves and judges what arrives, with one key."""

    def __init__(self, key: bytes, clock: Callable[[], int], link_id: int = 0) -> None:
        """``clock()`` tells the time in units of 10 µs since 2015-01-01 UTC.

        Raises:
            ValueError: the key has not 32 bytes.
        """
        if len(key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(key)}")
        self._key = key
        self._clock = clock
        self._link = bytes([link_id])
        self._streams: dict[bytes, int] = {}
        self.stamp = 0
        """The newest time stamp used or believed."""

    def sign(self, frame: bytes, crc_extra: int) -> bytes:
        """The unsigned MAVLink 2 ``frame``, signed; its definition's ``crc_extra`` makes the checksum anew."""
        body = frame[:2] + bytes([frame[2] | SIGNED]) + frame[3:-2]
        body += mcrf4xx(body[1:] + bytes([crc_extra])).to_bytes(2, "little")
        self.stamp = max(self.stamp + 1, self._clock())
        body += self._link + self.stamp.to_bytes(6, "little")
        return body + self._proof(body)

    def refuse(self, frame: bytes) -> str:
        """Why the whole ``frame``, whose checksum is right, is not believed: unsigned, bad_signature or replayed.

        Empty where it is believed; its time stamp then can't be used again.
        """
        if frame[0] != _V2 or not frame[2] & SIGNED:
            radio = frame[0] == _V2 and int.from_bytes(frame[7:10], "little") == _RADIO_STATUS
            return "" if radio else "unsigned"
        if not compare_digest(self._proof(frame[:-6]), frame[-6:]):
            return "bad_signature"
        stream, stamp = frame[5:7] + frame[-13:-12], int.from_bytes(frame[-12:-6], "little")
        newest = self._streams.get(stream)
        if newest is None:
            newest = max(self.stamp, self._clock()) - MINUTE - 1
        if stamp <= newest:
            return "replayed"
        self._streams[stream] = stamp
        self.stamp = max(self.stamp, stamp)
        return ""

    def _proof(self, body: bytes) -> bytes:
        return sha256(self._key + body).digest()[:6]


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

    def get_srcSystem(self) -> int:  # noqa: N802  # pymavlink's name  # pymavlink's names
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


def _part(source: bytes, begin: str, end: str) -> str:
    """The text from where ``begin`` is first to the next ``end``."""
    start = source.index(begin.encode())
    return source[start : source.index(end.encode(), start)].decode()


def _read_definition(source: bytes, name: str) -> tuple[list[_Field], list[int], int]:
    """What pymavlink's class of a message says: its fields, their order on the wire, and its byte of the checksum."""
    text = _part(source, f"class MAVLink_{name.lower()}_message(MAVLink_message):", "def pack(")

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


def _make_class(number: int, name: str, source: bytes) -> type[MavlinkMessage]:
    """The class of one message of pymavlink's ``source``."""
    fields, order, extra = _read_definition(source, name)
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
        self._kinds: dict[int, type[MavlinkMessage] | None] = {}

    @cached_property
    def _source(self) -> bytes:
        source = get_data("pymavlink.dialects.v20", "ardupilotmega.py")
        assert source is not None, "pymavlink is installed as files"
        return source  # two megabytes, of which little becomes text

    @cached_property
    def _numbers(self) -> dict[str, int]:
        text = _part(self._source, "\nMAVLINK_MSG_ID_", "\nclass ")
        found = re.findall(r"^MAVLINK_MSG_ID_(\w+) = (\d+)$", text, re.MULTILINE)
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
        found: Any = None
        with suppress(KeyError):
            if name.startswith("MAVLINK_MSG_ID_"):
                found = self.number(name.removeprefix("MAVLINK_MSG_ID_"))
            elif name.startswith("MAVLink_"):
                found = self.kind(self.number(name.removeprefix("MAVLink_").removesuffix("_message").upper()))
        if found is None:
            raise AttributeError(name)
        setattr(self, name, found)  # so that each is looked for once
        return found


DIALECT = MavlinkDialect()


Message: TypeAlias = Any
"""A :class:`links.mavlink.protocol.codec.MavlinkMessage`, whose fields no type checker knows."""

PX4 = 12
"""HEARTBEAT.autopilot of PX4 (MAV_AUTOPILOT_PX4)."""
ARDUPILOT = 3
"""HEARTBEAT.autopilot of ArduPilot (MAV_AUTOPILOT_ARDUPILOTMEGA)."""
INVALID = 8
"""HEARTBEAT.autopilot of what is none (MAV_AUTOPILOT_INVALID)."""
GROUND_STATION = 6
"""HEARTBEAT.type of a ground station (MAV_TYPE_GCS)."""
ARMED = 128
"""Bit of HEARTBEAT.base_mode that says that the motors are on (MAV_MODE_FLAG_SAFETY_ARMED)."""

NAV_LAND = 21
DO_SET_MODE = 176
ARM_DISARM = 400
SET_MESSAGE_INTERVAL = 511
REQUEST_MESSAGE = 512
FORCE = 21196.0
"""Second parameter of ARM_DISARM that overrides every check: with it, disarming stops the motors in the air."""

_V2, _V1 = 0xFD, 0xFE
_ACTIVE = 4
_RESULTS = {
    0: "ACCEPTED", 1: "TEMPORARILY_REJECTED", 2: "DENIED", 3: "UNSUPPORTED", 4: "FAILED", 5: "IN_PROGRESS",
    7: "COMMAND_LONG_ONLY", 8: "COMMAND_INT_ONLY",
}  # fmt: skip
_HEADER = struct.Struct("<BBBBBBBHB")
_ATTITUDE_TARGET = struct.Struct("<BBBBBBBHB I4f3ffBBB")
_ATTITUDE_TARGET_ID, _ATTITUDE_TARGET_CRC_EXTRA = 82, 49
_MAGIC = re.compile(b"[%c%c]" % (_V1, _V2))
_WHOLE = ("unknown", "unsigned", "bad_signature", "replayed")
_IGNORE_ATTITUDE = 128


def frame_end(data: bytes, start: int) -> int:
    """Where the frame that begins at ``start`` ends.

    0 where no frame can begin there; more than ``len(data)`` where its end has not arrived.
    """
    magic = data[start]
    if magic == _V2:
        if start + 3 > len(data):
            return len(data) + 1
        flags = data[start + 2]
        if flags & ~SIGNED:  # a later revision of the protocol, whose length nobody here can tell
            return 0
        return start + 12 + data[start + 1] + (SIGNATURE_BYTES if flags else 0)
    if magic == _V1:
        return start + 8 + data[start + 1] if start + 1 < len(data) else len(data) + 1
    return 0


class MavlinkCodec:
    """One end of a MAVLink connection. No bytes make it raise; what it can't use is counted in ``dropped``."""

    def __init__(self, system_id: int, component_id: int) -> None:
        """Speak as ``system_id`` / ``component_id`` (1..255)."""
        self.dialect: Any = DIALECT
        """The message classes, by pymavlink's names."""
        self.system_id = system_id
        self.component_id = component_id
        self.received = 0
        """Messages understood."""
        self.dropped: Counter[str] = Counter()
        """By reason: garbage (bytes that begin no frame), truncated, bad_crc, malformed, unknown (frames).

        With a signer also unsigned, bad_signature, replayed."""
        self.signer: Signer | None = None
        """Signs what is packed and judges what is read, where there is a key."""
        self._sequence = 0
        self._pending = b""

    def feed(self, data: bytes) -> list[Message]:
        """The messages that ``data``, the next bytes of a stream cut anywhere, brings to an end."""
        data = self._pending + data
        messages, used = self._scan(data, resynchronise=True)
        self._pending = data[used:]  # never more than one frame: at most 280 bytes
        return messages

    def forget(self) -> None:
        """The stream has ended: what of a frame has come of it will not be completed."""
        self._pending = b""

    def feed_datagram(self, data: bytes) -> list[Message]:
        """The messages in one datagram, which holds whole frames; what follows garbage in it is dropped."""
        messages, used = self._scan(data, resynchronise=False)
        if used < len(data):
            if frame_end(data, used):
                self.dropped["truncated"] += 1
            else:
                self.dropped["garbage"] += len(data) - used
        return messages

    def _scan(self, data: bytes, resynchronise: bool) -> tuple[list[Message], int]:
        """The messages in ``data`` and the number of bytes done with."""
        messages: list[Message] = []
        start, size = 0, len(data)
        while start < size:
            end = frame_end(data, start)
            if end > size:
                break
            if end:
                message, fault = self.decode(data[start:end])
                if message is not None:
                    messages.append(message)
                # In a stream, a checksum that fails means that no frame began here; a true one may begin inside.
                if not (resynchronise and fault) or fault in _WHOLE:
                    start = end
                    continue
            elif not resynchronise:
                break
            else:
                begins = _MAGIC.search(data, start + 1)
                next_start = begins.start() if begins else size
                self.dropped["garbage"] += next_start - start
                start = next_start
                continue
            start += 1
        return messages, start

    def decode(self, frame: bytes) -> tuple[Message | None, str]:
        """The message in one whole frame, or None and the reason, which is counted."""
        message, fault = _read(frame)
        if not fault and self.signer is not None:
            fault = self.signer.refuse(frame)
        if not fault and message is None:
            fault = "unknown"
        if fault:
            self.dropped[fault] += 1
            return None, fault
        self.received += 1
        return message, ""

    def _next(self) -> int:
        """The sequence number of the next frame."""
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFF
        return sequence

    def pack(self, message: Message) -> bytes:
        """The frame of any message, with the next sequence number.

        Raises:
            struct.error: a whole number does not fit its field, or an array is too short.
            OverflowError: a number is larger than a 32-bit float can hold.
        """
        payload, number, extra = message.pack_payload(), message.msg_number, message.crc_extra
        header = _HEADER.pack(
            _V2, len(payload), 0, 0, self._next(), self.system_id, self.component_id, number & 0xFFFF, number >> 16
        )
        body = header + payload
        frame = body + mcrf4xx(body[1:] + bytes([extra])).to_bytes(2, "little")
        return frame if self.signer is None else self.signer.sign(frame, extra)

    def heartbeat(self) -> bytes:
        """HEARTBEAT of a ground station; due once a second."""
        d = self.dialect
        return self.pack(d.MAVLink_heartbeat_message(GROUND_STATION, INVALID, 0, 0, _ACTIVE, 3))

    def attitude_target(
        self, time_s: float, system: int, component: int, thrust: float, rates_rad_s: tuple[float, float, float]
    ) -> bytes:
        """SET_ATTITUDE_TARGET to ``system`` / ``component``: ``thrust`` 0..1, body rates FRD [rad/s], attitude ignored.

        ``time_s`` [s] goes out as time_boot_ms modulo 2³². Packed by hand, as it leaves with every command:
        the same bytes in less time.

        Raises:
            OverflowError: a number is larger than a 32-bit float can hold.
        """
        body = _ATTITUDE_TARGET.pack(
            _V2, 39, 0, 0, self._next(), self.system_id, self.component_id, _ATTITUDE_TARGET_ID, 0,
            int(time_s * 1e3) & 0xFFFFFFFF, 1.0, 0.0, 0.0, 0.0, *rates_rad_s, thrust,
            system, component, _IGNORE_ATTITUDE,
        )  # fmt: skip
        frame = body + mcrf4xx(body[1:] + bytes([_ATTITUDE_TARGET_CRC_EXTRA])).to_bytes(2, "little")
        return frame if self.signer is None else self.signer.sign(frame, _ATTITUDE_TARGET_CRC_EXTRA)

    def command(self, system: int, component: int, command: int, *params: float, confirmation: int = 0) -> bytes:
        """COMMAND_LONG with up to seven parameters, the rest 0; ``confirmation`` counts its repetitions."""
        seven = (*params, *(0.0,) * (7 - len(params)))
        return self.pack(self.dialect.MAVLink_command_long_message(system, component, command, confirmation, *seven))

    def parameter_request(self, system: int, component: int, name: str) -> bytes:
        """PARAM_REQUEST_READ of the parameter ``name`` (at most 16 letters)."""
        return self.pack(self.dialect.MAVLink_param_request_read_message(system, component, name.encode("ascii"), -1))

    def parameter_set(self, system: int, component: int, name: str, number: float, kind: int) -> bytes:
        """PARAM_SET of ``name`` to ``number``, already in the autopilot's encoding of ``kind`` (MAV_PARAM_TYPE)."""
        return self.pack(self.dialect.MAVLink_param_set_message(system, component, name.encode("ascii"), number, kind))

    def timesync_question(self, ours_ns: int) -> bytes:
        """TIMESYNC that asks for the other's time, with our own [ns]."""
        return self.pack(self.dialect.MAVLink_timesync_message(0, ours_ns))

    def timesync_reply(self, request: Message, time_s: float) -> bytes:
        """TIMESYNC that answers ``request`` with our clock ``time_s`` [s]."""
        ours_ns = int(time_s * 1e9) or 1  # 0 would be a question again, and two clocks at 0 would never stop asking
        return self.pack(self.dialect.MAVLink_timesync_message(ours_ns, request.ts1))

    def message_number(self, name: str) -> int:
        """The number of the message called ``name``, such as ODOMETRY."""
        return int(self.dialect.number(name))

    def result_name(self, result: int) -> str:
        """The name of a COMMAND_ACK.result, such as MAV_RESULT_DENIED."""
        name = _RESULTS.get(result)
        return f"MAV_RESULT_{name}" if name is not None else f"MAV_RESULT {result}"


def _read(frame: bytes) -> tuple[MavlinkMessage | None, str]:
    """The message in one whole frame, None where the dialect has no such one; and what is wrong with the frame."""
    if frame[0] == _V2:
        head, tail = 10, 2 + SIGNATURE_BYTES if frame[2] & SIGNED else 2
        number = frame[7] | frame[8] << 8 | frame[9] << 16 if len(frame) >= head + tail else -1
    else:
        head, tail = 6, 2
        number = frame[5] if len(frame) >= head + tail else -1
    if number < 0 or frame[0] not in (_V1, _V2) or frame[1] != len(frame) - head - tail:
        return None, "malformed"
    kind = DIALECT.kind(number)
    if kind is None:
        return None, ""
    end = len(frame) - tail
    if mcrf4xx(frame[1:end] + kind.crc_byte) != frame[end] | frame[end + 1] << 8:
        return None, "bad_crc"
    wire = kind.wire
    payload, size = frame[head:end], wire.size
    if len(payload) != size:
        payload = payload[:size].ljust(size, b"\0")  # zeros at the end are left out; what was added later is not read
    return kind(*kind.from_wire(wire.unpack(payload)), frame), ""


LOCAL_FRD, BODY_FRD = 20, 12
"""MAV_FRAME."""
VISION = 2
"""MAV_ESTIMATOR_TYPE_VISION."""
BEST_QUALITY = 100

_UNKNOWN = (math.nan,) * 3
_DIAGONAL = (0, 6, 11, 15, 18, 20)


class Odometry(NamedTuple):
    """What is told."""

    time_s: float
    """When it was true, on the clock that answers TIMESYNC [s]."""
    position: tuple[float, float, float]
    """[m], world NED or a frame that is turned about down."""
    attitude: tuple[float, float, float, float]
    """Unit quaternion w, x, y, z, body FRD to that frame."""
    velocity: tuple[float, float, float]
    """[m/s], body FRD."""
    measured_velocity: bool
    """False where it is only the difference of positions, which the autopilot's filter knows already."""
    resets: int
    """Changes whenever the frame moved; only the lowest byte leaves."""
    noise_m: float
    """1σ of the position per axis [m]."""
    noise_rad: float
    """1σ of the attitude per axis [rad]."""
    noise_m_s: float
    """1σ of the velocity per axis [m/s]."""


def odometry(codec: MavlinkCodec, kind: int, told: Odometry) -> bytes:
    """The frame for the own estimator of an autopilot of ``kind`` (HEARTBEAT.autopilot): ODOMETRY, one form for both.

    PX4 fuses frames NED, ENU, LOCAL_FRD and LOCAL_FLU, but turns no quaternion of the last; and only estimator
    types UNKNOWN, VISION and VIO: MOCAP goes where its EKF2 does not look, NAIVE loses the covariance. It leaves
    out a velocity that is NaN, and turns stamps into its own clock by TIMESYNC, which it asks of us.
    ArduPilot takes LOCAL_FRD with BODY_FRD only, does not look at the type, and always uses the velocity: NaN in
    it would reach the filter. It finds its own clock from the arrivals.
    Body rates are NaN: nobody needs them, and some versions of ArduPilot take finite ones for a message of
    another kind.
    Source: PX4 v1.15 mavlink_receiver.cpp, handle_message_odometry; ArduPilot 4.6-dev GCS_Common.cpp,
    handle_odometry; mavlink common.xml (pymavlink 2.4.50).
    """
    velocity = told.velocity if kind == ARDUPILOT or told.measured_velocity else _UNKNOWN
    message = codec.dialect.MAVLink_odometry_message(
        max(round(told.time_s * 1e6), 0),
        LOCAL_FRD,
        BODY_FRD,
        *told.position,
        told.attitude,
        *velocity,
        *_UNKNOWN,
        _covariance(told.noise_m, told.noise_rad),
        _covariance(told.noise_m_s, math.nan),
        told.resets & 0xFF,
        VISION,
        BEST_QUALITY,
    )
    return codec.pack(message)


def _covariance(first: float, second: float) -> list[float]:
    """The upper triangle of a 6 x 6 matrix: squares of ``first`` three times, then of ``second``, on its diagonal."""
    triangle = [0.0] * 21
    for place, sigma in zip(_DIAGONAL, (first,) * 3 + (second,) * 3, strict=True):
        triangle[place] = sigma * sigma
    return triangle


PX4_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
"""Main mode, bits 16 to 23 of HEARTBEAT.custom_mode."""
PX4_AUTO = {2: "TAKEOFF", 3: "LOITER", 4: "MISSION", 5: "RTL", 6: "LAND", 9: "PRECLAND"}
"""Sub mode of AUTO, bits 24 to 31."""
ARDUPILOT_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL", 7: "CIRCLE", 9: "LAND",
    13: "SPORT", 15: "AUTOTUNE", 16: "POSHOLD", 17: "BRAKE", 18: "THROW", 20: "GUIDED_NOGPS", 21: "SMART_RTL",
}  # fmt: skip
"""HEARTBEAT.custom_mode of Copter."""
ESTIMATE = {PX4: "ESTIMATOR_STATUS", ARDUPILOT: "EKF_STATUS_REPORT"}
"""The message that tells what its estimator knows; the flags of both mean the same but for the last."""
ESTIMATE_HZ = 2.0
"""How often it is asked for."""
ESTIMATE_OLD_S = 2.5
"""What it told so long ago does not count [s]; unasked, autopilots tell once a second."""
_SPEED, _PLACE, _HEIGHT = 2 | 4, 8 | 16, 32 | 64
_CONSTANT, _LAST = 128, 1024
"""It believes that it stands still; PX4: GPS jumps, ArduPilot: not initialised yet."""
FOLLOWING = ("OFFBOARD", "GUIDED", "GUIDED_NOGPS")
"""Modes in which an autopilot follows set-points."""

_PREARM = 0x10000000
"""MAV_SYS_STATUS_PREARM_CHECK."""


class Vitals:
    """The newest of each. Times are on the event loop's clock [s]."""

    def __init__(self) -> None:
        self.mode = ""
        """Its mode's name; empty before the first heartbeat, and where nobody knows its modes."""
        self.mode_s = -math.inf
        """When it was told."""
        self.battery_v: float | None = None
        self.battery_share: float | None = None
        self.ready: bool | None = None
        """Whether its own pre-arm checks pass; None where it does not tell, or can't know before set-points come."""
        self._kind = -1
        self._knows = False
        self._knows_s = -math.inf

    def hear(self, message: Message, now_s: float) -> None:
        """Take one message of the autopilot."""
        match message.get_type():
            case "HEARTBEAT":
                self._kind = message.autopilot
                self.mode, self.mode_s = mode_name(self._kind, message.custom_mode), now_s
            case "SYS_STATUS":
                volts, percent = message.voltage_battery, message.battery_remaining
                self.battery_v = None if volts in (0, 0xFFFF) else 1e-3 * volts
                self.battery_share = 0.01 * percent if 0 <= percent <= 100 else None
                self.ready = self._ready(
                    message.onboard_control_sensors_enabled, message.onboard_control_sensors_health
                )
            case "ESTIMATOR_STATUS" | "EKF_STATUS_REPORT":
                self._knows, self._knows_s = knows_itself(message.flags), now_s

    def could_land(self, now_s: float) -> bool:
        """Whether it has told of late that it knows where it is: then it comes down better by itself than unseen."""
        return self._knows and now_s - self._knows_s < ESTIMATE_OLD_S

    def _ready(self, enabled: int, health: int) -> bool | None:
        """PX4 1.16 tells by health alone, and in OFFBOARD it lacks the set-points that come only as it is armed."""
        passes = bool(health & _PREARM)
        if self._kind == PX4:
            return None if not passes and self.mode in (*FOLLOWING, "") else passes
        return passes if enabled & _PREARM else None

    def foreign(self, since_s: float) -> str:
        """The mode that it is in since ``since_s``, where it follows no set-points there; else empty."""
        return self.mode if self.mode_s >= since_s and self.mode not in (*FOLLOWING, "") else ""


def knows_itself(flags: int) -> bool:
    """Whether ESTIMATOR_STATUS.flags or EKF_STATUS_REPORT.flags tell of speed, height and some horizontal position."""
    known = flags & _SPEED == _SPEED and bool(flags & _PLACE) and bool(flags & _HEIGHT)
    return known and not flags & (_CONSTANT | _LAST)


def mode_name(autopilot: int, custom_mode: int) -> str:
    """What ``custom_mode`` of HEARTBEAT is called on ``autopilot`` (MAV_AUTOPILOT); empty on any other."""
    if autopilot == ARDUPILOT:
        return ARDUPILOT_MODES.get(custom_mode, f"mode {custom_mode}")
    if autopilot != PX4:
        return ""
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    name = PX4_MODES.get(main, f"mode {main}" if main else "")  # one that tells no mode is believed to follow
    return f"{name}.{PX4_AUTO.get(sub, sub)}" if name == "AUTO" else name


_WARNING = 4
"""MAV_SEVERITY_WARNING; lower is graver."""


class Words:
    """What the autopilot said of late (STATUSTEXT), long texts put together again, and only what is fit to be shown."""

    def __init__(self) -> None:
        self._texts: deque[tuple[int, int, str]] = deque(maxlen=20)

    def hear(self, message: Message) -> None:
        """Take one STATUSTEXT."""
        number, severity, text = message.id, message.severity, message.text
        if number and message.chunk_seq and self._texts and self._texts[-1][0] == number:
            text = self._texts.pop()[2] + text
        self._texts.append((number, severity, text))

    @property
    def newest(self) -> str:
        """The newest text, or an empty string."""
        return printable(self._texts[-1][2].strip()) if self._texts else ""

    def complaints(self) -> str:
        """The last warnings and errors, newest last, each once; an empty string where there are none."""
        texts = [printable(text.strip()) for _, severity, text in self._texts if severity <= _WARNING]
        return "; ".join(f"“{text}”" for text in list(dict.fromkeys(texts))[-3:])


STALE_NEWS_S = 0.5
"""A HEARTBEAT may have left before the arming that it denies: it is not believed for this long after it [s]."""


class HeartbeatMonitor:
    """The one autopilot at the other end. Times are on the event loop's clock [s]."""

    def __init__(self, timeout_s: float) -> None:
        """Not heard yet; silent where it is not heard for longer than ``timeout_s`` [s]."""
        self.kind: int | None = None
        """Its newest HEARTBEAT.autopilot, of when it was heard first or again; None before the first."""
        self.vehicle = 0
        """Its HEARTBEAT.type of then."""
        self.address: Any = None
        """Where it sends from; None where that is not known, or goes without saying."""
        self._timeout = timeout_s
        self._heard_s = 0.0
        self._armed_s: float | None = None

    @property
    def armed(self) -> bool:
        """Whether its motors are believed to be on."""
        return self._armed_s is not None

    def believe_armed(self, since_s: float | None) -> None:
        """Believe that the motors are on since then, or off (None), until a heartbeat tells."""
        self._armed_s = since_s

    def silence_s(self, now_s: float) -> float:
        """Time since its newest heartbeat [s]; infinite where its wire was lost after it."""
        return now_s - self._heard_s

    def is_silent(self, now_s: float) -> bool:
        """Whether its heartbeats have stayed away for too long."""
        return self.silence_s(now_s) > self._timeout

    def lose(self) -> None:
        """Its wire was lost: whatever it says next may be another's, or its own after a restart."""
        self.address = None
        self._armed_s = None
        self._heard_s = -math.inf

    def beat(self, heartbeat: Message, now_s: float) -> bool:
        """Take that it lives; returns whether it was silent before, or not heard at all."""
        news = self.kind is None or self.is_silent(now_s)
        self._heard_s = now_s
        if news:
            self.kind, self.vehicle = heartbeat.autopilot, heartbeat.type
        return news

    def take_armed(self, heartbeat: Message, now_s: float) -> None:
        """Take whether its motors are on."""
        if heartbeat.base_mode & ARMED:
            if self._armed_s is None:
                self._armed_s = now_s
        elif self._armed_s is not None and now_s - self._armed_s > STALE_NEWS_S:
            self._armed_s = None
