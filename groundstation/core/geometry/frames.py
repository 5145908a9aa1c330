"""The only place that converts frames: the lab's and the source's into ours (world NED, body FRD) and back.

Axes have names of three letters, for where x, y and z point. World: north, east, down and their opposites south,
west, up: ``ned`` is ours, ``enu`` ROS', ``nwu`` (x ahead, y left, z up) the usual frame of a motion capture volume,
``nue`` (y up) what OptiTrack sends by default. Body: forward, right, down and backward, left, up: ``frd`` is ours.
There are 24 of each. The other 24 would be left-handed: mirror images, which no turn can mend, so they have no name.

"North" and "forward" are what these names call so; where that is not ours, an :class:`Alignment` tells how it lies.
Quaternions are w, x, y, z, body to world; their sign follows the input continuously.
"""

import math
from typing import Annotated, Literal, Protocol, TypeAlias

import msgspec

from groundstation.core.geometry import so3
from groundstation.core.geometry.so3 import Quat, Vec3

World: TypeAlias = Literal[
    "ned", "ndw", "nwu", "nue", "enu", "edn", "esd", "eus", "dne", "des", "dsw", "dwn",
    "seu", "sde", "swd", "suw", "wnd", "wds", "wsu", "wun", "unw", "uen", "use", "uws",
]  # fmt: skip
"""Names of world axes."""

Body: TypeAlias = Literal[
    "frd", "fdl", "flu", "fur", "rfu", "rdf", "rbd", "rub", "dfr", "drb", "dbl", "dlf",
    "bru", "bdr", "bld", "bul", "lfd", "ldb", "lbu", "luf", "ufl", "urf", "ubr", "ulb",
]  # fmt: skip
"""Names of body axes."""

_POINTING: dict[str, Vec3] = {
    **dict.fromkeys("nf", (1.0, 0.0, 0.0)),
    **dict.fromkeys("sb", (-1.0, 0.0, 0.0)),
    **dict.fromkeys("er", (0.0, 1.0, 0.0)),
    **dict.fromkeys("wl", (0.0, -1.0, 0.0)),
    "d": (0.0, 0.0, 1.0),
    "u": (0.0, 0.0, -1.0),
}
"""Where a letter points, in NED or FRD."""

_Metres = Annotated[float, msgspec.Meta(ge=-1000.0, le=1000.0)]
_Degrees = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]


class Alignment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a source's axes lie against ours, beyond their names; all zero where the names say it all."""

    lab_rotation_deg: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the lab's axes against our world [deg]. Yaw alone: how far the lab's north lies east of
    ours. Turned as a vehicle is: yaw first, then pitch, then roll, about north, east and down as ``world`` has them."""
    lab_origin_m: tuple[_Metres, _Metres, _Metres] = (0.0, 0.0, 0.0)
    """Where the lab's origin is in our world [m, north east down]."""
    body_rotation_deg: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the tracked body's axes on the vehicle [deg]. Yaw alone: how far the body's forward lies
    to the right of the nose."""
    centre_of_mass_m: tuple[_Metres, _Metres, _Metres] = (0.0, 0.0, 0.0)
    """From the point that is tracked to the vehicle's centre of mass [m, forward right down on the vehicle]."""


class Axes(Protocol):
    """What the config of a source says of its axes."""

    @property
    def world(self) -> World:
        """Names of the lab's axes."""
        ...

    @property
    def body(self) -> Body:
        """Names of the body's axes."""
        ...

    @property
    def alignment(self) -> Alignment:
        """How they lie against ours."""
        ...


class Frames:
    """The way from one source's axes into ours, and back; worked out once, as every pose goes through it."""

    def __init__(self, world: World = "ned", body: Body = "frd", alignment: Alignment | None = None) -> None:
        """``world`` and ``body`` name the source's axes; ``alignment``: as they are named, where None."""
        more = alignment or Alignment()
        lab, turned = _turn(more.lab_rotation_deg), _turn(more.body_rotation_deg)
        # R_ned_frd = R_ned_lab R_lab_body R_frd_bodyᵀ: of a quaternion, a linear map.
        self._before = so3.multiply(lab, _quaternion(world))
        self._after = so3.conjugate(so3.multiply(turned, _quaternion(body)))
        images = [self._turn_attitude((float(i == 0), float(i == 1), float(i == 2), float(i == 3))) for i in range(4)]
        self._attitude = tuple(image[row] for row in range(4) for image in images)
        self._columns = tuple(so3.to_world(lab, axis) for axis in axes(world))
        self._origin = more.lab_origin_m
        self._centre = more.centre_of_mass_m if any(more.centre_of_mass_m) else None

    def _turn_attitude(self, attitude: Quat) -> Quat:
        return so3.multiply(so3.multiply(self._before, attitude), self._after)

    def ours(self, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        """Position of the centre of mass [m, NED] and attitude (FRD to NED) of what the source measured."""
        w, x, y, z = attitude
        a, b, c, d, e, f, g, h, i, j, k, m, n, o, p, q = self._attitude
        ours = (
            a * w + b * x + c * y + d * z,
            e * w + f * x + g * y + h * z,
            i * w + j * x + k * y + m * z,
            n * w + o * x + p * y + q * z,
        )
        place = self.place(position)
        if self._centre is not None:
            dx, dy, dz = so3.to_world(ours, self._centre)
            place = (place[0] + dx, place[1] + dy, place[2] + dz)
        return place, ours

    def place(self, position: Vec3) -> Vec3:
        """A point of the source's world [m] in ours [m, NED]."""
        x, y, z = position
        (a, b, c), (d, e, f), (g, h, i) = self._columns
        north, east, down = self._origin
        return a * x + d * y + g * z + north, b * x + e * y + h * z + east, c * x + f * y + i * z + down

    def theirs(self, position_ned: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        """The inverse of :meth:`ours`, sign included: what a source says, for simulators."""
        x, y, z = (p - o for p, o in zip(position_ned, self._origin, strict=True))
        if self._centre is not None:
            dx, dy, dz = so3.to_world(attitude, self._centre)
            x, y, z = x - dx, y - dy, z - dz
        position = tuple(a * x + b * y + c * z for a, b, c in self._columns)
        back = so3.multiply(so3.multiply(so3.conjugate(self._before), attitude), so3.conjugate(self._after))
        return (position[0], position[1], position[2]), back


def frames_of(axes: Axes) -> Frames:
    """The way from the axes that a config names into ours."""
    return Frames(axes.world, axes.body, axes.alignment)


def axes(name: str) -> tuple[Vec3, Vec3, Vec3]:
    """Where the named x, y and z point, in NED or FRD."""
    x, y, z = (_POINTING[letter] for letter in name)
    return x, y, z


def _quaternion(name: str) -> Quat:
    """The turn that takes the axes of NED, or FRD, onto the named ones."""
    (a, b, c), (d, e, f), (g, h, i) = axes(name)
    return so3.from_matrix(((a, d, g), (b, e, h), (c, f, i)))


def _turn(roll_pitch_yaw_deg: Vec3) -> Quat:
    roll, pitch, yaw = map(math.radians, roll_pitch_yaw_deg)
    return so3.from_euler_zyx(roll, pitch, yaw)
