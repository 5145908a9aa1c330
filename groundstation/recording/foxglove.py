"""Messages with Foxglove's own schemas, which its panels know how to draw (foxglove-sdk, schemas/jsonschema)."""

import msgspec

from groundstation.core.geometry.ops import Quat, Vec3

WORLD, VEHICLE = "world_ned", "vehicle"
"""Frames of /tf and /pose."""
DISPLAY = "world"
"""The same world with z up, for screens: its x is north, its y is west."""


class Vector3(msgspec.Struct, frozen=True, gc=False):
    """Three components."""

    x: float
    y: float
    z: float


class Quaternion(msgspec.Struct, frozen=True, gc=False):
    """Body to world, unit."""

    x: float
    y: float
    z: float
    w: float


def vector(v: Vec3) -> Vector3:
    """The same, with names."""
    return Vector3(v[0], v[1], v[2])


def quaternion(q: Quat) -> Quaternion:
    """The same, with names."""
    return Quaternion(q[1], q[2], q[3], q[0])


class Time(msgspec.Struct, frozen=True, gc=False):
    """Since 1970, or since the beginning of virtual time."""

    sec: int
    nsec: int


class FoxglovePose(msgspec.Struct, frozen=True, gc=False):
    """foxglove.Pose."""

    position: Vector3
    orientation: Quaternion


class PoseInFrame(msgspec.Struct, frozen=True, gc=False):
    """foxglove.PoseInFrame."""

    timestamp: Time
    frame_id: str
    pose: FoxglovePose


class FrameTransform(msgspec.Struct, frozen=True, gc=False):
    """foxglove.FrameTransform."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class Log(msgspec.Struct, frozen=True, gc=False):
    """foxglove.Log; level 2 is info, 3 a warning."""

    timestamp: Time
    level: int
    message: str
    name: str
    file: str
    line: int
