"""The failsafe descent's thrust: its belief of wind and thrust, and its greatest lift."""

import math

import pytest
from msgspec.structs import replace

from groundstation.core.control import Descent, blind_descent_limit_s
from groundstation.core.geometry import IDENTITY, ZERO, Vec3
from groundstation.core.messages import Estimate
from groundstation.core.trajectory import Reference
from groundstation.core.vehicle import Motion, Vehicle

# By their numbers: a limit that the test took from the code would bear out any value.
BLIND_LIFT_M_S = 0.7
BLIND_PULL_M_S2 = 0.5

G, MASS_KG, PERIOD_S = 9.81, 0.5, 0.02
VEHICLE = Vehicle(mass_kg=MASS_KG, thrust_max_n=4.0 * MASS_KG * G)


def estimate(
    time_s: float, *, down_m_s2: float = 0.0, effectiveness: float = 1.0, sinks_m_s: float = 3.0
) -> Estimate:
    """Level, and sinking much faster than it is to: it wants to be lifted as much as may be."""
    motion = Motion((0.0, 0.0, -2.0), (0.0, 0.0, sinks_m_s), IDENTITY, MASS_KG * G, ZERO)
    return Estimate(time_s, motion, (0.0, 0.0, down_m_s2), ZERO, effectiveness)


def begin(wind_m_s2: Vec3 = ZERO, *speeds_m_s: float, blind: bool = False) -> Descent:
    """A descent that knows a mean wind of before, and may not believe the poses."""
    descent = Descent(VEHICLE, G, wind_m_s2, 1.0, *speeds_m_s)
    descent.blind = blind
    return descent


def lifts(descent: Descent, at: Estimate) -> float:
    """Its thrust as a share of the weight [-]."""
    reference = Reference(at.motion.position, (0.0, 0.0, 0.3))
    return descent.decide(at, reference, PERIOD_S).drive.thrust / (MASS_KG * G)


def test_it_lifts_at_once_by_what_thrust_gives_now_and_against_the_mean_wind_of_before() -> None:
    assert lifts(begin(), estimate(0.0, effectiveness=0.7)) == pytest.approx(1.24 / 0.7, rel=1e-6)
    assert lifts(begin((0.0, 0.0, 2.0)), estimate(0.0, down_m_s2=2.0)) == pytest.approx(
        1.24 + 2.0 / G
    )


def test_what_swings_up_and_down_is_not_lifted_against() -> None:
    """Late poses make a disturbance of their own lateness: 3 m/s² to and fro, once a second."""
    descent = begin()
    swings = [3.0 * math.sin(2.0 * math.pi * PERIOD_S * n) for n in range(250)]
    most = max(
        lifts(descent, estimate(PERIOD_S * n, down_m_s2=down)) for n, down in enumerate(swings)
    )
    assert most < 1.24 * (1.0 + 1.0 / G)


def test_what_pulls_down_steadily_is_lifted_against_within_two_seconds() -> None:
    descent = begin()
    course = [lifts(descent, estimate(PERIOD_S * n, down_m_s2=2.0)) for n in range(100)]
    assert course[0] < 1.24 * (1.0 + 0.1 / G)
    learnt = (course[round(1.0 / PERIOD_S)] / 1.24 - 1.0) * G / 2.0
    assert learnt == pytest.approx(1.0 - math.exp(-1.0), abs=0.05)
    assert course[-1] == pytest.approx(1.24 + 2.0 / G)


@pytest.mark.parametrize("push_m_s2", [(3.0, 0.0, 0.0), (0.0, -6.0, 0.0), (0.0, 0.0, 5.0)])
def test_blind_it_leans_and_lifts_against_the_wind_of_before_and_nothing_that_poses_show_now(
    push_m_s2: Vec3,
) -> None:
    """Poses that are mirrored show a wind that grows with each lean against it."""

    def flown(*shown: Vec3) -> list[object]:
        descent = begin((0.5, 0.0, 0.0), blind=True)
        at, down = estimate(0.0), Reference((0.0, 0.0, -2.0), (0.0, 0.0, 0.3))
        return [
            descent.decide(at._replace(disturbance=push), down, PERIOD_S).drive for push in shown
        ]

    still = (0.5, 0.0, 0.0)
    assert flown(*50 * [push_m_s2]) == flown(*50 * [still])


@pytest.mark.parametrize("faster_m_s", [0.2, 0.4, 0.7, 2.0])
@pytest.mark.parametrize("after_s", [0.0, 0.5])
def test_blind_it_brakes_what_the_model_sinks_faster_than_its_pull_gives_but_no_more_than_its_limit(
    faster_m_s: float, after_s: float
) -> None:
    told_m_s, shares = 0.3, list[float]()
    sinks_m_s = told_m_s + (faster_m_s if after_s == 0.0 else 0.0)
    descent = begin(ZERO, told_m_s, sinks_m_s, blind=True)
    for n in range(150):
        if n > 0 and n == round(after_s / PERIOD_S):
            sinks_m_s += faster_m_s  # it leaned hard, and lost height
        shares.append(lifts(descent, estimate(PERIOD_S * n, sinks_m_s=sinks_m_s)))
        sinks_m_s += PERIOD_S * G * (1.0 - shares[-1])
    pulled_m_s = told_m_s + 150 * PERIOD_S * BLIND_PULL_M_S2
    assert sinks_m_s == pytest.approx(pulled_m_s + max(faster_m_s - BLIND_LIFT_M_S, 0.0), abs=0.05)
    assert max(shares) < 1.24
    assert PERIOD_S * sum(share > 1.03 for share in shares) < 0.5


@pytest.mark.parametrize("drag_per_s", [0.0, 0.5, 2.0])
def test_blind_it_pulls_as_much_more_as_the_air_takes(drag_per_s: float) -> None:
    descent, sinks_m_s = Descent(replace(VEHICLE, drag_per_s=drag_per_s), G, ZERO, 1.0), 0.0
    descent.blind = True
    for n in range(100):
        pulled = G * (1.0 - lifts(descent, estimate(PERIOD_S * n, sinks_m_s=sinks_m_s)))
        sinks_m_s += PERIOD_S * (pulled - drag_per_s * sinks_m_s)
    assert sinks_m_s == pytest.approx(100 * PERIOD_S * BLIND_PULL_M_S2, abs=0.03)


@pytest.mark.parametrize(("climbs_m_s", "pull_m_s2"), [(0.2, 1.3), (1.0, 3.443), (5.0, 3.443)])
def test_blind_it_brakes_a_climb_of_the_model_and_pulls_no_more_than_so_far(
    climbs_m_s: float, pull_m_s2: float
) -> None:
    assert lifts(begin(blind=True), estimate(0.0, sinks_m_s=-climbs_m_s)) == pytest.approx(
        1.0 - pull_m_s2 / G
    )


@pytest.mark.parametrize(("climbs_m_s", "longest_s"), [(2.0, 3.57898), (-3.0, 2.42857)])
def test_a_blind_descent_from_one_metre_may_last_so_long(
    climbs_m_s: float, longest_s: float
) -> None:
    assert blind_descent_limit_s(1.0, climbs_m_s, G) == pytest.approx(longest_s, rel=1e-5)


@pytest.mark.parametrize("climbs_m_s", [-0.5, 0.0, 0.3, 0.6, 1.3, 2.0])
@pytest.mark.parametrize("height_m", [0.1, 0.3, 0.6, 1.0, 2.0, 3.0])
def test_blind_its_motors_stop_no_higher_by_its_model_than_a_fall_of_a_third_of_a_metre(
    height_m: float, climbs_m_s: float
) -> None:
    """A model that the fault made climb is braked, and sinks from higher up."""
    longest_s = blind_descent_limit_s(height_m, climbs_m_s, G)
    descent, sinks_m_s = begin(blind=True), -climbs_m_s
    for n in range(math.ceil(longest_s / PERIOD_S)):
        share = lifts(descent, estimate(PERIOD_S * n, sinks_m_s=sinks_m_s))
        sinks_m_s += PERIOD_S * G * (1.0 - share)
        height_m -= PERIOD_S * sinks_m_s
    assert height_m < 0.33
