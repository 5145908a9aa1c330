"""Elementary functions, rotations and frames, for floats and arrays of vehicles."""

from groundstation.core.geometry import so3 as so3
from groundstation.core.geometry.frames import (
    FARTHEST_M,
    Alignment,
    Body,
    BodyAxes,
    Coordinate,
    Frames,
    LabAlignment,
    LabAxes,
    World,
    axes,
    frames_of,
)
from groundstation.core.geometry.so3 import (
    FLOATS,
    IDENTITY,
    ZERO,
    Ops,
    Quat,
    Real,
    Vec3,
    angle_deg,
    arrays,
    conjugate,
    euler_zyx,
    heading,
    multiply,
    rotate,
    rotation_vector,
    third_column,
    third_row,
    to_body,
    to_world,
)
from groundstation.core.geometry.vectors import (
    add,
    add_scaled,
    cross,
    interpolate,
    multiply_each,
    scale,
    subtract,
)
