"""Fixed physical situations, each worked out by hand: a round trip would pass with two mistakes that cancel."""

import itertools
import math
from typing import get_args

import pytest

from groundstation import so3
from groundstation.frames import (
    Body,
    World,
    attitude_from_ned_frd,
    attitude_to_ned_frd,
    pose_from_ned_frd,
    pose_to_ned_frd,
    to_frd,
    to_ned,
)
from groundstation.ops import Quat, Vec3

WORLDS: tuple[World, ...] = get_args(World)
BODIES: tuple[Body, ...] = get_args(Body)
FRAMES = list(itertools.product(WORLDS, BODIES))
S10, C10 = math.sin(math.radians(10.0)), math.cos(math.radians(10.0))


def about(axis: Vec3, degrees: float) -> Quat:
    """Right-handed turn about a unit axis."""
    half = math.radians(degrees) / 2.0
    return (math.cos(half), math.sin(half) * axis[0], math.sin(half) * axis[1], math.sin(half) * axis[2])


X: Vec3 = (1.0, 0.0, 0.0)
Y: Vec3 = (0.0, 1.0, 0.0)
Z: Vec3 = (0.0, 0.0, 1.0)


def assert_axes(attitude: Quat, forward: Vec3, right: Vec3) -> None:
    """The body's forward and right axes point this way in NED."""
    assert math.hypot(*attitude) == pytest.approx(1.0, abs=1e-15)
    assert so3.to_world(attitude, X) == pytest.approx(forward, abs=1e-15)
    assert so3.to_world(attitude, Y) == pytest.approx(right, abs=1e-15)


@pytest.mark.parametrize(
    ("world", "position"),
    [("ned", (0.0, 2.0, -1.0)), ("enu", (2.0, 0.0, 1.0)), ("nwu", (0.0, -2.0, 1.0)), ("nue", (0.0, 1.0, 2.0))],
)
def test_a_vehicle_two_metres_east_of_the_origin_and_one_up(world: World, position: Vec3) -> None:
    assert to_ned(position, world) == (0.0, 2.0, -1.0)


@pytest.mark.parametrize(
    ("world", "position"),
    [("ned", (3.0, 0.0, 0.5)), ("enu", (0.0, 3.0, -0.5)), ("nwu", (3.0, 0.0, -0.5)), ("nue", (3.0, -0.5, 0.0))],
)
def test_a_vehicle_three_metres_north_and_half_a_metre_below(world: World, position: Vec3) -> None:
    assert to_ned(position, world) == (3.0, 0.0, 0.5)


@pytest.mark.parametrize(
    ("world", "body", "attitude"),
    [
        # Level, nose to the north. In enu the x axis of the lab is east: the nose is turned 90° to the left of it.
        ("ned", "frd", so3.IDENTITY),
        ("nwu", "flu", so3.IDENTITY),
        ("enu", "flu", about(Z, 90.0)),
        ("ned", "flu", about(X, 180.0)),
        ("nwu", "frd", about(X, 180.0)),
        ("nue", "fur", so3.IDENTITY),
    ],
)
def test_level_and_nose_north(world: World, body: Body, attitude: Quat) -> None:
    assert_axes(attitude_to_ned_frd(attitude, world, body), forward=(1.0, 0.0, 0.0), right=(0.0, 1.0, 0.0))


@pytest.mark.parametrize(
    ("world", "body", "attitude"),
    [
        ("ned", "frd", about(Z, 90.0)),  # z down: right-handed is north to east
        ("nwu", "flu", about(Z, -90.0)),  # z up
        ("enu", "flu", so3.IDENTITY),
        ("enu", "frd", about(X, 180.0)),
        ("nue", "fur", about(Y, -90.0)),  # y up
    ],
)
def test_level_and_nose_east(world: World, body: Body, attitude: Quat) -> None:
    assert_axes(attitude_to_ned_frd(attitude, world, body), forward=(0.0, 1.0, 0.0), right=(-1.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("world", "body", "attitude"),
    [
        ("ned", "frd", about(Y, 10.0)),  # y right: right-handed lifts the nose
        ("nwu", "flu", about(Y, -10.0)),  # y left: right-handed lowers it
        ("nue", "fur", about(Z, 10.0)),  # z right
    ],
)
def test_nose_up_ten_degrees_raises_the_x_axis(world: World, body: Body, attitude: Quat) -> None:
    # Up is -z in NED.
    assert_axes(attitude_to_ned_frd(attitude, world, body), forward=(C10, 0.0, -S10), right=(0.0, 1.0, 0.0))


def test_nose_up_ten_degrees_while_facing_east_in_enu() -> None:
    # Body and lab axes coincide but for the tilt: about y, which points left (north), by minus 10°.
    assert_axes(attitude_to_ned_frd(about(Y, -10.0), "enu", "flu"), forward=(0.0, C10, -S10), right=(-1.0, 0.0, 0.0))


@pytest.mark.parametrize(("world", "body"), [("ned", "frd"), ("nwu", "flu"), ("nue", "fur")])
def test_rolled_right_ten_degrees_lowers_the_right_side(world: World, body: Body) -> None:
    # x is forward in all, so rolling right is right-handed in all. Down is +z in NED.
    assert_axes(attitude_to_ned_frd(about(X, 10.0), world, body), forward=(1.0, 0.0, 0.0), right=(0.0, C10, S10))


def test_rolled_right_while_facing_east_in_enu_lowers_the_south_side() -> None:
    assert_axes(attitude_to_ned_frd(about(X, 10.0), "enu", "flu"), forward=(0.0, 1.0, 0.0), right=(-C10, 0.0, S10))


def test_thrust_of_a_level_vehicle_points_up_whatever_the_frames() -> None:
    # The body axis that points up is -z in frd, +z in flu; in NED it must be (0, 0, -1): R e3 = +e3.
    cases: list[tuple[World, Quat]] = [("nwu", so3.IDENTITY), ("enu", about(Z, 30.0))]
    for world, level in cases:
        attitude = attitude_to_ned_frd(level, world, "flu")
        assert so3.third_column(attitude) == pytest.approx((0.0, 0.0, 1.0), abs=1e-15)


def test_rates_of_a_left_turn_seen_from_above() -> None:
    # Counter-clockwise from above: +z in flu (z up), -z in frd. Rolling right is +x in both.
    assert to_frd((0.1, 0.2, 0.3), "flu") == (0.1, -0.2, -0.3)
    assert to_frd((0.1, 0.2, 0.3), "frd") == (0.1, 0.2, 0.3)
    assert to_frd((0.1, 0.2, 0.3), "fur") == (0.1, 0.3, -0.2)


@pytest.mark.parametrize(("world", "body"), FRAMES)
def test_the_way_back_gives_the_same_numbers_with_the_same_sign(world: World, body: Body) -> None:
    attitude = so3.normalized((0.5, -0.1, 0.7, 0.3))
    position = (1.25, -2.5, 0.75)
    back = pose_from_ned_frd(*pose_to_ned_frd(position, attitude, world, body), world, body)
    assert back[0] == position
    assert back[1] == pytest.approx(attitude, abs=1e-15)
    assert attitude_to_ned_frd(attitude_from_ned_frd(attitude, world, body), world, body) == pytest.approx(
        attitude, abs=1e-15
    )


@pytest.mark.parametrize(("world", "body"), FRAMES)
def test_one_physical_attitude_has_one_answer(world: World, body: Body) -> None:
    # Rows of H: which lab axis is north, east, down; columns of B: the frd axes in the named body.
    to_ned_rows = {
        "ned": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        "enu": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
        "nwu": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
        "nue": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    }[world]
    # Which axis of the body is forward, right, down, and its sign.
    frd = {"frd": ((0, 1), (1, 1), (2, 1)), "flu": ((0, 1), (1, -1), (2, -1)), "fur": ((0, 1), (2, 1), (1, -1))}[body]
    attitude = so3.normalized((0.3, 0.6, -0.2, 0.7))
    rows = so3.matrix(attitude)
    expected = [[sum(to_ned_rows[i][k] * rows[k][j] for k in range(3)) * sign for j, sign in frd] for i in range(3)]
    got = so3.matrix(attitude_to_ned_frd(attitude, world, body))
    for i in range(3):
        assert got[i] == pytest.approx(expected[i], abs=1e-15)
