"""The rival test on made-up motions: positions that show a part of the push, winds that the law answers, and leaps."""

import math
from collections.abc import Callable
from itertools import pairwise

import pytest

from groundstation.core.geometry import Vec3
from groundstation.core.safety.rivals import NOISES, Rivals

H, NOISE_M = 0.1, 0.0003
STEPS = 10
"""Steps of the motion from node to node."""
SETTLED_S = 3.0

Along = Callable[[float], float]
"""An acceleration over time [m/s²]."""


def calm(_: float) -> float:
    """None."""
    return 0.0


def highest(
    push: Along, wind: Along = calm, *, share: float = 1.0, for_s: float = 6.0, moves_m_s: float = 0.0,
    noise_m: float = NOISE_M,
) -> float:  # fmt: skip
    """The largest share in a flight whose north shows ``share`` of the motion from :data:`SETTLED_S` on."""
    rivals, x, v, told, told_v, shown = Rivals(), 0.0, moves_m_s, 0.0, 0.0, 0.0
    rivals.begin((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    found, step = 0.0, H / STEPS
    nodes = [k * H for k in range(1, round((SETTLED_S + for_s) / H))]
    for begun_s, _ in pairwise(nodes):
        leapt = abs(begun_s - SETTLED_S) < 0.5 * H and share != 1.0 and abs(v) > 0.24
        for i in range(STEPS):
            t = begun_s + i * step
            u, d = push(t), wind(t)
            dx = step * (v + 0.5 * step * (u + d))
            x, v = x + dx, v + step * (u + d)
            told, told_v = told + step * (told_v + 0.5 * step * u), told_v + step * u
            shown += dx if t < SETTLED_S else share * dx
        seen: Vec3 = (shown, 0.0, 0.0)
        found = max(found, rivals.node(seen, (told, 0.0, 0.0), H, NOISES * noise_m, leapt=leapt))
    return found


class Pushed:
    """A body along one axis, by what pushes it."""

    def __init__(self) -> None:
        self.at = self._speed = 0.0

    def move(self, push: float) -> None:
        """To the next node, by so much [m/s²]."""
        self.at += H * (self._speed + 0.5 * H * push)
        self._speed += H * push


def swings(most: float, rate: float, begins_s: float = 0.0) -> Along:
    """To and fro."""
    return lambda t: most * math.sin(rate * (t - begins_s)) if t > begins_s else 0.0


@pytest.mark.parametrize("gain", [0.6, 1.0, 1.6])
def test_a_vehicle_that_obeys_speaks_for_no_rival(gain: float) -> None:
    # What it gives more or less than told looks like a wind in step with the commands.
    push = swings(2.5, 3.0)
    assert highest(push, lambda t: (gain - 1.0) * push(t)) < 0.8


@pytest.mark.parametrize(("most", "rate"), [(1.0, 1.9), (1.5, 1.2), (1.5, 1.9), (2.0, 2.5)])
def test_a_wind_that_a_law_answers_a_quarter_of_a_second_later_speaks_for_no_rival(most: float, rate: float) -> None:
    wind = swings(most, rate)
    assert highest(lambda t: -wind(t - 0.25), wind) < 0.8


@pytest.mark.parametrize("most", [1.5, 3.0, 3.7])
def test_a_gust_that_sets_in_at_once_is_believed_as_it_moves_the_picture(most: float) -> None:
    def wind(t: float) -> float:
        return most if t > SETTLED_S else 0.0

    assert highest(lambda t: -wind(t - 0.3), wind) < 0.8


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_a_coordinate_that_shows_a_small_part_of_what_pushes_it_ends_a_flight(share: float) -> None:
    assert highest(swings(5.0, 2.0, SETTLED_S), share=share, for_s=2.0) >= 1.0


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_a_coordinate_that_loses_its_speed_from_one_pose_to_the_next_is_seen_at_once(share: float) -> None:
    assert highest(calm, share=share, for_s=0.6, moves_m_s=0.4) >= 1.0


def test_a_tracker_as_noisy_as_a_speed_tells_nothing_of_a_leap() -> None:
    assert highest(calm, share=0.0, for_s=0.6, moves_m_s=0.4, noise_m=0.01) < 1.0


def test_in_a_calm_a_push_that_leaves_no_trace_ends_a_flight_sooner_than_in_a_gusty_wind() -> None:
    def runs_away(t: float) -> float:
        return 9.0 * max(t - SETTLED_S, 0.0)

    assert highest(runs_away, share=0.0, for_s=0.6) >= 1.0
    assert highest(runs_away, swings(3.0, 12.0), share=0.0, for_s=0.6) < 1.0


@pytest.mark.parametrize(("down_m_s2", "ends"), [(4.5, False), (8.0, True)])
def test_a_wind_down_that_rises_within_a_second_to_more_than_any_wind_is_none(down_m_s2: float, ends: bool) -> None:
    """So a height that stands, and gives way a little, is learnt as ever more wind by a law that pushes against it."""
    rivals, told, shown, found = Rivals(), Pushed(), Pushed(), 0.0
    rivals.begin((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for k in range(60):
        rises = min(max(k * H - SETTLED_S, 0.0), 1.0)
        told.move(-down_m_s2 * rises)
        shown.move(0.5 if 0.0 < rises < 1.0 else 0.0)
        found = max(found, rivals.node((0.0, 0.0, shown.at), (0.0, 0.0, told.at), H, NOISES * NOISE_M, leapt=False))
    assert (found >= 1.0) is ends
