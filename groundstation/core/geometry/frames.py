"""Frames: a source's axes converted to ours.

Only here are frames converted: those of a lab and of a source into ours (world NED, body FRD) and
back.

Axes have names of three letters, for where x, y and z point. World: north, east, down and their
opposites south, west, up: ``ned`` is ours, ``enu`` ROS', ``nwu`` (x ahead, y left, z up) the usual
frame of a motion capture volume, ``nue`` (y up) what OptiTrack sends by default. Body: forward,
right, down and backward, left, up: ``frd`` is ours. There are 24 of each. The other 24 would be
left-handed: mirror images, which no turn can mend, so they have no name.

An :class:`Alignment` is the rotation and shift of a source's "north" and "forward" from ours.
Quaternions are w, x, y, z, body to world; their sign follows the input continuously.
"""

import math
from typing import Annotated, Literal, Protocol, TypeAlias

import msgspec

from groundstation.core.geometry.so3 import (
    Quat,
    Vec3,
    conjugate,
    from_euler_zyx,
    from_matrix,
    multiply,
    to_world,
)

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
"""Unit vector of an axis by its letter, in NED or FRD."""

FARTHEST_M = 100.0
"""Largest coordinate and length of a room or a field [m]: more is in millimetres, and no tracking
volume is larger."""
LONGEST_ARM_M = 1.0
"""Farthest that a tracked point is from the centre of mass, along each axis [m]: more is in
millimetres."""
Coordinate: TypeAlias = Annotated[float, msgspec.Meta(ge=-FARTHEST_M, le=FARTHEST_M)]
"""A coordinate or a height [m]."""
_Arm = Annotated[float, msgspec.Meta(ge=-LONGEST_ARM_M, le=LONGEST_ARM_M)]
_Degrees = Annotated[float, msgspec.Meta(ge=-360.0, le=360.0)]


class Alignment(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rotation and shift from a source's axes to ours, beyond the axes' names."""

    lab_rotation_deg: Annotated[
        tuple[_Degrees, _Degrees, _Degrees],
        msgspec.Meta(
            description="Roll, pitch and yaw of the lab's axes against our world [deg]. Yaw alone: "
            "angle of the lab's north east of ours. Turned as a vehicle is: yaw "
            "first, then pitch, then roll, about north, east and down as `world` has "
            "them."
        ),
    ] = (0.0, 0.0, 0.0)
    lab_origin_m: Annotated[
        tuple[Coordinate, Coordinate, Coordinate],
        msgspec.Meta(description="Where the lab's origin is in our world [m, north east down]."),
    ] = (0.0, 0.0, 0.0)
    body_rotation_deg: Annotated[
        tuple[_Degrees, _Degrees, _Degrees],
        msgspec.Meta(
            description="Roll, pitch and yaw of the tracked body's axes on the vehicle [deg]. Yaw "
            "alone: angle of the body's forward to the right of the nose."
        ),
    ] = (0.0, 0.0, 0.0)
    centre_of_mass_m: Annotated[
        tuple[_Arm, _Arm, _Arm],
        msgspec.Meta(
            description="From the point that is tracked to the vehicle's centre of mass [m, "
            "forward right down on the vehicle]."
        ),
    ] = (0.0, 0.0, 0.0)


LabAxes: TypeAlias = Annotated[
    World,
    msgspec.Meta(
        description="Axes of the lab frame: where x, y and z point; `nwu` is the usual z-up "
        "frame and `nue` a y-up one, x taken as north. `groundstation carry` finds them."
    ),
]
"""World axes of a tracker, as a key of its configuration."""
BodyAxes: TypeAlias = Annotated[
    Body, msgspec.Meta(description="Axes of the body: `flu` is x forward, y left, z up.")
]
"""Body axes of a tracker, as a key of its configuration."""
LabAlignment: TypeAlias = Annotated[
    Alignment, msgspec.Meta(description="How these axes lie against ours, beyond their names.")
]
"""Alignment of a tracker, as a key of its configuration."""


class Axes(Protocol):
    """Axes in a source's configuration."""

    @property
    def world(self) -> World:
        """Names of the lab's axes."""

    @property
    def body(self) -> Body:
        """Names of the body's axes."""

    @property
    def alignment(self) -> Alignment:
        """Rotation and shift against our axes."""


class Frames:
    """Conversion from one source's axes into ours, and back."""

    def __init__(
        self, world: World = "ned", body: Body = "frd", alignment: Alignment | None = None
    ) -> None:
        """Take the names of the source's axes, and their ``alignment``; None: as they are named."""
        more = alignment or Alignment()
        lab, turned = _turn(more.lab_rotation_deg), _turn(more.body_rotation_deg)
        # R_ned_frd = R_ned_lab R_lab_body R_frd_bodyᵀ, which is linear in the quaternion: its
        # matrix has the images of the unit quaternions as columns.
        self._before = multiply(lab, _quaternion(world))
        self._after = conjugate(multiply(turned, _quaternion(body)))
        images = [
            self._turn_attitude((float(i == 0), float(i == 1), float(i == 2), float(i == 3)))
            for i in range(4)
        ]
        self._attitude_rows = tuple(zip(*images, strict=True))
        self._columns = tuple(to_world(lab, axis) for axis in axes(world))
        self._origin = more.lab_origin_m
        self._centre = more.centre_of_mass_m if any(more.centre_of_mass_m) else None

    def _turn_attitude(self, attitude: Quat) -> Quat:
        return multiply(multiply(self._before, attitude), self._after)

    def to_ours(self, position: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        """Convert a measured pose [m]; return position of the centre of mass [m, NED] and attitude,
        body FRD to NED.
        """
        w, x, y, z = attitude
        q0, q1, q2, q3 = (a * w + b * x + c * y + d * z for a, b, c, d in self._attitude_rows)
        ours = q0, q1, q2, q3
        place = self.convert_point(position)
        if self._centre is not None:
            dx, dy, dz = to_world(ours, self._centre)
            place = (place[0] + dx, place[1] + dy, place[2] + dz)
        return place, ours

    def convert_point(self, position: Vec3) -> Vec3:
        """Convert a point of the source's world [m] into ours [m, NED]."""
        x, y, z = position
        (a, b, c), (d, e, f), (g, h, i) = self._columns
        north, east, down = self._origin
        return (
            a * x + d * y + g * z + north,
            b * x + e * y + h * z + east,
            c * x + f * y + i * z + down,
        )

    def to_theirs(self, position_ned: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        """Invert :meth:`to_ours`, sign of the quaternion included: for simulated sources."""
        (x, y, z), (north, east, down) = position_ned, self._origin
        x, y, z = x - north, y - east, z - down
        if self._centre is not None:
            dx, dy, dz = to_world(attitude, self._centre)
            x, y, z = x - dx, y - dy, z - dz
        (a, b, c), (d, e, f), (g, h, i) = self._columns
        back = multiply(multiply(conjugate(self._before), attitude), conjugate(self._after))
        return (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z), back


def frames_of(axes: Axes) -> Frames:
    """Return the conversion from the axes of a configuration into ours."""
    return Frames(axes.world, axes.body, axes.alignment)


def axes(name: str) -> tuple[Vec3, Vec3, Vec3]:
    """Return unit vectors along the named x, y and z, in NED or FRD."""
    x, y, z = (_POINTING[letter] for letter in name)
    return x, y, z


def _quaternion(name: str) -> Quat:
    """Return the rotation from components along the named axes to NED, or FRD."""
    (a, b, c), (d, e, f), (g, h, i) = axes(name)
    return from_matrix(((a, d, g), (b, e, h), (c, f, i)))


def _turn(roll_pitch_yaw_deg: Vec3) -> Quat:
    roll, pitch, yaw = map(math.radians, roll_pitch_yaw_deg)
    return from_euler_zyx(roll, pitch, yaw)
