"""The only place that converts frames: the lab's and the source's into ours (world NED, body FRD) and back.

World: ``ned`` north, east, down; ``enu`` east, north, up; ``nwu`` north, west, up (x ahead, y left, z up: the usual
frame of a motion capture volume, whose x axis is then our north).
Body: ``frd`` forward, right, down; ``flu`` forward, left, up.

Each of these frames is a half turn away from ours: nwu and flu about x, enu about the horizontal line half-way
between north and east. A half turn is its own inverse, so every function below also converts back. Quaternions
are w, x, y, z, body to world; their sign follows the input continuously.
"""

import math
from typing import Literal, TypeAlias

from groundstation.ops import Quat, Vec3

World: TypeAlias = Literal["ned", "enu", "nwu"]
"""Names of world frames."""

Body: TypeAlias = Literal["frd", "flu"]
"""Names of body frames."""

_HALF = math.sqrt(0.5)


def to_ned(vector: Vec3, world: World) -> Vec3:
    """A position or velocity in the named world frame as one in NED, or one in NED as one in that frame."""
    x, y, z = vector
    if world == "nwu":
        return (x, -y, -z)
    if world == "enu":
        return (y, x, -z)
    return vector


def to_frd(vector: Vec3, body: Body) -> Vec3:
    """Body components (rates, velocity) in the named body frame as ones in FRD, or the other way round."""
    if body == "flu":
        x, y, z = vector
        return (x, -y, -z)
    return vector


def attitude_to_ned_frd(attitude: Quat, world: World, body: Body) -> Quat:
    """The attitude of the named body in the named world as that of FRD in NED.

    In matrices R_ned_frd = H_world R H_body, with the half turns H of this file's heading.
    """
    if world == "nwu":
        w, x, y, z = attitude
        attitude = (-x, w, -z, y)
    elif world == "enu":
        w, x, y, z = attitude
        attitude = (-_HALF * (x + y), _HALF * (w + z), _HALF * (w - z), _HALF * (y - x))
    if body == "flu":
        w, x, y, z = attitude
        attitude = (x, -w, -z, y)
    return attitude


def attitude_from_ned_frd(attitude: Quat, world: World, body: Body) -> Quat:
    """The inverse of ``attitude_to_ned_frd``, sign included."""
    w, x, y, z = attitude_to_ned_frd(attitude, world, body)
    # Twice the same half turn is a whole one: minus the quaternion. One of the two, then, is turned back.
    if (world == "ned") != (body == "frd"):
        return (-w, -x, -y, -z)
    return (w, x, y, z)


def pose_to_ned_frd(position: Vec3, attitude: Quat, world: World, body: Body) -> tuple[Vec3, Quat]:
    """Position [m] and attitude of the named frames in world NED and body FRD."""
    return to_ned(position, world), attitude_to_ned_frd(attitude, world, body)


def pose_from_ned_frd(position_ned: Vec3, attitude: Quat, world: World, body: Body) -> tuple[Vec3, Quat]:
    """The inverse of ``pose_to_ned_frd``."""
    return to_ned(position_ned, world), attitude_from_ned_frd(attitude, world, body)
