"""Qualisys Track Manager's real-time protocol (RTP), the part with rigid bodies.

Sans-IO; little-endian, packed.

    u32 size of the packet, these 8 bytes included | u32 type: 0 error, 1 command, 2 XML, 3 data, 4
    no data, 6 event

    data: i64 microseconds | u32 frame | u32 n, then n components: u32 size, u32 type (5: 6D
        bodies), content
    6D:   i32 n | i16 drop rate | i16 out-of-sync rate, then n × (f32[3] position [mm], f32[9]
          rotation)

The rotation is a matrix, body to lab, column by column; a body that is not seen is full of NaN. The
bodies come in the order in which the parameters (XML) name them. qtm-rt keeps the connection: it
asks and pairs answers. Source: qtm-rt 3.1.0 (Qualisys' own package, MIT); the order of the matrix
from readers of Qualisys' C++ SDK.
"""

import math
import struct
from collections.abc import Iterable
from enum import IntEnum

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose, notice
from groundstation.pose.sources.intake import Intake, PoseReader
from links.core import UNIT_TOLERANCE


class RtPacket(IntEnum):
    """Packet types of the RT protocol."""

    ERROR = 0
    COMMAND = 1
    XML = 2
    DATA = 3
    NO_DATA = 4
    EVENT = 6


class RtComponent(IntEnum):
    """Types of a component of a data packet."""

    SIX_D = 5
    """6D bodies."""


LAST_TYPE = 9
"""Highest packet type of the protocol."""
MAX_PACKET = 1 << 20
"""Longest plausible packet [bytes]: bodies and parameters need a few kilobytes."""

_HEADER = struct.Struct("<II")
_DATA = struct.Struct("<qII")
_SIX_D = struct.Struct("<ihh")
_BODY = struct.Struct("<12f")


class Framer:
    """Splits a stream into packets; never buffers more than one."""

    def __init__(self) -> None:
        self.broken = False
        """Whether the boundaries of packets are lost: only a new connection helps."""
        self._pending = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Return the packets that ``data`` completes, up to an implausible size or type."""
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


def read_type(packet: bytes) -> int:
    """Return the type of a packet, mostly a :class:`RtPacket`."""
    _, kind = _HEADER.unpack_from(packet)
    return int(kind)


def split_components(content: bytes) -> list[tuple[int, bytes]]:
    """Return type and content of each component in the content of a data packet.

    Raises:
        ValueError: malformed (a component without a size), truncated.
    """
    try:
        _, _, count = _DATA.unpack_from(content)
        at, found = _DATA.size, list[tuple[int, bytes]]()
        while len(found) < count:
            size, kind = _HEADER.unpack_from(content, at)
            if size < _HEADER.size:
                raise ValueError("malformed")
            if at + size > len(content):
                raise ValueError("truncated")
            found.append((kind, content[at + _HEADER.size : at + size]))
            at += size
    except struct.error:
        raise ValueError("truncated") from None
    return found


def packet(kind: int, content: bytes) -> bytes:
    """Return one packet."""
    return _HEADER.pack(_HEADER.size + len(content), kind) + content


def text_packet(kind: int, text: str) -> bytes:
    """Return a packet of text: commands and their answers, XML, errors."""
    return packet(kind, text.encode() + b"\0")


def encode_data(stamp_us: int, frame: int, bodies: Iterable[tuple[Vec3, Quat] | None]) -> bytes:
    """Return a packet of 6D bodies (position [m], attitude; None: not seen), for simulators."""
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
    component = _HEADER.pack(_HEADER.size + len(content), RtComponent.SIX_D) + content
    return packet(RtPacket.DATA, _DATA.pack(stamp_us, frame, 1) + component)


def parameters_xml(names: Iterable[str]) -> str:
    """Return QTM's 6D parameters as far as they are read here, for simulators and tests."""
    from xml.sax.saxutils import escape

    bodies = "".join(
        f"<Body><Name>{escape(name)}</Name><Enabled>true</Enabled></Body>" for name in names
    )
    six_d = f"<The_6D><Bodies>{bodies}</Bodies></The_6D>"
    return f"<QTM_Parameters_Ver_1.25>{six_d}</QTM_Parameters_Ver_1.25>"


def body_names(xml: bytes) -> tuple[str, ...]:
    """Return the bodies' names in QTM's answer to ``getparameters 6d``, in the stream's order.

    Raises:
        ValueError: it is not the XML that QTM sends.
    """
    from xml.etree import ElementTree

    # QTM sends no document types, and entities are a way to fill a memory.
    if len(xml) > MAX_PACKET or b"<!" in xml:
        raise ValueError(notice("qualisys.no_plain_xml"))
    try:
        root = ElementTree.fromstring(xml.rstrip(b"\0"))  # noqa: S314  # no entities, bounded: just checked
    except (ElementTree.ParseError, LookupError) as error:
        raise ValueError(notice("qualisys.no_xml", why=error)) from None
    return tuple((body.findtext("Name") or "").strip() for body in root.iterfind("The_6D//Body"))


def decode_bodies(content: bytes) -> tuple[float, list[tuple[float, ...]]] | str:
    """Return time stamp [s] and twelve numbers of each body in a data packet, or its fault."""
    try:
        components = dict(split_components(content))
        if RtComponent.SIX_D not in components:
            return "no_bodies"
        six_d = components[RtComponent.SIX_D]
        bodies = list(_BODY.iter_unpack(six_d[_SIX_D.size :]))
        if _SIX_D.unpack_from(six_d)[0] != len(bodies):
            return "absurd"
    except struct.error:
        return "truncated"
    except ValueError as error:
        return str(error)
    return _DATA.unpack_from(content)[0] * 1e-6, bodies


class QualisysReader(PoseReader):
    """Reads the poses of one body from the contents of data packets.

    :attr:`names` must be set in their order.
    """

    def __init__(self, name: str, intake: Intake) -> None:
        """Look for the body ``name``."""
        super().__init__(intake)
        self.other_bodies = False
        """Whether the number of bodies in the newest frame differs from that of the names."""
        self._name = name

    def read_pose(self, data: bytes, arrival_s: float) -> Pose | None:
        """Return the pose of the vehicle's body in the content of one data packet."""
        found = decode_bodies(data)
        if isinstance(found, str):
            return self.intake.drop(found)
        stamp_s, bodies = found
        self.intake.clock.mark_alive(arrival_s)
        self.other_bodies = len(bodies) != len(self.names)
        if self.other_bodies:  # their names are not known until QTM is asked again
            return self.intake.drop("other_bodies")
        for name, (x, y, z, *_) in zip(self.names, bodies, strict=True):
            if not math.isnan(x):
                self.intake.see_other(name, arrival_s, (x * 1e-3, y * 1e-3, z * 1e-3))
        own = self.intake.choose(
            [body for name, body in zip(self.names, bodies, strict=True) if name == self._name]
        )
        if own is None:
            return None
        x, y, z, *m = own
        if all(map(math.isnan, (x, y, z))):
            return self.intake.drop("not_tracked")
        if not math.isfinite(sum(own)):
            return self.intake.drop("not_finite")
        rows = ((m[0], m[3], m[6]), (m[1], m[4], m[7]), (m[2], m[5], m[8]))
        if not _is_rotation(rows):
            return self.intake.drop("not_unit")
        attitude = so3.normalize(so3.from_matrix(rows))
        return self.intake.pose(stamp_s, arrival_s, (x * 1e-3, y * 1e-3, z * 1e-3), attitude)


def _is_rotation(rows: tuple[Vec3, Vec3, Vec3]) -> bool:
    """Whether the rows are a right-handed rotation: unit length, third = first x second."""
    (a, b, c), (d, e, f), (g, h, i) = rows
    if (
        abs(a * a + b * b + c * c - 1.0) > UNIT_TOLERANCE
        or abs(d * d + e * e + f * f - 1.0) > UNIT_TOLERANCE
    ):
        return False
    across = max(
        abs(b * f - c * e - g),
        abs(c * d - a * f - h),
        abs(a * e - b * d - i),
        abs(a * d + b * e + c * f),
    )
    return across <= UNIT_TOLERANCE
