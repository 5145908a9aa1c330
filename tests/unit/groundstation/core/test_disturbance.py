"""The shown disturbance: one sum, however split, and intervals by the estimator's variance."""

import math

import pytest

from groundstation.core.geometry import IDENTITY, ZERO, Quat, scale, third_column
from groundstation.core.geometry.so3 import from_euler_zyx
from groundstation.core.messages import DisturbanceMeter, DisturbanceReading, Estimate
from groundstation.core.vehicle import Motion

MASS_KG = 0.08
THRUST_N = 0.9


def estimate(
    wind_down: float, scale: float, deviation: float = 0.02, attitude: Quat = IDENTITY
) -> Estimate:
    motion = Motion(ZERO, ZERO, attitude, THRUST_N, ZERO)
    return Estimate(0.0, motion, (0.1, -0.2, wind_down), ZERO, scale, deviation)


def read(*estimates: Estimate) -> DisturbanceReading:
    meter = DisturbanceMeter(MASS_KG)
    for number, one in enumerate(estimates):
        meter.add(0.1 * number, one)
    assert meter.reading is not None
    return meter.reading


def test_the_sum_is_the_same_however_it_is_split() -> None:
    lost = 0.1 * THRUST_N / MASS_KG
    as_wind, as_scale = read(estimate(lost, 1.0)), read(estimate(0.0, 0.9))
    assert as_wind.ned_m_s2 == pytest.approx(as_scale.ned_m_s2)
    assert as_wind.wind_down_m_s2 == pytest.approx(lost)
    assert as_scale.wind_down_m_s2 == 0.0


def test_thrust_that_leans_lacks_where_it_pushes() -> None:
    attitude = from_euler_zyx(0.2, 0.3, 0.4)
    north, east, down = read(estimate(0.0, 0.9, attitude=attitude)).ned_m_s2
    lost = 0.1 * THRUST_N / MASS_KG
    assert (north - 0.1, east + 0.2, down) == pytest.approx(scale(lost, third_column(attitude)))


def test_intervals_are_those_of_the_estimators_variance() -> None:
    found = read(estimate(0.5, 0.95, deviation=0.02))
    assert found.thrust_scale_error == pytest.approx(1.96 * 0.02)
    assert found.wind_down_error_m_s2 == pytest.approx(1.96 * 0.02 * THRUST_N / MASS_KG)
    assert found.describe_split() == "wind down +0.50 ± 0.44 m/s², thrust 95.0 ± 3.9 %"


def test_an_interval_that_a_recording_does_not_have_is_not_known() -> None:
    found = read(estimate(0.5, 0.95, deviation=math.nan))
    assert (found.thrust_scale_error, found.wind_down_error_m_s2) == (None, None)
    assert found.describe_split() == "wind down +0.50 m/s², thrust 95.0 %, intervals not known"


def test_a_reading_is_the_mean_of_the_last_second() -> None:
    old, new = [estimate(9.0, 1.0)] * 20, [estimate(0.4, 1.0), estimate(0.6, 1.0)] * 5
    assert read(*old, *new).wind_down_m_s2 == pytest.approx(0.5)


def test_before_the_first_command_and_without_the_observer_there_is_no_reading() -> None:
    meter = DisturbanceMeter(MASS_KG)
    assert meter.reading is None
    meter.add(0.0, estimate(0.0, math.nan))
    assert meter.reading is None
