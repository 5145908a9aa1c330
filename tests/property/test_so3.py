"""Quaternions against rotation matrices computed another way (numpy, Rodrigues)."""

import math

import numpy as np
import numpy.typing as npt
from hypothesis import given, strategies as st

from groundstation.core.geometry import Quat, Vec3, arrays, cross, so3

Matrix = npt.NDArray[np.float64]

component = st.floats(-1.0, 1.0)
vector = st.tuples(component, component, component)
unit = vector.filter(lambda v: math.hypot(*v) > 1e-3).map(lambda v: scaled(v, 1.0 / math.hypot(*v)))
quaternion = (
    st.tuples(component, component, component, component)
    .filter(lambda q: math.hypot(*q) > 1e-3)
    .map(so3.normalize)
)


def scaled(v: Vec3, k: float) -> Vec3:
    return (k * v[0], k * v[1], k * v[2])


def rodrigues(axis: Vec3, angle: float) -> Matrix:
    """exp(S(axis angle))."""
    x, y, z = axis
    s = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * s + (1.0 - math.cos(angle)) * (s @ s))


def about(axis: Vec3, angle: float) -> Quat:
    return (math.cos(angle / 2.0), *scaled(axis, math.sin(angle / 2.0)))


def matrix(q: Quat) -> Matrix:
    return np.array(so3.matrix(q))


def near(a: object, b: object, tolerance: float = 1e-14) -> bool:
    return bool(np.allclose(np.asarray(a), np.asarray(b), rtol=0.0, atol=tolerance))


@given(unit, st.floats(-math.pi, math.pi))
def test_a_turn_about_an_axis_is_the_matrix_of_rodrigues(axis: Vec3, angle: float) -> None:
    assert near(matrix(about(axis, angle)), rodrigues(axis, angle))


@given(quaternion, quaternion)
def test_the_product_of_quaternions_is_the_product_of_matrices(a: Quat, b: Quat) -> None:
    assert near(matrix(so3.multiply(a, b)), matrix(a) @ matrix(b))


@given(quaternion, vector)
def test_vectors_turn_as_the_matrix_turns_them(q: Quat, v: Vec3) -> None:
    assert near(so3.to_world(q, v), matrix(q) @ v)
    assert near(so3.to_body(q, v), matrix(q).T @ v)
    assert near(so3.to_world(so3.conjugate(q), v), matrix(q).T @ v)
    assert near(so3.third_column(q), matrix(q)[:, 2])
    assert near(cross(v, so3.third_column(q)), np.cross(v, matrix(q)[:, 2]))


@given(quaternion)
def test_a_matrix_gives_its_quaternion_back(q: Quat) -> None:
    back = so3.from_matrix(so3.matrix(q))
    assert back[0] >= 0.0
    assert near(back, q) or near(back, tuple(-c for c in q))


@given(unit, st.sampled_from([math.pi, math.pi - 1e-9, math.pi - 1e-6]))
def test_a_matrix_of_half_a_turn_gives_its_axis(axis: Vec3, angle: float) -> None:
    q = so3.from_matrix(so3.matrix(about(axis, angle)))
    overlap = abs(sum(a * b for a, b in zip(q, about(axis, angle), strict=True)))
    assert math.isclose(overlap, 1.0, abs_tol=1e-13)


@given(unit, st.floats(0.0, math.pi * (1.0 - 1e-9)))
def test_the_rotation_vector_is_axis_times_angle_for_either_sign(axis: Vec3, angle: float) -> None:
    q = about(axis, angle)
    assert near(so3.rotation_vector(q), scaled(axis, angle), 1e-13)
    assert near(so3.rotation_vector((-q[0], -q[1], -q[2], -q[3])), scaled(axis, angle), 1e-13)


@given(unit, st.floats(0.0, 1e-6))
def test_the_smallest_rotation_vector_keeps_its_digits(axis: Vec3, angle: float) -> None:
    assert near(
        so3.rotation_vector(about(axis, angle)), scaled(axis, angle), angle * 1e-14 + 1e-300
    )


@given(quaternion, unit, st.floats(0.0, 0.3))
def test_a_small_turn_is_the_exponential_to_a_nanoradian(q: Quat, axis: Vec3, angle: float) -> None:
    got = so3.rotate(q, scaled(axis, angle))
    exact = so3.multiply(q, about(axis, angle))
    assert math.isclose(math.hypot(*got), 1.0, abs_tol=1e-15)
    assert math.hypot(*so3.rotation_vector(so3.multiply(so3.conjugate(exact), got))) < 1e-9


@given(st.floats(-3.1, 3.1), st.floats(-1.57, 1.57), st.floats(-3.1, 3.1))
def test_roll_pitch_and_yaw_are_turns_about_z_then_y_then_x(
    roll: float, pitch: float, yaw: float
) -> None:
    q = so3.from_euler_zyx(roll, pitch, yaw)
    z, y, x = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
    assert near(matrix(q), rodrigues(z, yaw) @ rodrigues(y, pitch) @ rodrigues(x, roll))
    # Roll and yaw lose digits as pitch nears 90°, and so does pitch, whose sine is flat there.
    assert near(so3.euler_zyx(q), (roll, pitch, yaw), 1e-14 / math.cos(pitch) + 1e-14)


@given(st.lists(st.tuples(quaternion, vector), min_size=1, max_size=5))
def test_arrays_of_vehicles_get_the_numbers_of_each_alone(
    vehicles: list[tuple[Quat, Vec3]],
) -> None:
    ops = arrays()
    w, x, y, z = np.array([q for q, _ in vehicles]).T
    a, b, c = np.array([v for _, v in vehicles]).T
    turned = np.array(so3.rotate((w, x, y, z), (0.1 * a, 0.1 * b, 0.1 * c))).T
    vectors = np.array(so3.rotation_vector((w, x, y, z), ops)).T
    angles = np.array(so3.euler_zyx((w, x, y, z), ops)).T
    for i, (q, v) in enumerate(vehicles):
        assert tuple(turned[i]) == so3.rotate(q, (0.1 * v[0], 0.1 * v[1], 0.1 * v[2]))
        assert near(vectors[i], so3.rotation_vector(q))
        assert near(angles[i], so3.euler_zyx(q))
