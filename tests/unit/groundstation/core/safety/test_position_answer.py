"""What a position answers to the tones that it is asked by, on made-up motions in wind."""

import math
import random

import pytest

from groundstation.core.control import ASK_THRUST_RAD_S, ASK_TONES_RAD_S
from groundstation.core.control.descent import ASK_RAD_S, ASK_SHARE
from groundstation.core.geometry import Vec3
from groundstation.core.safety.rivals import PositionAnswer

H, NOISE_M, G = 0.1, 0.0006, 9.81
SWINGS_M = 0.006


def answer(t: float) -> list[float]:
    """What the tones make of a position of which nothing else is asked: three integrals of the rates, NED [m]."""
    level = sum(-ASK_RAD_S * G * tone**-3 * complex(math.cos(tone * t), math.sin(tone * t)) for tone in ASK_TONES_RAD_S)
    return [level.real, level.imag, ASK_SHARE * G * ASK_THRUST_RAD_S**-2 * math.cos(ASK_THRUST_RAD_S * t)]


def found(
    shares: Vec3 = (1.0, 1.0, 1.0), *, wind_m: float = 0.0, loud: float = 1.0, late_s: float = 0.08,
    swings_m: float = 0.0, asked: bool = True, seed: int = 0, for_s: float = 20.0,
) -> float:  # fmt: skip
    """The largest share of what ends a flight, where each axis shows such a share of what moves it."""
    question, normals = PositionAnswer(), random.Random(seed)
    wind, most = [0.0, 0.0, 0.0], 0.0
    for n in range(round(for_s / H)):
        t = n * H
        swing = complex(math.cos(5.0 * t), math.sin(5.0 * t))  # of what else the law does
        moved = [
            loud * m + swings_m * w
            for m, w in zip(answer(t - late_s), (swing.real, swing.imag, swing.real), strict=True)
        ]
        before, wind = wind, [0.7 * w + wind_m * normals.gauss(0.0, 0.7) for w in wind]
        told = [m - w for m, w in zip(moved, before, strict=True)]  # the law brings the wind to nothing, a node late
        truth = [m + w - b for m, w, b in zip(moved, wind, before, strict=True)]
        seen = [share * m + normals.gauss(0.0, NOISE_M) for share, m in zip(shares, truth, strict=True)]
        most = max(
            most, question.node(t, H, (seen[0], seen[1], seen[2]), (told[0], told[1], told[2]), NOISE_M, asked=asked)
        )
    return most


@pytest.mark.parametrize("late_s", [0.02, 0.08, 0.14])
@pytest.mark.parametrize("seed", range(5))
def test_a_vehicle_that_answers_is_not_accused_however_late_its_thrust_and_rates(seed: int, late_s: float) -> None:
    assert found(seed=seed, late_s=late_s) < 0.3


@pytest.mark.parametrize("seed", range(3))
def test_neither_wind_nor_noise_takes_away_the_answer_of_a_long_hold_by_chance(seed: int) -> None:
    assert found(wind_m=0.0015, seed=seed, for_s=1200.0) < 0.5


@pytest.mark.parametrize(
    "shares", [(0.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.1, 0.1)]
)
@pytest.mark.parametrize("late_s", [0.05, 0.08, 0.14])
def test_a_coordinate_that_does_not_answer_ends_it(shares: Vec3, late_s: float) -> None:
    assert found(shares, late_s=late_s) >= 1.0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("shares", [(0.0, 1.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 0.0)])
def test_a_coordinate_that_does_not_answer_ends_it_though_the_law_moves_it_more_than_the_question(
    shares: Vec3, seed: int
) -> None:
    assert found(shares, swings_m=SWINGS_M, seed=seed, for_s=6.0) >= 1.0


@pytest.mark.parametrize("seed", range(3))
def test_a_vehicle_that_answers_while_the_law_moves_it_more_than_the_question_is_not_accused(seed: int) -> None:
    assert found(swings_m=SWINGS_M, wind_m=0.001, seed=seed, for_s=600.0) < 0.5


@pytest.mark.parametrize("seed", range(5))
def test_in_a_storm_where_the_law_moves_it_more_than_the_question_does_nothing_is_concluded(seed: int) -> None:
    assert found(wind_m=0.01, seed=seed) < 0.6


def test_nothing_is_concluded_where_nothing_is_asked() -> None:
    assert found((0.0, 0.0, 0.0), asked=False) == 0.0


def test_a_question_that_drowns_in_noise_is_none() -> None:
    assert found((0.0, 0.0, 0.0), loud=0.1) < 1.0
