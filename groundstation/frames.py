"""The only place that converts frames: the lab's and the source's into ours (world NED, body FRD) and back.

World: ``ned`` north, east, down; ``enu`` east, north, up; ``nwu`` north, west, up (x ahead, y left, z up: the usual
frame of a motion capture volume, whose x axis is then our north), ``nue`` north, up, east (y up, as OptiTrack
sends by default).
Body: ``frd`` forward, right, down; ``flu`` forward, left, up; ``fur`` forward, up, right (y up).

Most of these frames are a half turn away from ours: nwu and flu about x, enu about the horizontal line half-way
between north and east. A half turn is its own inverse. nue and fur are a quarter turn away, about x. Quaternions
are w, x, y, z, body to world; their sign follows the input continuously.
"""

import math
from typing import Literal, TypeAlias

from groundstation.ops import Quat, Vec3

World: TypeAlias = Literal["ned", "enu", "nwu", "nue"]
"""Names of world frames."""

Body: TypeAlias = Literal["frd", "flu", "fur"]
"""Names of body frames."""

_HALF = math.sqrt(0.5)


def to_ned(vector: Vec3, world: World) -> Vec3:
    """A position or velocity in the named world frame as one in NED."""
    x, y, z = vector
    if world == "nwu":
        return (x, -y, -z)
    if world == "enu":
        return (y, x, -z)
    if world == "nue":
        return (x, z, -y)
    return vector


def from_ned(vector: Vec3, world: World) -> Vec3:
    """The inverse of ``to_ned``."""
    if world == "nue":
        x, y, z = vector
        return (x, -z, y)
    return to_ned(vector, world)


def to_frd(vector: Vec3, body: Body) -> Vec3:
    """Body components (rates, velocity) in the named body frame as ones in FRD."""
    x, y, z = vector
    if body == "flu":
        return (x, -y, -z)
    if body == "fur":
        return (x, z, -y)
    return vector


def attitude_to_ned_frd(attitude: Quat, world: World, body: Body) -> Quat:
    """The attitude of the named body in the named world as that of FRD in NED.

    In matrices R_ned_frd = H_world R H_bodyᵀ, with the turns H of this file's heading.
    """
    if world == "nwu":
        w, x, y, z = attitude
        attitude = (-x, w, -z, y)
    elif world == "enu":
        w, x, y, z = attitude
        attitude = (-_HALF * (x + y), _HALF * (w + z), _HALF * (w - z), _HALF * (y - x))
    elif world == "nue":
        w, x, y, z = attitude
        attitude = (_HALF * (w + x), _HALF * (x - w), _HALF * (y + z), _HALF * (z - y))
    if body == "flu":
        w, x, y, z = attitude
        attitude = (x, -w, -z, y)
    elif body == "fur":
        w, x, y, z = attitude
        attitude = (_HALF * (w - x), _HALF * (w + x), _HALF * (y + z), _HALF * (z - y))
    return attitude


def attitude_from_ned_frd(attitude: Quat, world: World, body: Body) -> Quat:
    """The inverse of ``attitude_to_ned_frd``, sign included: the turns of this file's heading, backwards."""
    w, x, y, z = attitude
    if body == "flu":
        w, x, y, z = -x, w, z, -y
    elif body == "fur":
        w, x, y, z = _HALF * (w + x), _HALF * (x - w), _HALF * (y - z), _HALF * (y + z)
    if world == "nwu":
        w, x, y, z = x, -w, z, -y
    elif world == "enu":
        w, x, y, z = _HALF * (x + y), -_HALF * (w + z), _HALF * (z - w), _HALF * (x - y)
    elif world == "nue":
        w, x, y, z = _HALF * (w - x), _HALF * (w + x), _HALF * (y - z), _HALF * (y + z)
    return (w, x, y, z)


def pose_to_ned_frd(position: Vec3, attitude: Quat, world: World, body: Body) -> tuple[Vec3, Quat]:
    """Position [m] and attitude of the named frames in world NED and body FRD."""
    return to_ned(position, world), attitude_to_ned_frd(attitude, world, body)


def pose_from_ned_frd(position_ned: Vec3, attitude: Quat, world: World, body: Body) -> tuple[Vec3, Quat]:
    """The inverse of ``pose_to_ned_frd``."""
    return from_ned(position_ned, world), attitude_from_ned_frd(attitude, world, body)
