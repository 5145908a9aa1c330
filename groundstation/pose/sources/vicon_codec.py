"""Vicon UDP Object Stream: one datagram for each frame of the cameras, and the poses of one object
in it, on our clock.

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

The rotation is Euler XYZ, intrinsic: R = Rx(rx) Ry(ry) Rz(rz), object to lab. The datagram holds no
time stamp, no validity flag and no checksum. Source: public readers of the stream that Vicon
Tracker 3 sends to UDP port 51001; Vicon's own page was not at hand.
"""

import math
import struct
from collections.abc import Iterable
from typing import Literal, TypeAlias

import msgspec

from groundstation.core.geometry import Quat, Vec3, so3
from groundstation.core.messages import Pose
from groundstation.pose.sources.intake import Intake, PoseReader

DATAGRAM_SIZES = (256, 512, 1024)
"""Sizes that Tracker offers [bytes]; room for 3, 6 and 13 objects."""
NAME_BYTES = 24
"""Longest name of an object, in UTF-8."""

_HEADER = struct.Struct("<IB")
_ITEM = struct.Struct("<BH24s6d")
_ITEM_DATA_BYTES = _ITEM.size - struct.calcsize("<BH")
"""Length of an item behind its head [bytes]."""
MOST_OBJECTS = (max(DATAGRAM_SIZES) - _HEADER.size) // _ITEM.size
"""Number of objects that the largest datagram has room for [-]."""

UnreadableVicon: TypeAlias = Literal["truncated", "oversized", "wrong_item"]
"""Reason why a datagram is no frame of this stream."""


class ViconObject(msgspec.Struct, frozen=True, gc=False):
    """One object of a frame, as on the wire."""

    name: str
    """Its name in Tracker."""
    translation_mm: Vec3
    """Position in the lab frame [mm]."""
    rotation_rad: Vec3
    """Euler angles XYZ, intrinsic, object to lab [rad]."""

    @property
    def position_m(self) -> Vec3:
        """Position in the lab frame [m]."""
        x, y, z = self.translation_mm
        return (x / 1000.0, y / 1000.0, z / 1000.0)


def encode(frame_number: int, objects: Iterable[ViconObject], datagram_size: int = 256) -> bytes:
    """Return the datagram of a frame, for simulators and tests.

    Raises:
        ValueError: the objects do not fit, a name is longer than 24 bytes, or no such datagram size
            exists.
    """
    items = [
        _ITEM.pack(0, _ITEM_DATA_BYTES, name_bytes(o.name), *o.translation_mm, *o.rotation_rad)
        for o in objects
    ]
    if datagram_size not in DATAGRAM_SIZES:
        raise ValueError(
            f"Vicon datagram size: expected one of {list(DATAGRAM_SIZES)}, got {datagram_size}"
        )
    datagram = _HEADER.pack(frame_number & 0xFFFFFFFF, len(items)) + b"".join(items)
    if len(datagram) > datagram_size:
        raise ValueError(f"{len(items)} Vicon objects do not fit into {datagram_size} bytes")
    return datagram.ljust(datagram_size, b"\0")


def decode(datagram: bytes) -> tuple[int, tuple[ViconObject, ...]] | UnreadableVicon:
    """Return the frame number (modulo 2³²) and the objects of a datagram, or why it can't be read.

    The numbers of the objects are not checked; they may be NaN.
    """
    size = len(datagram)
    if size > DATAGRAM_SIZES[-1]:
        return "oversized"
    if size < _HEADER.size:
        return "truncated"
    frame_number, count = _HEADER.unpack_from(datagram)
    if size < _HEADER.size + count * _ITEM.size:
        return "truncated"
    objects = []
    for item_id, data_bytes, name, *place in _ITEM.iter_unpack(
        datagram[_HEADER.size :][: count * _ITEM.size]
    ):
        if item_id != 0 or data_bytes != _ITEM_DATA_BYTES:
            return "wrong_item"
        x, y, z, rx, ry, rz = place
        text = name.partition(b"\0")[0].decode("utf-8", "replace")
        objects.append(ViconObject(text, (x, y, z), (rx, ry, rz)))
    return frame_number, tuple(objects)


def pose_of(item: ViconObject) -> tuple[Vec3, Quat] | None:
    """Return position [m] and attitude of an object in the lab frame.

    None where one of the numbers is none.
    """
    if not all(map(math.isfinite, (*item.translation_mm, *item.rotation_rad))):
        return None
    return item.position_m, quaternion_from_euler_xyz(item.rotation_rad)


def name_bytes(name: str) -> bytes:
    """Return the name of an object as on the wire, not yet padded.

    Raises:
        ValueError: it is empty, longer than 24 bytes, or holds a NUL.
    """
    encoded = name.encode()
    if not 0 < len(encoded) <= NAME_BYTES or b"\0" in encoded:
        raise ValueError(
            f"Vicon object name: expected 1 to {NAME_BYTES} bytes of UTF-8 without NUL, got "
            f"{name!r}"
        )
    return encoded


def quaternion_from_euler_xyz(angles: Vec3) -> Quat:
    """Return the quaternion of R = Rx(rx) Ry(ry) Rz(rz): the inverse of Rz(-rz) Ry(-ry) Rx(-rx)."""
    rx, ry, rz = angles
    return so3.conjugate(so3.from_euler_zyx(-rx, -ry, -rz))


def euler_xyz_from_quaternion(attitude: Quat) -> Vec3:
    """Return the angles [rad] of R = Rx(rx) Ry(ry) Rz(rz): |ry| <= 90°, the others in
    [-180°, 180°].

    From the sum and the difference of rx and rz, which are exact also near ry = 90°, where only one
    of them is defined:
    with C, S = cos, sin of ry/2:  w + y = (C + S) cos((rx + rz)/2)    x + z = (C + S) sin((rx +
                                                                       rz)/2)
                                   w - y = (C - S) cos((rx - rz)/2)    x - z = (C - S) sin((rx -
                                                                       rz)/2)
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


class ViconReader(PoseReader):
    """Reads the poses of one object.

    The datagrams hold no time, but frames come at a steady rate: their numbers are the clock.
    Reasons for drops beside the intake's: truncated, oversized, wrong_item, no_such_object,
    same_name, frozen, not_tracked.
    """

    def __init__(self, name: str, intake: Intake, *, drop_frozen: bool = True) -> None:
        """Look for the object ``name``; the stamps of ``intake`` are frame numbers.

        ``drop_frozen``: a pose that equals the one before to the last bit was not measured, nor was
        one that is at the origin to the last bit.

        Raises:
            ValueError: no object can have that name.
        """
        name_bytes(name)
        super().__init__(intake)
        self._own = name
        self._drop_frozen = drop_frozen
        self._frame = 0
        self._last: tuple[int, tuple[Vec3, Quat]] | None = None
        self._last_others: dict[str, ViconObject] = {}

    def read_pose(self, data: bytes, arrival_s: float) -> Pose | None:
        """Return the pose of the vehicle's object in the datagram ``data``."""
        found = decode(data)
        if isinstance(found, str):
            return self.intake.drop(found)
        number, objects = found
        self.intake.clock.mark_alive(arrival_s)
        self._see_others(objects, arrival_s)
        own = self.intake.choose(
            [one for one in objects if one.name == self._own], "no_such_object"
        )
        if own is None:
            self.names = tuple(one.name for one in objects)
            return None
        if self.is_second(arrival_s):
            return None
        seen = pose_of(own)
        if seen is None:
            return self.intake.drop("not_finite")
        if self._drop_frozen and not any(own.translation_mm):
            return self.intake.drop("not_tracked")
        if (
            self._drop_frozen
            and self._last is not None
            and self._last[0] != number
            and self._last[1] == seen
        ):
            return self.intake.drop("frozen")
        # The number on the wire is modulo 2³²: half of the circle is ahead of the last one, half
        # behind.
        self._frame += (number - self._frame + 2**31) % 2**32 - 2**31
        pose = self.intake.pose(self._frame, arrival_s, *seen)
        if pose is not None:
            self._last = number, seen
        return pose

    def _see_others(self, objects: Iterable[ViconObject], arrival_s: float) -> None:
        """Note the other bodies; the numbers of a hidden one stay the same to the last bit."""
        others = self.intake.others or ()
        for item in objects:
            hidden = self._last_others.get(item.name) == item or not any(item.translation_mm)
            if item.name in others and not (self._drop_frozen and hidden):
                self._last_others[item.name] = item
                self.intake.see_other(item.name, arrival_s, item.position_m)
