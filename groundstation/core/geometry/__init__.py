"""Elementary functions, rotations and frames, for floats and arrays of vehicles."""

from groundstation.core.geometry import so3 as so3
from groundstation.core.geometry.so3 import (
    FLOATS,
    IDENTITY,
    ZERO,
    Alignment,
    Body,
    BodyAxes,
    Frames,
    LabAlignment,
    LabAxes,
    Ops,
    Quat,
    Real,
    Vec3,
    World,
    angle_deg,
    arrays,
    axes,
    conjugate,
    euler_zyx,
    frames_of,
    heading,
    multiply,
    rotate,
    rotation_vector,
    third_column,
    third_row,
    to_body,
    to_world,
)
from groundstation.core.geometry.vectors import add, add_scaled, cross, interpolate, multiply_each, scale, subtract
