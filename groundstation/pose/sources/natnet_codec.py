"""NatNet 3.0 to 4.x, as OptiTrack's Motive streams rigid bodies: messages both ways.

Sans-IO; little-endian, packed.

    u16 message id, u16 bytes of payload, payload

    SERVERINFO     char[256] name | u8[4] its version | u8[4] NatNet version | u64 clock frequency |
                   u16 data port |
                   u8 multicast | u8[4] group
    FRAMEOFDATA    u32 frame, then sections, each u32 n, [4.1: u32 bytes], n elements: marker sets,
                   unlabelled markers,
                   rigid bodies, skeletons, [4.1: assets], labelled markers, force plates, devices;
                   then the suffix: u32 timecode, u32 sub-frame | f64 time | u64 mid-exposure, data
                   received, transmit (ticks) | [4.1: u32 s, u32 fraction] | u16 flags (bit 0 Motive
                   records, bit 1 the list of models changed, bit 2 edit mode or playback, bit 3 the
                   version of the bit stream changed)
    rigid body     i32 id | f32[3] position [m] | f32[4] quaternion x, y, z, w | f32 error | u16
                   flags (bit 0: tracked)
    MODELDEF       the names and streaming ids of rigid bodies, which are nowhere else:
                   u32 n, then n × (u32 type, [4.1: u32 bytes], description)
      0: marker set  text name | u32 n, n × text
      1: rigid body  text name | i32 id | i32 parent | f32[3] offset | [4.2: f32[4] quaternion] |
                     u32 n, n × f32[3], n × u32, [4.0: n × text]
      2: skeleton    text name | i32 id | u32 n, n × rigid body

The ticks of mid-exposure and transmission give the age of a pose at its transmission: only the
network time is unknown.

The bytes of a section or of a description do not count themselves: unknown contents are skipped by
them. Public readers agree on bits 0 and 1. Of the later two one sample calls bit 2 the changed bit
stream, and has no mask for edit mode that could work: so no frame with bit 2 set is used, and after
either the server is asked anew. Source: public readers (libmotioncapture a91e8360, natnet 0.3.0,
new-natnet-client 5.0.1, the NatNet SDK's sample), read for the layout only.
"""

import struct
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from enum import IntEnum
from typing import Any, TypeAlias

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Pose, notice
from groundstation.pose.sources.intake import Intake, PoseReader

U32 = struct.Struct("<I")


class UnreadableNatNet(Exception):
    """Reason why a message can't be read, as one word; never leaves the callers of these codecs."""


class Payload:
    """Cursor over a payload; a read beyond its end is ``truncated``."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def take(self, layout: struct.Struct) -> tuple[Any, ...]:
        """Return the next values, of this layout."""
        try:
            values = layout.unpack_from(self._data, self._at)
        except struct.error:
            raise UnreadableNatNet("truncated") from None
        self._at += layout.size
        return values

    def count(self) -> int:
        """Return the next u32: a number of elements, or of bytes."""
        return int(self.take(U32)[0])

    def section(self, sized: bool, element: Callable[["Payload"], Any]) -> None:
        """Skip the next section: by its bytes if ``sized``, else each part by ``element``."""
        count = self.count()
        if sized:
            self.skip(self.count())
        else:
            for _ in range(count):
                element(self)

    def skip(self, size: int) -> None:
        """Skip so many bytes."""
        self._at += size
        if self._at > len(self._data):
            raise UnreadableNatNet("truncated")

    def text(self) -> str:
        """Return the next text, up to its NUL."""
        end = self._data.find(b"\0", self._at)
        if end < 0:
            raise UnreadableNatNet("truncated")
        text = text_of(self._data[self._at : end])
        self._at = end + 1
        return text


def text_of(data: bytes) -> str:
    """Return the text in a field, up to its first NUL."""
    return data.partition(b"\0")[0].decode("utf-8", "replace")


class NatNetMessage(IntEnum):
    """Message ids of NatNet."""

    CONNECT = 0
    SERVERINFO = 1
    RESPONSE = 3
    REQUEST_MODELDEF = 4
    MODELDEF = 5
    FRAMEOFDATA = 7
    KEEPALIVE = 10
    UNRECOGNIZED = 100
    """Answer to a request that a server does not know."""


class SuffixFlag(IntEnum):
    """Bits of the flags in a frame's suffix."""

    MODELS_CHANGED = 2
    EDITED = 4
    BITSTREAM_CHANGED = 8


class BodyFlag(IntEnum):
    """Bits of a rigid body's flags."""

    TRACKED = 1


Version: TypeAlias = tuple[int, int]


class Introduced:
    """Versions from which on the protocol has something."""

    EXPOSURE: Version = (3, 0)
    """Ticks of the exposure: no older version is read."""
    SIZES: Version = (4, 1)
    """Sizes of sections."""
    TURNS: Version = (4, 2)
    """A quaternion in a body's description."""


_HEADER = struct.Struct("<HH")
_SERVER = struct.Struct("<256s4s4sQHB4s")
_BODY = struct.Struct("<i3f4ffH")
_SUFFIX = struct.Struct("<IIdQQQ")
_PRECISION = struct.Struct("<II")
_FLAGS = struct.Struct("<H")
_POINT = struct.Struct("<3f")
"""A marker without label, or in a description: x, y, z."""
_LABELLED = struct.Struct("<i4fhf")
"""A labelled marker: id, x, y, z, size, flags, residual."""
_QUATERNION = struct.Struct("<4f")


class ServerInfo(msgspec.Struct, frozen=True):
    """The server's program, versions and address of the stream."""

    name: str
    version: Version
    """NatNet's, major and minor."""
    ticks_per_s: int
    """Frequency of the clock that stamps frames [Hz]."""
    data_port: int = 1511
    multicast: bool = True
    group: str = "239.255.42.99"
    """Multicast group of the frames."""


class RigidBody(msgspec.Struct, frozen=True, gc=False):
    """One body of one frame, as on the wire."""

    id: int
    position: Vec3
    """[m]"""
    quaternion_xyzw: Quat
    """Body to world; note the order."""
    error_m: float = 0.0
    """Mean distance of the markers from the model [m]."""
    tracked: bool = True


class NatNetFrame(msgspec.Struct, frozen=True):
    """One FRAMEOFDATA, without the markers."""

    number: int
    bodies: tuple[RigidBody, ...]
    exposure_ticks: int
    """Middle of the cameras' exposure, on the server's clock; 0 if unknown."""
    transmit_ticks: int
    """Transmission of the frame, on the same clock."""
    models_changed: bool = False
    live: bool = True
    """False in edit mode or playback, which show the past."""
    bitstream_changed: bool = False


def message(number: int, payload: bytes = b"") -> bytes:
    """Return one message."""
    return _HEADER.pack(number, len(payload)) + payload


def split(datagram: bytes) -> tuple[int, bytes]:
    """Return id and payload of the message in a datagram.

    Raises:
        UnreadableNatNet: truncated.
    """
    head = Payload(datagram)
    number, size = head.take(_HEADER)
    head.skip(size)
    return number, datagram[_HEADER.size : _HEADER.size + size]


def decode_server_info(payload: bytes) -> ServerInfo:
    """Read the payload of SERVERINFO.

    Raises:
        UnreadableNatNet: truncated; wrong_version (older than 3.0); absurd (a clock that does not
            tick).
    """
    name, _, (major, minor, *_), ticks, port, multicast, group = Payload(payload).take(_SERVER)
    if (major, minor) < Introduced.EXPOSURE:
        raise UnreadableNatNet("wrong_version")
    if ticks == 0:
        raise UnreadableNatNet("absurd")
    return ServerInfo(
        text_of(name), (major, minor), ticks, port, bool(multicast), ".".join(map(str, group))
    )


def encode_server_info(info: ServerInfo) -> bytes:
    """Return the message, for simulators and tests."""
    version = bytes([*info.version, 0, 0])
    group = bytes(map(int, info.group.split(".")))
    return message(
        NatNetMessage.SERVERINFO,
        _SERVER.pack(
            info.name.encode(),
            version,
            version,
            info.ticks_per_s,
            info.data_port,
            info.multicast,
            group,
        ),
    )


def decode_frame(payload: bytes, version: Version) -> NatNetFrame:
    """Read the payload of FRAMEOFDATA.

    Raises:
        UnreadableNatNet: truncated; wrong_layout (bodies of another size than ours).
    """
    walk = Payload(payload)
    sized = version >= Introduced.SIZES
    number = walk.count()
    walk.section(sized, _skip_marker_set)
    walk.section(sized, lambda walk: walk.skip(_POINT.size))  # unlabelled markers
    count = walk.count()
    if sized and walk.count() != count * _BODY.size:
        raise UnreadableNatNet("wrong_layout")
    bodies = tuple(_body(walk) for _ in range(count))
    walk.section(sized, _skip_skeleton)
    if sized:
        walk.section(sized, _skip_skeleton)  # assets, which only sized streams have
    walk.section(sized, lambda walk: walk.skip(_LABELLED.size))
    for _ in (0, 1):  # force plates, devices
        walk.section(sized, _skip_channels)
    _, _, _, exposure, _, transmit = walk.take(_SUFFIX)
    if sized:
        walk.take(_PRECISION)
    (flags,) = walk.take(_FLAGS)
    changed, edited, bitstream = (
        bool(flags & bit)
        for bit in (SuffixFlag.MODELS_CHANGED, SuffixFlag.EDITED, SuffixFlag.BITSTREAM_CHANGED)
    )
    return NatNetFrame(number, bodies, exposure, transmit, changed, not edited, bitstream)


def _skip_marker_set(walk: Payload) -> None:
    walk.text()
    walk.skip(walk.count() * _POINT.size)


def _skip_skeleton(walk: Payload) -> None:
    walk.skip(4)
    walk.skip(walk.count() * _BODY.size)


def _skip_channels(walk: Payload) -> None:
    walk.skip(4)
    for _ in range(walk.count()):
        walk.skip(walk.count() * 4)


def _body(walk: Payload) -> RigidBody:
    number, x, y, z, qx, qy, qz, qw, error, flags = walk.take(_BODY)
    return RigidBody(number, (x, y, z), (qx, qy, qz, qw), error, bool(flags & BodyFlag.TRACKED))


def encode_frame(frame: NatNetFrame, version: Version, *, ticks_per_s: int = 10_000_000) -> bytes:
    """Return the message FRAMEOFDATA with rigid bodies only, for simulators and tests."""
    sized = version >= Introduced.SIZES

    def section(elements: Iterable[bytes]) -> bytes:
        parts = list(elements)
        data = b"".join(parts)
        return U32.pack(len(parts)) + (U32.pack(len(data)) if sized else b"") + data

    bodies = (
        _BODY.pack(
            b.id, *b.position, *b.quaternion_xyzw, b.error_m, BodyFlag.TRACKED if b.tracked else 0
        )
        for b in frame.bodies
    )
    ticks = frame.exposure_ticks
    payload = [
        U32.pack(frame.number),
        section(()),
        section(()),
        section(bodies),
        *[section(())] * (5 if sized else 4),
        _SUFFIX.pack(0, 0, ticks / ticks_per_s, ticks, frame.transmit_ticks, frame.transmit_ticks),
        _PRECISION.pack(ticks // ticks_per_s, 0) if sized else b"",
        _FLAGS.pack(
            SuffixFlag.MODELS_CHANGED * frame.models_changed
            | SuffixFlag.EDITED * (not frame.live)
            | SuffixFlag.BITSTREAM_CHANGED * frame.bitstream_changed
        ),
        U32.pack(0),  # end of data
    ]
    return message(NatNetMessage.FRAMEOFDATA, b"".join(payload))


_BODY_DESCRIPTION = struct.Struct("<ii3f")


def decode_models(payload: bytes, version: Version) -> list[tuple[str, int]]:
    """Return name and streaming id of each rigid body of a MODELDEF.

    Descriptions of unknown kinds are skipped by their bytes, or, before 4.1, end the list.

    Raises:
        UnreadableNatNet: truncated.
    """
    walk = Payload(payload)
    bodies: list[tuple[str, int]] = []
    for _ in range(walk.count()):
        kind = walk.count()
        size = walk.count() if version >= Introduced.SIZES else None
        if kind == 0:
            walk.text()
            for _ in range(walk.count()):
                walk.text()
        elif kind == 1:
            bodies.append(_body_description(walk, version))
        elif kind == 2:
            walk.text()
            walk.skip(4)
            for _ in range(walk.count()):
                _body_description(walk, version)
        elif size is not None:
            walk.skip(size)
        else:
            break
    return bodies


def _body_description(walk: Payload, version: Version) -> tuple[str, int]:
    name = walk.text()
    number, *_ = walk.take(_BODY_DESCRIPTION)
    if version >= Introduced.TURNS:
        walk.skip(_QUATERNION.size)
    markers = walk.count()
    walk.skip(markers * (_POINT.size + 4))
    if version >= (4, 0):
        for _ in range(markers):
            walk.text()
    return name, int(number)


def encode_models(bodies: Mapping[str, int], version: Version) -> bytes:
    """Return MODELDEF with rigid bodies without markers, for simulators and tests."""
    parts = [U32.pack(len(bodies))]
    for name, number in bodies.items():
        turn = bytes(_QUATERNION.size) if version >= Introduced.TURNS else b""
        body = (
            name.encode()
            + b"\0"
            + _BODY_DESCRIPTION.pack(number, -1, 0.0, 0.0, 0.0)
            + turn
            + U32.pack(0)
        )
        parts += [U32.pack(1), U32.pack(len(body)) if version >= Introduced.SIZES else b"", body]
    return message(NatNetMessage.MODELDEF, b"".join(parts))


SILENT_BEATS = 4
"""Silence after which the server is asked anew [beats]: it may have been restarted."""
OLDEST_S = 1.0
"""Largest plausible age of a frame at its transmission [s]."""


class NatNetReader(PoseReader):
    """Keeps the stream of a NatNet server alive, and reads the poses of one body.

    :meth:`due` gives what to send.

    Reasons for drops beside the intake's: truncated, wrong_version, wrong_layout, unknown_message,
    no_server_info, no_such_body, same_name, not_tracked, not_live, no_exposure_stamp,
    other_address.
    """

    def __init__(
        self, name: str, intake: Intake, *, body_id: int | None = None, keep_alive: bool = True
    ) -> None:
        """Look for the rigid body ``name``, or for the one with streaming id ``body_id``.

        ``keep_alive``: a unicast server streams only to clients that send a keep-alive every
            second.
        """
        super().__init__(intake)
        self.server: ServerInfo | None = None
        """The server as it described itself last."""
        self._name = name
        self._fixed_id = body_id
        self._ids: list[int] = [] if body_id is None else [body_id]
        """Streaming ids of the vehicle's body: one, if its name is unique."""
        self._wants_names = body_id is None or intake.others is not None
        self._ask_names = self._wants_names
        self._others: dict[int, str] = {}
        self._keep_alive = keep_alive
        self._ask_server = False
        self._silent_beats = self._frameless_beats = 0

    def due(self) -> list[bytes]:
        """Return the messages to send to the server now; called once a beat (about 0.5 s)."""
        self._silent_beats += 1
        self._frameless_beats += 1
        ping = message(NatNetMessage.CONNECT, b"Ping\0")
        if self.server is None or self._silent_beats > SILENT_BEATS:
            return [ping]
        messages = [ping] if self._ask_server else []
        if self._ask_names:
            messages.append(message(NatNetMessage.REQUEST_MODELDEF))
        if self._keep_alive:
            messages.append(message(NatNetMessage.KEEPALIVE))
        return messages

    def take_from_other(self, datagram: bytes, address: str, port: int) -> None:
        """Count a datagram from another ``address`` than the server's with its command ``port``.

        While the server itself is silent, or answers and streams nothing, what it should have sent
        may have come from a second address of its own.
        """
        self.intake.drop("other_address")
        with suppress(UnreadableNatNet):
            number = split(datagram)[0]
            missed = (
                self._frameless_beats if number == NatNetMessage.FRAMEOFDATA else self._silent_beats
            )
            if self.server is not None and missed <= SILENT_BEATS:
                return
            if number in (
                NatNetMessage.SERVERINFO,
                NatNetMessage.MODELDEF,
                NatNetMessage.FRAMEOFDATA,
            ):
                self.intake.advice = notice("pose.other_server", address=address, port=port).text

    def read_pose(self, data: bytes, arrival_s: float) -> Pose | None:
        """Return the pose of the vehicle's body in the datagram ``data``."""
        try:
            number, payload = split(data)
            if number == NatNetMessage.SERVERINFO:
                self._take_server(payload)
            elif number not in (NatNetMessage.MODELDEF, NatNetMessage.FRAMEOFDATA):
                if number not in (NatNetMessage.RESPONSE, NatNetMessage.UNRECOGNIZED):
                    return self.intake.drop("unknown_message")
            elif self.server is None:
                return self.intake.drop("no_server_info")
            elif number == NatNetMessage.MODELDEF:
                self._take_models(decode_models(payload, self.server.version))
            else:
                frame = decode_frame(payload, self.server.version)
                self._silent_beats, self._frameless_beats, self.intake.advice = 0, 0, ""
                self.intake.clock.mark_alive(arrival_s)
                return self._pose(frame, self.server.ticks_per_s, arrival_s)
        except UnreadableNatNet as fault:
            return self.intake.drop(str(fault))
        return None

    def _take_server(self, payload: bytes) -> None:
        """Take the server's description."""
        self.server = decode_server_info(payload)
        self._ask_server = False
        self._silent_beats = 0

    def _take_models(self, models: list[tuple[str, int]]) -> None:
        """Take names and streaming ids of the bodies."""
        self.names = tuple(name for name, _ in models)
        if self._fixed_id is None:
            self._ids = [number for name, number in models if name == self._name]
        others = self.intake.others
        if others is not None:
            own = self._ids[:1]
            self._others = {
                number: name for name, number in models if name in others and number not in own
            }
        self._ask_names = not self._ids or (
            others is not None and len(self._others) < len(others.names)
        )

    def _pose(self, frame: NatNetFrame, ticks_per_s: int, arrival_s: float) -> Pose | None:
        age_s = (frame.transmit_ticks - frame.exposure_ticks) / ticks_per_s
        is_plausible = 0.0 <= age_s <= OLDEST_S
        if frame.models_changed or frame.bitstream_changed or not frame.live:
            self._ask_names = self._wants_names  # the known ids are used until the answer
        if frame.bitstream_changed or not frame.live:
            self._ask_server = True  # its version and that of its stream
        if not frame.live:
            return self.intake.drop("not_live")
        for body in frame.bodies if is_plausible else ():
            if body.tracked and body.id in self._others:
                self.intake.see_other(self._others[body.id], arrival_s, body.position, age_s=age_s)
        if len(self._ids) > 1:
            return self.intake.drop("same_name")
        own = self.intake.choose([body for body in frame.bodies if body.id in self._ids])
        if own is None:
            return None
        if not own.tracked:
            return self.intake.drop("not_tracked")
        if frame.exposure_ticks == 0 or frame.transmit_ticks == 0:
            return self.intake.drop("no_exposure_stamp")  # a recording that is played back
        if not is_plausible:
            return self.intake.drop("absurd")
        x, y, z, w = own.quaternion_xyzw
        return self.intake.pose(
            frame.transmit_ticks / ticks_per_s, arrival_s, own.position, (w, x, y, z), age_s=age_s
        )
