"""A carried vehicle shows its tracker's mapping of axes; mirrored ones are refused."""

import itertools
import math
from typing import get_args

import msgspec
import numpy as np
import pytest

from groundstation.core.geometry import Alignment, Body, Frames, Quat, Vec3, World, so3
from groundstation.lab import MOVES
from groundstation.lab.pose_stream import AxisCalibration, CarryFailure, solve_axes
from tests.carried import Measure, carried

WORLDS, BODIES = get_args(World), get_args(Body)


def found(measure: Measure, **more: float) -> AxisCalibration:
    carry, attitudes = carried(measure, **more)  # type: ignore[arg-type]  # numbers all of them
    assert carry.move is None, f"'{carry.move}' was not recognised"
    return solve_axes(carry.rests, carry.samples, attitudes)


# Each axis once; unit/groundstation/core/geometry/test_frames.py tries all 24 without noise.
@pytest.mark.tried(8)
@pytest.mark.parametrize("number", range(24))
def test_each_of_the_24_mappings_of_the_world_and_of_the_body_is_found(number: int) -> None:
    world, body = WORLDS[number], BODIES[(7 * number + 5) % 24]
    # Hands that hold it level within the 12 degrees that are asked for: about one in a hundred, as
    # of seed 2, does not, and is told so.
    carry, attitudes = carried(Frames(world, body).to_theirs, seed=24 + number)
    # With the autopilot's attitudes, and by the shown moves alone.
    result, alone = (solve_axes(carry.rests, carry.samples, told) for told in (attitudes, []))
    assert (result.world, result.body) == (alone.world, alone.body) == (world, body)
    assert result.lab_rotation_deg == result.body_rotation_deg == (0.0, 0.0, 0.0)
    assert (alone.late_s, alone.autopilot_north_deg) == (None, None)


def mirrors() -> list[np.ndarray]:
    matrices = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) < 0.0:
                matrices.append(matrix)
    return matrices


@pytest.mark.tried(8)  # each axis once
@pytest.mark.parametrize("number", range(24))
def test_each_of_the_24_mirrored_mappings_is_refused(number: int) -> None:
    lab, body = mirrors()[number], mirrors()[(5 * number + 7) % 24]

    def mirrored(place: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        x, y, z = lab @ np.array(place)
        (a, b, c), (d, e, f), (g, h, i) = lab @ np.array(so3.matrix(attitude)) @ body.T
        return (x, y, z), so3.from_matrix(((a, b, c), (d, e, f), (g, h, i)))

    carry, attitudes = carried(mirrored, seed=number)
    for told in (attitudes, []):
        with pytest.raises(CarryFailure, match="left-handed") as caught:
            solve_axes(carry.rests, carry.samples, told)
        assert caught.value.move == ""


@pytest.mark.parametrize(
    ("lab_deg", "body_deg"), [(35.0, (4.0, -3.0, 20.0)), (-20.0, (0.0, 6.0, -40.0))]
)
def test_a_lab_that_is_turned_and_a_body_that_lies_askew_are_measured(
    lab_deg: float, body_deg: Vec3
) -> None:
    alignment = Alignment(
        lab_rotation_deg=(0.0, 0.0, lab_deg),
        body_rotation_deg=body_deg,
        lab_origin_m=(1.0, 2.0, 0.0),
    )
    result = found(Frames("nwu", "flu", alignment).to_theirs, seed=3)
    assert (result.world, result.body) == ("nwu", "flu")
    assert result.lab_rotation_deg == pytest.approx((0.0, 0.0, lab_deg), abs=1.0)
    assert result.body_rotation_deg == pytest.approx(body_deg, abs=1.0)
    assert result.autopilot_north_deg == pytest.approx(-30.0, abs=1.0)


def test_what_is_found_brings_the_poses_into_our_axes() -> None:
    truth = Frames(
        "wds",
        "ulb",
        Alignment(lab_rotation_deg=(0.0, 0.0, 30.0), body_rotation_deg=(3.0, 5.0, 15.0)),
    )
    result = found(truth.to_theirs, seed=8)
    ours = Frames(
        result.world, result.body,
        Alignment(lab_rotation_deg=result.lab_rotation_deg,
            body_rotation_deg=result.body_rotation_deg),
    )  # fmt: skip
    attitude = so3.from_euler_zyx(0.1, 0.2, 0.3)
    place, seen = ours.to_ours(*truth.to_theirs((1.0, 2.0, -3.0), attitude))
    assert place == pytest.approx((1.0, 2.0, -3.0), abs=0.1)
    assert abs(sum(a * b for a, b in zip(seen, attitude, strict=True))) > math.cos(
        math.radians(1.0)
    )


@pytest.mark.parametrize(
    ("late_s", "seen_s"), [(-0.03, -0.03), (0.0, None), (0.012, 0.012), (0.045, 0.045)]
)
def test_how_late_poses_are_is_measured_within_some_milliseconds(
    late_s: float, seen_s: float | None
) -> None:
    result = found(Frames("nue", "fur").to_theirs, late_s=late_s, seed=4)
    assert result.late_s == (None if seen_s is None else pytest.approx(seen_s, abs=0.002))


@pytest.mark.parametrize(
    ("name", "instead", "words"),
    [
        ("right", (0.0, -1.0, 0.0), "went left"),
        ("up", (1.0, 0.0, 0.0), "went forward"),
        ("forward", (0.0, 1.0, 0.0), "went right"),
        ("roll right", (-1.0, 0.0, 0.0), "measured it roll left"),
        ("turn right", (0.0, 0.0, -1.0), "measured it turn left"),
        ("nose down", (0.0, 1.0, 0.0), "measured it tip its nose up"),
    ],
)
def test_a_move_that_was_not_made_as_shown_is_named(name: str, instead: Vec3, words: str) -> None:
    moves = [
        msgspec.structs.replace(move, axis=instead) if move.name == name else move for move in MOVES
    ]
    carry, attitudes = carried(Frames("nwu", "flu").to_theirs, moves=moves)
    with pytest.raises(CarryFailure, match=words) as caught:
        solve_axes(carry.rests, carry.samples, attitudes)
    assert caught.value.move == name


def test_a_tracker_that_follows_something_else_is_found_out() -> None:
    def other(place: Vec3, attitude: Quat) -> tuple[Vec3, Quat]:
        roll, pitch, yaw = so3.euler_zyx(attitude)
        return place, so3.from_euler_zyx(0.6 * roll, 0.6 * pitch, yaw)

    carry, attitudes = carried(other)
    with pytest.raises(CarryFailure, match="follow this vehicle"):
        solve_axes(carry.rests, carry.samples, attitudes)


def test_a_vehicle_that_does_not_stand_level_at_first_is_told() -> None:
    slope = Frames("ned", "frd", Alignment(lab_rotation_deg=(0.0, 20.0, 0.0)))
    carry, attitudes = carried(slope.to_theirs)
    with pytest.raises(CarryFailure, match="axes are tilted"):
        solve_axes(carry.rests, carry.samples, attitudes)
