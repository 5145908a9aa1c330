"""Vicon UDP Object Stream: one datagram for each frame of the cameras, and the poses of one object in it, on our clock.

Sans-IO; little-endian, packed.

    offset 0  u32      frame number
    offset 4  u8       number of items
    then 75 bytes for each item:
          +0  u8       item id, 0 = object
          +1  u16      size of what follows, 72
          +3  char[24] name, padded with NUL
         +27  f64[3]   translation x, y, z [mm]
         +51  f64[3]   rotation x, y, z [rad]
    then padding up to the size set in Tracker: 256, 512 or 1024 bytes

The rotation is Euler XYZ, intrinsic: R = Rx(rx) Ry(ry) Rz(rz), object to lab. The datagram holds no time stamp, no
validity flag and no checksum.
Source: public readers of the stream that Vicon Tracker 3 sends to UDP port 51001; Vicon's own page was not at hand.
"""

import math
import struct
from collections.abc import Iterable, Sequence
from typing import Literal, TypeAlias

import msgspec

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Pose, PoseStatus
from groundstation.pose.sources.intake import FrameCount, Intake

DATAGRAM_SIZES = (256, 512, 1024)
"""Sizes that Tracker offers [bytes]; room for 3, 6 and 13 objects."""
NAME_BYTES = 24
"""Longest name of an object, in UTF-8."""
MAX_TRANSLATION_MM = 1e6
"""No capture volume is larger than this; further away is absurd."""
MAX_ROTATION_RAD = 7.0
"""A whole turn and some; more is absurd."""

_HEADER = struct.Struct("<IB")
_ITEM = struct.Struct("<BH24s6d")
_ITEM_DATA_BYTES = _ITEM.size - 3
"""Length of an item behind its head [bytes]."""

UnreadableVicon: TypeAlias = Literal["truncated", "oversized", "wrong_item"]
"""Why a datagram is no frame of this stream."""


class ViconObject(msgspec.Struct, frozen=True, gc=False):
    """One object of a frame, as on the wire."""

    name: str
    """Its name in Tracker."""
    translation_mm: Vec3
    """Position in the lab frame [mm]."""
    rotation_rad: Vec3
    """Euler angles XYZ, intrinsic, object to lab [rad]."""


class ViconFrame(msgspec.Struct, frozen=True):
    """One datagram."""

    frame_number: int
    """Counts the frames of the cameras, modulo 2³²."""
    objects: tuple[ViconObject, ...]
    """In the order of the datagram."""


class ViconPose(msgspec.Struct, frozen=True, gc=False):
    """The pose of the one object that a decoder looks for, still in the lab's frame."""

    frame_number: int
    """Counts the frames of the cameras, modulo 2³²."""
    position_m: Vec3
    """Position in the lab frame [m]."""
    attitude: Quat
    """Unit quaternion w, x, y, z, object to lab."""


def encode(frame_number: int, objects: Iterable[ViconObject], datagram_size: int = 256) -> bytes:
    """The datagram of a frame, for simulators and tests.

    Raises:
        ValueError: the objects do not fit, a name is longer than 24 bytes, or no such datagram size exists.
    """
    items = [_ITEM.pack(0, _ITEM_DATA_BYTES, name_bytes(o.name), *o.translation_mm, *o.rotation_rad) for o in objects]
    if datagram_size not in DATAGRAM_SIZES:
        raise ValueError(f"Vicon datagram size: expected one of {list(DATAGRAM_SIZES)}, got {datagram_size}")
    datagram = _HEADER.pack(frame_number & 0xFFFFFFFF, len(items)) + b"".join(items)
    if len(datagram) > datagram_size:
        raise ValueError(f"{len(items)} Vicon objects do not fit into {datagram_size} bytes")
    return datagram.ljust(datagram_size, b"\0")


def decode(datagram: bytes) -> ViconFrame | UnreadableVicon:
    """The frame in a datagram, or why there is none. The numbers come as they are, even nan."""
    size = len(datagram)
    if size > DATAGRAM_SIZES[-1]:
        return "oversized"
    if size < _HEADER.size:
        return "truncated"
    frame_number, count = _HEADER.unpack_from(datagram)
    if size < _HEADER.size + count * _ITEM.size:
        return "truncated"
    objects = []
    for offset in range(_HEADER.size, _HEADER.size + count * _ITEM.size, _ITEM.size):
        item_id, data_bytes, name, x, y, z, rx, ry, rz = _ITEM.unpack_from(datagram, offset)
        if item_id != 0 or data_bytes != _ITEM_DATA_BYTES:
            return "wrong_item"
        text = name.partition(b"\0")[0].decode("utf-8", "replace")
        objects.append(ViconObject(text, (x, y, z), (rx, ry, rz)))
    return ViconFrame(frame_number, tuple(objects))


def pose_of(item: ViconObject, frame_number: int) -> ViconPose | Literal["not_finite", "absurd"]:
    """The pose of an object, or why its numbers are none."""
    x, y, z = item.translation_mm
    if not all(map(math.isfinite, (*item.translation_mm, *item.rotation_rad))):
        return "not_finite"
    if max(map(abs, item.translation_mm)) > MAX_TRANSLATION_MM or max(map(abs, item.rotation_rad)) > MAX_ROTATION_RAD:
        return "absurd"
    return ViconPose(frame_number, (x / 1000.0, y / 1000.0, z / 1000.0), quaternion_from_euler_xyz(item.rotation_rad))


def name_bytes(name: str) -> bytes:
    """The name of an object as on the wire, not yet padded.

    Raises:
        ValueError: it is empty, longer than 24 bytes, or holds a NUL.
    """
    encoded = name.encode()
    if not 0 < len(encoded) <= NAME_BYTES or b"\0" in encoded:
        raise ValueError(f"Vicon object name: expected 1 to {NAME_BYTES} bytes of UTF-8 without NUL, got {name!r}")
    return encoded


def quaternion_from_euler_xyz(angles: Vec3) -> Quat:
    """The quaternion of R = Rx(rx) Ry(ry) Rz(rz), angles in rad."""
    rx, ry, rz = angles
    cx, sx = math.cos(0.5 * rx), math.sin(0.5 * rx)
    cy, sy = math.cos(0.5 * ry), math.sin(0.5 * ry)
    cz, sz = math.cos(0.5 * rz), math.sin(0.5 * rz)
    cc, ss, cs, sc = cx * cy, sx * sy, cx * sy, sx * cy
    return (cc * cz - ss * sz, sc * cz + cs * sz, cs * cz - sc * sz, cc * sz + ss * cz)


def euler_xyz_from_quaternion(attitude: Quat) -> Vec3:
    """The angles [rad] of R = Rx(rx) Ry(ry) Rz(rz): |ry| <= 90°, the others in [-180°, 180°].

    From the sum and the difference of rx and rz, which stay exact where ry nears 90° and only one of them is defined:
    with C, S = cos, sin of ry/2:  w + y = (C + S) cos((rx + rz)/2)    x + z = (C + S) sin((rx + rz)/2)
                                   w - y = (C - S) cos((rx - rz)/2)    x - z = (C - S) sin((rx - rz)/2)
    """
    w, x, y, z = attitude
    half_sum = math.atan2(x + z, w + y)
    half_difference = math.atan2(x - z, w - y)
    plus, minus = math.hypot(w + y, x + z), math.hypot(w - y, x - z)
    return (
        math.remainder(half_sum + half_difference, math.tau),
        2.0 * math.atan2(plus - minus, plus + minus),
        math.remainder(half_sum - half_difference, math.tau),
    )


class ViconReader:
    """Implements :class:`groundstation.pose.sources.intake.DatagramReader`.

    The datagrams hold no time, but frames come at a steady rate: their numbers are the clock.
    """

    def __init__(self, name: str, intake: Intake, *, drop_frozen: bool = True) -> None:
        """Look for the object ``name``; the stamps of ``intake`` are frame numbers.

        ``drop_frozen``: a pose that equals the one before to the last bit was not measured, nor was
        one that is at the origin to the last bit.

        Raises:
            ValueError: no object can have that name.
        """
        name_bytes(name)
        self.names: tuple[str, ...] = ()
        """The objects of the last datagram that lacked ours, for the operator."""
        self._own = name
        self._intake = intake
        self._drop_frozen = drop_frozen
        self._frames = FrameCount()
        self._last: ViconPose | None = None
        self._last_others: dict[str, ViconObject] = {}

    @property
    def status(self) -> PoseStatus:
        """Counters as they are now.

        Reasons beside the intake's: truncated, oversized, wrong_item, no_such_object, same_name, frozen, not_tracked.
        """
        return self._intake.status

    def read(self, datagram: bytes, arrival_s: float) -> Sequence[Pose]:
        """The pose of our object, or nothing."""
        found = decode(datagram)
        if isinstance(found, str):
            self._intake.drop(found)
            return ()
        self._intake.mark_alive(arrival_s)
        if self._intake.others is not None:
            self._look_around(found, arrival_s)
        own = self._intake.choose([one for one in found.objects if one.name == self._own], "no_such_object")
        if own is None:
            self.names = tuple(one.name for one in found.objects)
            return ()
        seen = pose_of(own, found.frame_number)
        if isinstance(seen, str):
            self._intake.drop(seen)
            return ()
        if self._drop_frozen and not any(seen.position_m):
            self._intake.drop("not_tracked")
            return ()
        last = self._last
        if (
            self._drop_frozen
            and last is not None
            and (seen.position_m, seen.attitude) == (last.position_m, last.attitude)
            and seen.frame_number != last.frame_number
        ):
            self._intake.drop("frozen")
            return ()
        frame = self._frames.whole(seen.frame_number)
        pose = self._intake.pose(frame, arrival_s, seen.position_m, seen.attitude)
        if pose is None:
            return ()
        self._last = seen
        return (pose,)

    def _look_around(self, frame: ViconFrame, arrival_s: float) -> None:
        """Take the other bodies; a hidden one stands still to the last bit."""
        others = self._intake.others
        for item in frame.objects:
            if others is None or item.name == self._own or item.name not in others:
                continue
            hidden = self._last_others.get(item.name) == item or not any(item.translation_mm)
            if self._drop_frozen and hidden:
                continue
            self._last_others[item.name] = item
            x, y, z = item.translation_mm
            self._intake.other(item.name, arrival_s, (x / 1000.0, y / 1000.0, z / 1000.0))
