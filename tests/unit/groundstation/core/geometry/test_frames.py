"""Fixed physical situations, each worked out by hand: a round trip would pass with two mistakes that cancel."""

import itertools
import math
from typing import get_args

import pytest

from groundstation.config import ConfigError, from_dict
from groundstation.core.geometry import Alignment, Body, Frames, Quat, Vec3, World, so3
from groundstation.settings import Config

WORLDS: tuple[World, ...] = get_args(World)
BODIES: tuple[Body, ...] = get_args(Body)
S10, C10 = math.sin(math.radians(10.0)), math.cos(math.radians(10.0))


def about(axis: Vec3, degrees: float) -> Quat:
    """Right-handed turn about a unit axis."""
    half = math.radians(degrees) / 2.0
    return (math.cos(half), math.sin(half) * axis[0], math.sin(half) * axis[1], math.sin(half) * axis[2])


X: Vec3 = (1.0, 0.0, 0.0)
Y: Vec3 = (0.0, 1.0, 0.0)
Z: Vec3 = (0.0, 0.0, 1.0)


def position(given: Vec3, world: World, alignment: Alignment | None = None) -> Vec3:
    """Where it is in NED."""
    return Frames(world, "frd", alignment).ours(given, so3.IDENTITY)[0]


def attitude(given: Quat, world: World, body: Body, alignment: Alignment | None = None) -> Quat:
    """How it is turned, FRD to NED."""
    return Frames(world, body, alignment).ours((0.0, 0.0, 0.0), given)[1]


def assert_axes(turn: Quat, forward: Vec3, right: Vec3) -> None:
    """The body's forward and right axes point this way in NED."""
    assert math.hypot(*turn) == pytest.approx(1.0, abs=1e-15)
    assert so3.to_world(turn, X) == pytest.approx(forward, abs=1e-15)
    assert so3.to_world(turn, Y) == pytest.approx(right, abs=1e-15)


# What the vehicle does: where its nose and its right side point, NED. Up is -z.
NORTH = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
EAST = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
NOSE_UP = ((C10, 0.0, -S10), (0.0, 1.0, 0.0))
NOSE_UP_EAST = ((0.0, C10, -S10), (-1.0, 0.0, 0.0))
ROLLED_RIGHT = ((1.0, 0.0, 0.0), (0.0, C10, S10))
ROLLED_RIGHT_EAST = ((0.0, 1.0, 0.0), (-C10, 0.0, S10))


@pytest.mark.parametrize(("points", "world", "body", "given"), [
    # In enu the x axis of the lab is east: a nose to the north is turned 90° to the left of it.
    (NORTH, "ned", "frd", so3.IDENTITY), (NORTH, "nwu", "flu", so3.IDENTITY), (NORTH, "enu", "flu", about(Z, 90.0)),
    (NORTH, "ned", "flu", about(X, 180.0)), (NORTH, "nwu", "frd", about(X, 180.0)), (NORTH, "nue", "fur", so3.IDENTITY),
    (EAST, "ned", "frd", about(Z, 90.0)),  # z down: right-handed is north to east
    (EAST, "nwu", "flu", about(Z, -90.0)),  # z up
    (EAST, "enu", "flu", so3.IDENTITY), (EAST, "enu", "frd", about(X, 180.0)),
    (EAST, "nue", "fur", about(Y, -90.0)),  # y up
    (NOSE_UP, "ned", "frd", about(Y, 10.0)),  # y right: right-handed lifts the nose
    (NOSE_UP, "nwu", "flu", about(Y, -10.0)),  # y left: right-handed lowers it
    (NOSE_UP, "nue", "fur", about(Z, 10.0)),  # z right
    # Body and lab axes coincide but for the tilt: about y, which points left (north), by minus 10°.
    (NOSE_UP_EAST, "enu", "flu", about(Y, -10.0)),
    # x is forward in all, so rolling right is right-handed in all.
    (ROLLED_RIGHT, "ned", "frd", about(X, 10.0)), (ROLLED_RIGHT, "nwu", "flu", about(X, 10.0)),
    (ROLLED_RIGHT, "nue", "fur", about(X, 10.0)), (ROLLED_RIGHT_EAST, "enu", "flu", about(X, 10.0)),
])  # fmt: skip
def test_an_attitude_points_the_same_way_in_all_axes(
    points: tuple[Vec3, Vec3], world: World, body: Body, given: Quat
) -> None:
    assert_axes(attitude(given, world, body), forward=points[0], right=points[1])


def test_every_right_handed_name_is_known_and_no_other() -> None:
    for known, pairs in ((WORLDS, ("ns", "ew", "du")), (BODIES, ("fb", "rl", "du"))):
        right = set()
        for order in itertools.permutations(range(3)):
            for flips in itertools.product((0, 1), repeat=3):
                odd = sum(order[j] > order[i] for i in range(3) for j in range(i)) % 2
                if (odd + sum(flips)) % 2 == 0:
                    right.add("".join(pairs[axis][flip] for axis, flip in zip(order, flips, strict=True)))
        assert len(known) == 24
        assert set(known) == right


@pytest.mark.parametrize("name", ["neu", "nwd", "enz", "", "NED"])
def test_a_mirrored_or_unknown_name_is_refused_with_those_there_are(name: str) -> None:
    with pytest.raises(ConfigError, match=rf"pose\.world: expected one of \[.*'nwu'.*\], got '{name}'"):
        from_dict({"pose": {"kind": "vicon", "world": name}}, Config)


def towards(letter: str) -> Vec3:
    """Where a letter of a name points, in NED or FRD."""
    for axis, (ahead, behind) in enumerate((("nf", "sb"), ("er", "wl"), ("d", "u"))):
        if letter in ahead + behind:
            sign = 1.0 if letter in ahead else -1.0
            return (sign * (axis == 0), sign * (axis == 1), sign * (axis == 2))
    raise AssertionError(letter)


@pytest.mark.parametrize("world", WORLDS)
def test_each_axis_of_the_lab_points_where_its_letter_says(world: World) -> None:
    assert [position(axis, world) for axis in (X, Y, Z)] == [towards(letter) for letter in world]


@pytest.mark.parametrize(
    ("given", "centre"),
    [
        (so3.IDENTITY, (1.0, 0.0, 0.06)),  # level: below
        (about(X, 90.0), (1.0, -0.06, 0.0)),  # on its right side, nose north: its belly looks west
        (about(Y, 90.0), (1.06, 0.0, 0.0)),  # nose up: its belly looks ahead, where the nose was
    ],
)
def test_markers_six_centimetres_above_the_centre_of_mass(given: Quat, centre: Vec3) -> None:
    markers = Alignment(centre_of_mass_m=(0.0, 0.0, 0.06))
    place, _ = Frames("ned", "frd", markers).ours((1.0, 0.0, 0.0), given)
    assert place == pytest.approx(centre, abs=1e-15)


def test_everything_at_once() -> None:
    # y up; the lab's north is our east; its origin is half a metre north of ours and 1 m up. The markers' forward
    # lies to the right of the nose, their centre 10 cm behind that of mass. They are 2 m "north" and 1 m up, looking
    # "north", which is east: so the nose looks north.
    alignment = Alignment(
        lab_rotation_deg=(0.0, 0.0, 90.0), lab_origin_m=(0.5, 0.0, -1.0), body_rotation_deg=(0.0, 0.0, 90.0),
        centre_of_mass_m=(0.1, 0.0, 0.0),
    )  # fmt: skip
    place, turn = Frames("nue", "fur", alignment).ours((2.0, 1.0, 0.0), so3.IDENTITY)
    assert place == pytest.approx((0.6, 2.0, -2.0), abs=1e-15)
    assert_axes(turn, forward=(1.0, 0.0, 0.0), right=(0.0, 1.0, 0.0))


ANY = Alignment(
    lab_rotation_deg=(5.0, -12.0, 130.0), lab_origin_m=(1.5, -0.25, 0.5), body_rotation_deg=(-3.0, 8.0, -75.0),
    centre_of_mass_m=(0.02, -0.01, 0.05),
)  # fmt: skip


@pytest.mark.parametrize("alignment", [Alignment(), ANY], ids=["named", "aligned"])
def test_the_way_back_gives_the_same_numbers_with_the_same_sign(alignment: Alignment) -> None:
    given, place = so3.normalize((0.5, -0.1, 0.7, 0.3)), (1.25, -2.5, 0.75)
    for world, body in itertools.product(WORLDS, BODIES):
        frames = Frames(world, body, alignment)
        back = frames.theirs(*frames.ours(place, given))
        assert back[0] == pytest.approx(place, abs=1e-14)
        assert back[1] == pytest.approx(given, abs=1e-14)
