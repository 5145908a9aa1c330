"""Leaving the floor and coming back to it: thrust, lift-off, touchdown, an impatient operator."""

import math

import pytest
from hypothesis import given, strategies as st

from groundstation.config import from_dict
from groundstation.core.messages import Ask, Pose
from groundstation.core.mission import Interrupts
from groundstation.core.safety import Spool, StandingPoses, Touchdown, limit_n
from groundstation.settings import Config

LEVEL = (1.0, 0.0, 0.0, 0.0)


def pose(number: int, down: float, resets: int = 0) -> Pose:
    return Pose(number, 0.02 * number, 0.02 * number, (0.5, -0.5, down), LEVEL, reset_count=resets)


@given(st.floats(0.0, 0.9), st.floats(0.2, 5.0), st.floats(0.0, 0.3))
def test_thrust_rises_without_a_step_and_never_above_its_limit(
    idle: float, spool_s: float, lag_s: float
) -> None:
    spool = Spool(10.0, 13.0, spool_s, 10.0 * idle, 3.0, lag_s)
    told = [spool.thrust_n(3.0 + 0.001 * i) for i in range(6000)]
    assert told[0] == pytest.approx(10.0 * idle)
    assert all(0.0 <= b - a < 0.1 for a, b in zip(told, told[1:], strict=False))
    assert told[-1] == 13.0
    # From 0.9x the weight to the limit.
    assert 0.001 * sum(9.0 < thrust < 13.0 for thrust in told) <= 0.3


def test_thrust_before_lift_off_is_bounded_by_the_told_weight_or_by_a_measured_hover_thrust() -> (
    None
):
    def limit(*told: str) -> float:
        config = from_dict({}, Config, ["vehicle.mass_kg=1", "vehicle.thrust_max_n=20", *told])
        return limit_n(config.takeoff, config.vehicle, config.weight_n) / 9.81

    assert limit() == pytest.approx(1.3)
    assert limit("vehicle.hover_n=9.0") == pytest.approx(1.1 * 9.0 / 9.81)
    assert limit("vehicle.thrust_max_n=11.0") == pytest.approx(11.0 / 9.81)
    assert limit("takeoff.thrust_limit=1.5", "vehicle.hover_n=9.0") == pytest.approx(1.5)


def test_a_source_that_moves_its_origin_on_the_floor_has_not_lifted_the_vehicle() -> None:
    standing = StandingPoses()
    for number in range(60):
        standing.add(pose(number, 1.0))
    standing.add(pose(60, 0.0, resets=1))
    assert standing.place_ned[2] == 0.0


@pytest.mark.parametrize(
    ("thrust_n", "sinking_m_s", "height_m", "behind_m", "after_s"),
    [
        (0.6, 0.0, 0.01, 0.0, 0.2),  # on the floor
        (0.6, 0.0, 0.8, 0.0, 1.0),  # on a table
        (0.9, 0.0, 0.01, 0.4, 0.2),  # a controller whose thrust does not fall that low
        (0.9, 0.0, 0.01, math.inf, 1.0),  # a failsafe descent that has found the floor
        (0.9, 0.4, 0.01, math.inf, None),
        (0.9, 0.0, 0.8, 0.4, None),  # held up by a gust
        (0.9, 0.0, 0.01, 0.1, None),  # hovering low
        (0.6, 0.3, 0.8, 0.4, 1.0),  # on the floor, by an estimate whose height and speed wander
        (0.6, 0.3, 0.8, 0.0, None),  # lighter than it was, and sinking as it is told
        (0.6, 0.5, 0.1, 0.0, None),  # sinking fast
        (0.8, 0.3, 0.8, 0.0, None),  # sinking slowly
    ],
)
def test_touching_down_is_not_sinking_though_nothing_holds_it_up(
    thrust_n: float, sinking_m_s: float, height_m: float, behind_m: float, after_s: float | None
) -> None:
    touchdown = Touchdown(1.0)
    told = (thrust_n, thrust_n, sinking_m_s, height_m, behind_m, 0.25)
    felt = next((0.01 * i for i in range(300) if touchdown.update(0.01 * i, *told)), None)
    assert felt == (None if after_s is None else pytest.approx(after_s, abs=0.011))


@pytest.mark.parametrize(
    ("thrust_n", "sinking_m_s", "sinks_m_s", "height_m", "touches"),
    [
        (0.6, 0.0, 0.25, 0.8, True),
        (0.6, -0.3, 0.25, 0.8, True),  # by an estimate whose speed wanders
        (0.6, 0.2, 0.25, 0.8, False),  # lighter than it was: it sinks
        (0.6, -0.5, 0.25, 0.8, False),  # lifted by a gust
        (0.8, 0.0, 0.25, 0.8, False),
        (0.9, 0.05, 0.25, 0.1, True),  # it has just met the floor
        (0.9, 0.1, 0.25, 0.1, False),
        (0.6, 0.0, 0.1, 0.1, False),  # not told to sink yet
    ],
)
def test_what_does_not_sink_as_it_is_told_may_be_carried(
    thrust_n: float, sinking_m_s: float, sinks_m_s: float, height_m: float, touches: bool
) -> None:
    touchdown = Touchdown(1.0)
    for i in range(6):
        touchdown.update(0.01 * i, thrust_n, 1.0, sinking_m_s, height_m, 0.0, sinks_m_s)
        assert touchdown.may_have_contact == (touches and i >= 3)
    touchdown.update(0.06, thrust_n, 1.0, 0.3, height_m, 0.0, sinks_m_s)
    assert not touchdown.may_have_contact


@pytest.mark.parametrize(
    ("lift_n", "sank_m_s", "sinks_on_m_s", "height_m", "touches"),
    [
        (0.8, 0.25, 0.25, 0.2, True),  # it sinks on, by an estimate that wanders, and no faster
        (0.8, 0.25, 0.25, 0.4, False),  # so a gust does, farther up
        (0.95, 0.25, 0.25, 0.2, False),
        (0.8, 0.25, 0.55, 0.2, False),  # it falls, as little thrust has it
        (1.0, 0.35, 0.0, 0.2, True),  # stopped at once
    ],
)
def test_what_is_pushed_up_near_the_floor_may_be_carried(
    lift_n: float, sank_m_s: float, sinks_on_m_s: float, height_m: float, touches: bool
) -> None:
    touchdown = Touchdown(1.0)
    for i in range(20):
        touchdown.update(0.01 * i, 1.0, 1.0, sank_m_s, height_m, 0.0, 0.25)
        assert not touchdown.may_have_contact
    for i in range(20):
        speed = sank_m_s + (sinks_on_m_s - sank_m_s) * min(i / 15, 1.0)
        touchdown.update(0.2 + 0.01 * i, 1.0, lift_n, speed, height_m, 0.0, 0.25)
    assert touchdown.may_have_contact == touches


@given(
    st.floats(0.0, 0.75, exclude_max=True),
    st.floats(-3.0, 0.0),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
)
def test_what_falls_has_not_touched_down(
    share: float, speed_m_s: float, gust_m_s2: float, drag_per_s: float
) -> None:
    touchdown = Touchdown(1.0)
    for i in range(300):
        assert not touchdown.update(0.01 * i, share, share, speed_m_s, 0.8, 0.0, 0.25)
        if speed_m_s > 0.5:
            break
        speed_m_s += 0.01 * (9.81 * (1.0 - share) - gust_m_s2 - drag_per_s * speed_m_s)


@pytest.mark.parametrize(
    ("heights_m", "sinks_m_s", "every_s", "stands_s"),
    [
        # few poses come: stands since the second one
        ([0.06, 0.01, 0.008, 0.0, 0.0, 0.0], 0.25, 0.22, 0.66),
        # poses that were held back begin again where they had ceased
        ([0.1, 0.1], 0.25, 0.42, None),
        ([0.1] * 40, 0.25, 0.02, None),  # it stood there before: a picture that stands in the air
        ([0.05] * 40, 0.25, 0.02, 0.44),  # since the first pose after that
        ([0.14] + [0.1] * 40, 0.25, 0.02, 0.44),  # a floor higher than told
        ([0.14] + [0.1] * 40, 0.16, 0.02, 0.66),  # told to sink slowly: so it may be slower
        ([0.14] + [0.1] * 40, 0.0, 0.02, None),  # a hover so low, and a landing that stops first
        ([0.2] * 40, 0.25, 0.02, None),  # a picture that stands in the air
        # held back by its own cushion, but sinking
        ([0.15 - 0.05 * 0.02 * i for i in range(100)], 0.25, 0.02, None),
        ([0.0, 0.03] * 40, 0.25, 0.02, None),
    ],
)
def test_poses_that_stand_low_while_it_is_told_to_sink_are_of_a_vehicle_on_the_floor(
    heights_m: list[float], sinks_m_s: float, every_s: float, stands_s: float | None
) -> None:
    touchdown = Touchdown(1.0)
    stood = None
    for number, height_m in enumerate(heights_m):
        newest = Pose(number, every_s * number, every_s * number, (0.0, 0.0, -height_m), LEVEL)
        # Several commands rest on one pose.
        looks = [touchdown.detect_rest(newest, height_m, sinks_m_s) for _ in range(5)]
        if stood is None and looks[0]:
            stood = newest.time_s
    assert stood == (None if stands_s is None else pytest.approx(stands_s))


def test_three_presses_land_descend_and_kill_and_each_says_what_comes_next() -> None:
    interrupts = Interrupts()
    asked = [interrupts.press("SIGINT", t) for t in (0.0, 2.0, 4.0, 6.0)]
    steps = [Ask.LAND, Ask.DESCEND, Ask.KILL, Ask.KILL]
    assert [request and request.ask for request, _ in asked] == steps
    assert asked[0][1].text == "SIGINT: asked to land; once more: failsafe descent"
    assert "motors off" in asked[1][1].text


@pytest.mark.parametrize("apart_s", [0.03, 0.04, 0.091])
def test_a_key_that_is_held_down_lands_and_nothing_more(apart_s: float) -> None:
    interrupts = Interrupts()
    interrupts.press("SIGINT", 10.0)
    assert all(interrupts.press("SIGINT", 10.5 + apart_s * n)[0] is None for n in range(100))
    request, _ = interrupts.press("SIGINT", 30.0)
    assert request is not None and request.ask is Ask.DESCEND


@given(st.lists(st.floats(0.0, 0.99), max_size=20))
def test_presses_within_a_second_count_once(later: list[float]) -> None:
    interrupts = Interrupts()
    interrupts.press("SIGINT", 10.0)
    for after in sorted(later):
        request, words = interrupts.press("SIGTERM", 10.0 + after)
        assert request is None
        assert "counts once" in words.text
    request, _ = interrupts.press("SIGINT", 11.5)
    assert request is not None and request.ask is Ask.DESCEND
