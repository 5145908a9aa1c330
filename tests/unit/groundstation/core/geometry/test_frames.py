"""Axes by their letters, and situations by hand: in a round trip two mistakes may cancel."""

import itertools
import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, strategies as st

from groundstation.core.geometry import Alignment, Body, Frames, Quat, Vec3, World, so3

WORLDS: tuple[World, ...] = get_args(World)
BODIES: tuple[Body, ...] = get_args(Body)
turns = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: math.hypot(*q) > 0.1).map(so3.normalize)
)


def about(axis: Vec3, degrees: float) -> Quat:
    """Right-handed turn about a unit axis."""
    half = math.radians(degrees) / 2.0
    x, y, z = (math.sin(half) * part for part in axis)
    return (math.cos(half), x, y, z)


X: Vec3 = (1.0, 0.0, 0.0)
Y: Vec3 = (0.0, 1.0, 0.0)
Z: Vec3 = (0.0, 0.0, 1.0)


def position(given: Vec3, world: World, alignment: Alignment | None = None) -> Vec3:
    """Where it is in NED."""
    return Frames(world, "frd", alignment).to_ours(given, so3.IDENTITY)[0]


def assert_axes(turn: Quat, forward: Vec3, right: Vec3) -> None:
    """The body's forward and right axes point this way in NED."""
    assert math.hypot(*turn) == pytest.approx(1.0, abs=1e-15)
    assert so3.to_world(turn, X) == pytest.approx(forward, abs=1e-15)
    assert so3.to_world(turn, Y) == pytest.approx(right, abs=1e-15)


def test_every_right_handed_name_is_known_and_no_other() -> None:
    for known, pairs in ((WORLDS, ("ns", "ew", "du")), (BODIES, ("fb", "rl", "du"))):
        right = set()
        for order in itertools.permutations(range(3)):
            for flips in itertools.product((0, 1), repeat=3):
                odd = sum(order[j] > order[i] for i in range(3) for j in range(i)) % 2
                if (odd + sum(flips)) % 2 == 0:
                    right.add(
                        "".join(pairs[axis][flip] for axis, flip in zip(order, flips, strict=True))
                    )
        assert len(known) == 24
        assert set(known) == right


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


@given(st.sampled_from(WORLDS), st.sampled_from(BODIES), turns)
def test_each_axis_of_the_body_points_where_a_turn_in_the_labs_axes_takes_it(
    world: World, body: Body, turn: Quat
) -> None:
    attitude = Frames(world, body, None).to_ours((0.0, 0.0, 0.0), turn)[1]
    assert math.hypot(*attitude) == pytest.approx(1.0, abs=1e-15)
    for letter, axis in zip(body, (X, Y, Z), strict=True):
        points = np.array(so3.to_world(turn, axis)) @ [towards(one) for one in world]
        assert so3.to_world(attitude, towards(letter)) == pytest.approx(points.tolist(), abs=1e-14)


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
    place, _ = Frames("ned", "frd", markers).to_ours((1.0, 0.0, 0.0), given)
    assert place == pytest.approx(centre, abs=1e-15)


def test_everything_at_once() -> None:
    # y up; the lab's north is our east; its origin is half a metre north of ours and 1 m up. The
    # markers' forward lies to the right of the nose, their centre 10 cm behind that of mass. They
    # are 2 m "north" and 1 m up, looking "north", which is east: so the nose looks north.
    alignment = Alignment(
        lab_rotation_deg=(0.0, 0.0, 90.0),
        lab_origin_m=(0.5, 0.0, -1.0),
        body_rotation_deg=(0.0, 0.0, 90.0),
        centre_of_mass_m=(0.1, 0.0, 0.0),
    )
    place, turn = Frames("nue", "fur", alignment).to_ours((2.0, 1.0, 0.0), so3.IDENTITY)
    assert place == pytest.approx((0.6, 2.0, -2.0), abs=1e-15)
    assert_axes(turn, forward=(1.0, 0.0, 0.0), right=(0.0, 1.0, 0.0))


ANY = Alignment(
    lab_rotation_deg=(5.0, -12.0, 130.0),
    lab_origin_m=(1.5, -0.25, 0.5),
    body_rotation_deg=(-3.0, 8.0, -75.0),
    centre_of_mass_m=(0.02, -0.01, 0.05),
)


@pytest.mark.parametrize("alignment", [Alignment(), ANY], ids=["named", "aligned"])
def test_the_way_back_gives_the_same_numbers_with_the_same_sign(alignment: Alignment) -> None:
    given, place = so3.normalize((0.5, -0.1, 0.7, 0.3)), (1.25, -2.5, 0.75)
    for world, body in itertools.product(WORLDS, BODIES):
        frames = Frames(world, body, alignment)
        back = frames.to_theirs(*frames.to_ours(place, given))
        assert back[0] == pytest.approx(place, abs=1e-14)
        assert back[1] == pytest.approx(given, abs=1e-14)
