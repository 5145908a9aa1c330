"""What the obedience monitor asks of a height just off the floor, on made-up climbs: what ends a flight."""

import math
from collections.abc import Callable
from functools import partial

import pytest

from groundstation.core.geometry import Vec3
from groundstation.core.safety.obedience import CLIMB_S, PUSH_SUSPECTS
from tests.unit.groundstation.core.safety.test_obedience import PERIOD_S, Demand, G, Picture, Truth, Watched, true

CLIMB_M_S = 0.2
"""How fast it seems to climb as it leaves the floor [m/s]."""
Thrust = Callable[[float], float]
"""Over time, as a share of the weight [-]."""
Wind = Callable[[float], float]
"""Along the vertical, over time [m/s², down]."""


def still(_: float) -> float:
    """No wind."""
    return 0.0


def off_the_floor(seed: int, *, climb_m_s: float = CLIMB_M_S) -> Watched:
    """A vehicle that has just left the floor."""
    vehicle = Watched(seed)
    vehicle.sinks_m_s = -climb_m_s
    vehicle.monitor.lift_off(1.0, climb_m_s)
    return vehicle


def pushes(
    vehicle: Watched, thrust: Thrust, duration_s: float, *, wind: Wind = still, picture: Picture = true, resets: int = 0
) -> list[float]:
    """Fly on; what speaks against the height from pose to pose."""
    found = []

    def air(time_s: float) -> Vec3:
        return 0.0, 0.0, wind(time_s)

    for _ in range(round(duration_s / PERIOD_S)):
        vehicle.fly(PERIOD_S, lambda t: Demand(0.0, 0.0, thrust(t)), picture=picture, air=air, resets=resets)
        found.append(vehicle.monitor.evidence.push)
    return found


def ends_s(found: list[float]) -> float:
    """When that ends a flight [s]; infinity where it does not."""
    return next((PERIOD_S * n for n, share in enumerate(found, 1) if share >= 1.0), math.inf)


def shows(share: float) -> Picture:
    """Heights of which so much is shown; all else is true."""

    def picture(truth: Truth) -> Truth:
        x, y, z = truth.position
        return Truth((x, y, share * z), truth.attitude)

    return picture


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3])
def test_a_height_that_stays_behind_its_thrust_is_told_within_six_tenths_of_a_second(share: float) -> None:
    for seed in range(3):
        assert ends_s(pushes(off_the_floor(seed), lambda _: 1.2, 0.6, picture=shows(share))) <= 0.6, seed


@pytest.mark.parametrize("wind_m_s2", [-0.8, 0.0, 0.8])
@pytest.mark.parametrize("climb_m_s", [0.1, 0.2, 0.4])
def test_an_honest_climb_is_not_behind_where_a_wind_goes_up_or_down(climb_m_s: float, wind_m_s2: float) -> None:
    def thrust(time_s: float) -> float:
        """It climbs ever faster for half a second; the wind is answered after three tenths."""
        return 1.0 + (0.5 * (time_s < 0.5) + wind_m_s2 * (time_s > 0.3)) / G

    for seed in range(3):
        found = pushes(off_the_floor(seed, climb_m_s=climb_m_s), thrust, CLIMB_S + 0.2, wind=lambda _: wind_m_s2)
        assert max(found) < PUSH_SUSPECTS, seed


def lowered(truth: Truth) -> Truth:
    """The source has moved its origin by 10 cm: everything is so much lower."""
    x, y, z = truth.position
    return Truth((x, y, z + 0.1), truth.attitude)


@pytest.mark.parametrize("after_s", [0.05, 0.3, 0.6])
def test_a_reset_just_off_the_floor_that_lowers_the_height_is_no_evidence(after_s: float) -> None:
    for seed in range(3):
        vehicle = off_the_floor(seed, climb_m_s=0.05)
        pushes(vehicle, lambda _: 1.02, after_s)
        found = pushes(vehicle, lambda _: 1.02, CLIMB_S, picture=lowered, resets=1)
        assert max(found) < PUSH_SUSPECTS, seed


def test_the_same_height_without_a_reset_ends_the_flight() -> None:
    vehicle = off_the_floor(0, climb_m_s=0.05)
    pushes(vehicle, lambda _: 1.02, 0.2)
    assert ends_s(pushes(vehicle, lambda _: 1.02, 0.3, picture=lowered)) <= 0.2


def steadily(push: float, _: float) -> float:
    """The same thrust."""
    return push


@pytest.mark.parametrize("stalls_s", [0.09, 0.4])
def test_a_stall_is_no_lift_off_and_going_lower_than_there_says_nothing(stalls_s: float) -> None:
    """The link stalls, before the first node or later; then it goes down by 7 cm and more, never below the floor."""
    for seed in range(3):
        vehicle = off_the_floor(seed, climb_m_s=1.2)
        pushes(vehicle, lambda _: 1.0 - 1.5 / G, stalls_s)
        vehicle.monitor.forget()
        there, lowest, goal = vehicle.place[2], -math.inf, 0.0
        while vehicle.now < CLIMB_S:
            down, sinks = vehicle.place[2], vehicle.sinks_m_s
            lowest, goal = max(lowest, down), 0.5 if down > -0.03 else goal
            push = 1.0 + (25.0 * (goal + down) + 8.0 * sinks) / G
            (found,) = pushes(vehicle, partial(steadily, push), PERIOD_S)
            assert found < PUSH_SUSPECTS, (seed, vehicle.now)
        assert there + 0.07 < lowest < 0.0


@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.3])
def test_a_wind_up_and_down_that_the_law_cancels_is_no_height_that_stands(late_s: float) -> None:
    """It turns once in five seconds; what is left of the vehicle's motion is as small as a picture's that stands."""

    def wind(time_s: float) -> float:
        return 1.5 * math.sin(2.0 * math.pi * 0.2 * max(time_s, 0.0))

    for seed in range(3):
        found = pushes(Watched(seed), lambda t: 1.0 + wind(t - late_s) / G, 12.0, wind=wind)
        assert max(found) < 0.5, seed
