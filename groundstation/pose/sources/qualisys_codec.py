"""Qualisys Track Manager's real-time protocol (RTP), the part with rigid bodies. Sans-IO; little-endian, packed.

    u32 size of the packet, these 8 bytes included | u32 type: 0 error, 1 command, 2 XML, 3 data, 4 no data, 6 event

    data: i64 microseconds | u32 frame | u32 n, then n components: u32 size, u32 type (5: 6D bodies), content
    6D:   i32 n | i16 drop rate | i16 out-of-sync rate, then n × (f32[3] position [mm], f32[9] rotation)

The rotation is a matrix, body to lab, column by column; a body that is not seen is full of NaN. The bodies stand in
the order in which the parameters (XML) name them. The connection itself is qtm-rt's work: it asks and pairs answers.
Source: qtm-rt 3.1.0 (Qualisys' own package, MIT); the order of the matrix from readers of Qualisys' C++ SDK.
"""

import math
import struct
from collections.abc import Iterable, Sequence
from enum import IntEnum

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.sources.intake import Intake


class RtPacket(IntEnum):
    """Packet types of the RT protocol."""

    ERROR = 0
    COMMAND = 1
    XML = 2
    DATA = 3
    NO_DATA = 4
    EVENT = 6


# Packet types that a server sends, for scripts that play one.
ERROR = RtPacket.ERROR
COMMAND = RtPacket.COMMAND
XML = RtPacket.XML
LAST_TYPE = 9
"""Highest packet type of the protocol."""
MAX_PACKET = 1 << 20
"""A longer packet is none: bodies and parameters need a few kilobytes."""
MAX_BODIES = 512
"""No room has more."""

_HEADER = struct.Struct("<II")
_DATA = struct.Struct("<qII")
_SIX_D, _SIX_D_TYPE = struct.Struct("<ihh"), 5
_BODY = struct.Struct("<12f")
_ORTHOGONAL = 1e-3
"""Largest difference of a rotation matrix from an orthogonal one [-]."""


class Framer:
    """Cuts a stream, however it comes in pieces, into packets; never holds more than one."""

    def __init__(self) -> None:
        self.broken = False
        """True once packets can't be told apart any more: only a new connection helps."""
        self._pending = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The packets, headers included, that ``data`` completes, up to a size or a type that no packet has."""
        packets: list[bytes] = []
        if self.broken:
            return packets
        pending = self._pending
        pending += data
        start = 0
        while len(pending) - start >= _HEADER.size:
            size, kind = _HEADER.unpack_from(pending, start)
            if not _HEADER.size <= size <= MAX_PACKET or kind > LAST_TYPE:
                self.broken = True
                pending.clear()
                return packets
            if len(pending) - start < size:
                break
            packets.append(bytes(pending[start : start + size]))
            start += size
        del pending[:start]
        return packets


def packet_type(packet: bytes) -> int:
    """The type of a whole packet, see :class:`RtPacket`."""
    return int(_HEADER.unpack_from(packet)[1])


def is_sane(packet: bytes) -> bool:
    """Whether the components of a data packet have a size and end within it; other packets are taken as they are."""
    if packet_type(packet) != RtPacket.DATA:
        return True
    _, _, components = _DATA.unpack_from(packet, _HEADER.size)
    at = _HEADER.size + _DATA.size
    while components and at + _HEADER.size <= len(packet):
        size, _ = _HEADER.unpack_from(packet, at)
        if size < _HEADER.size:
            return False
        at += size
        components -= 1
    return components == 0 and at <= len(packet)


def packet(kind: int, content: bytes) -> bytes:
    """One packet."""
    return _HEADER.pack(_HEADER.size + len(content), kind) + content


def text_packet(kind: int, text: str) -> bytes:
    """A packet of text: commands and their answers, XML, errors."""
    return packet(kind, text.encode() + b"\0")


def encode_data(stamp_us: int, frame: int, bodies: Iterable[tuple[Vec3, Quat] | None]) -> bytes:
    """A data packet with 6D bodies (position [m], attitude; None: not seen), for simulators and tests."""
    parts = []
    for body in bodies:
        if body is None:
            parts.append(_BODY.pack(*[math.nan] * 12))
            continue
        (x, y, z), attitude = body
        rows = so3.matrix(attitude)
        columns = [rows[row][column] for column in range(3) for row in range(3)]
        parts.append(_BODY.pack(1e3 * x, 1e3 * y, 1e3 * z, *columns))
    content = _SIX_D.pack(len(parts), 0, 0) + b"".join(parts)
    component = _HEADER.pack(_HEADER.size + len(content), _SIX_D_TYPE) + content
    return packet(RtPacket.DATA, _DATA.pack(stamp_us, frame, 1) + component)


def parameters_xml(names: Iterable[str]) -> str:
    """The 6D parameters that QTM answers with, as far as they are read here, for simulators and tests."""
    from xml.sax.saxutils import escape

    bodies = "".join(f"<Body><Name>{escape(name)}</Name><Enabled>true</Enabled></Body>" for name in names)
    return f"<QTM_Parameters_Ver_1.25><The_6D><Bodies>{bodies}</Bodies></The_6D></QTM_Parameters_Ver_1.25>"


def body_names(xml: bytes) -> tuple[str, ...]:
    """The names of the bodies in QTM's answer to ``getparameters 6d``, in the order of the stream.

    Raises:
        ValueError: it is not the XML that QTM sends.
    """
    from xml.etree import ElementTree

    if len(xml) > MAX_PACKET or b"<!" in xml:  # QTM sends no document types, and entities are a way to fill a memory
        raise ValueError("the parameters are longer than QTM's, or are no plain XML")
    try:
        root = ElementTree.fromstring(xml.rstrip(b"\0"))  # noqa: S314  # no entities, bounded: just checked
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(f"the parameters are no XML: {error}") from None
    return tuple((body.findtext("Name") or "").strip() for body in root.iterfind("The_6D//Body"))


def decode_bodies(content: bytes) -> tuple[float, list[tuple[float, ...]]] | str:
    """Time stamp [s] and the twelve numbers of each body in the content of a data packet; or why there is none."""
    try:
        stamp_us, _, components = _DATA.unpack_from(content)
        at = _DATA.size
        for _ in range(components):
            size, kind = _HEADER.unpack_from(content, at)
            if kind == _SIX_D_TYPE:
                count, _, _ = _SIX_D.unpack_from(content, at + _HEADER.size)
                if not 0 <= count <= MAX_BODIES:
                    return "absurd"
                begin = at + _HEADER.size + _SIX_D.size
                return stamp_us * 1e-6, [_BODY.unpack_from(content, begin + i * _BODY.size) for i in range(count)]
            if size < _HEADER.size:
                return "malformed"
            at += size
    except struct.error:
        return "truncated"
    return "no_bodies"


class QualisysReader:
    """Poses of one body out of data packets: implements :class:`groundstation.pose.sources.intake.DatagramReader`."""

    def __init__(self, name: str, intake: Intake) -> None:
        """Look for the body ``name``; :attr:`names` must be told."""
        self.names: tuple[str, ...] = ()
        """The bodies of the stream, in their order."""
        self.other_bodies = False
        """True where the newest frame had more or fewer of them."""
        self._name = name
        self._intake = intake

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now."""
        return self._intake.status

    def drop(self, reason: str) -> None:
        """Count what the connection could not use."""
        self._intake.drop(reason)

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The pose of our body in the content of one data packet, or nothing."""
        found = decode_bodies(datagram)
        pose = self._intake.drop(found) if isinstance(found, str) else self._pose(*found, arrival_s)
        return () if pose is None else (pose,)

    def _pose(self, stamp_s: float, bodies: list[tuple[float, ...]], arrival_s: float) -> Pose | None:
        self._intake.mark_alive(arrival_s)
        self.other_bodies = len(bodies) != len(self.names)
        if self.other_bodies:
            return self._intake.drop("other_bodies")  # somebody changed them: whose pose is whose?
        if self._intake.others is not None:
            for name, (x, y, z, *_) in zip(self.names, bodies, strict=True):
                if name in self._intake.others and not math.isnan(x):
                    self._intake.other(name, arrival_s, (x * 1e-3, y * 1e-3, z * 1e-3))
        own = self._intake.choose([body for name, body in zip(self.names, bodies, strict=True) if name == self._name])
        if own is None:
            return None
        x, y, z, *m = own
        if all(map(math.isnan, (x, y, z))):
            return self._intake.drop("not_tracked")
        if not math.isfinite(x + y + z + sum(m)):
            return self._intake.drop("not_finite")
        rows = ((m[0], m[3], m[6]), (m[1], m[4], m[7]), (m[2], m[5], m[8]))
        if not _is_rotation(rows):
            return self._intake.drop("not_unit")
        attitude = so3.normalize(so3.from_matrix(rows))
        return self._intake.pose(stamp_s, arrival_s, (x * 1e-3, y * 1e-3, z * 1e-3), attitude)


def _is_rotation(rows: tuple[Vec3, Vec3, Vec3]) -> bool:
    """Rows of unit length, the third being the first times the second: so right-handed too."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    if abs(a * a + b * b + c * c - 1.0) > _ORTHOGONAL or abs(d * d + e * e + f * f - 1.0) > _ORTHOGONAL:
        return False
    across = max(abs(b * f - c * e - g), abs(c * d - a * f - h), abs(a * e - b * d - i), abs(a * d + b * e + c * f))
    return across <= _ORTHOGONAL
