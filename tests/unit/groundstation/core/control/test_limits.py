"""Limits of a command, each by itself: what it cuts, and what it leaves as it is."""

import math

import pytest
from msgspec.structs import replace

from groundstation.core.control import TRANSIT, FlightLimits, Gains, LimitInput
from groundstation.core.control.limits import (
    FirstClimbLimit,
    LevelNearGround,
    ThrustLimit,
    TiltLimit,
    UplinkLostLimit,
)
from groundstation.core.geometry import IDENTITY, ZERO, Quat, so3
from groundstation.core.messages import Estimate
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle

# By their numbers: a limit that the test took from the code would bear out any value.
FIRST_CLIMB_M = 0.25
FIRST_CLIMB_SHARE = 1.2
LEAST_THRUST_SHARE = 0.7
UPLINK_LOST_SHARE = 0.95
UPLINK_LOST_GAIN = 0.15

VEHICLE = Vehicle()
GAINS = Gains()
HOVER_N = VEHICLE.mass_kg * GAINS.gravity
MODERATE = ActuatorCommand(HOVER_N, (0.1, -0.1, 0.05))


def at(
    height_m: float = 1.0,
    *,
    attitude: Quat = IDENTITY,
    time_s: float = 5.0,
    sinking_m_s: float = 0.0,
) -> LimitInput:
    """A flight that lifted off at 0 s, 1 m above its floor or as told."""
    motion = Motion((0.0, 0.0, -height_m), (0.0, 0.0, sinking_m_s), attitude, HOVER_N, ZERO)
    return LimitInput(time_s, 0.0, -height_m, Estimate(time_s, motion, ZERO, ZERO), ZERO)


def tilted(degrees: float) -> Quat:
    return so3.from_euler_zyx(math.radians(degrees), 0.0, 0.0)


def test_a_moderate_command_in_the_air_passes_all_limits_of_a_transit_unchanged() -> None:
    limits = FlightLimits(VEHICLE, GAINS)
    limits.first_climb.lift_off(0.0, HOVER_N, 0.0)
    assert limits.apply(TRANSIT.limits, MODERATE, at()) == MODERATE


def test_thrust_of_the_first_climb_is_limited_until_the_height_has_responded_and_never_again() -> (
    None
):
    limits, hard = FlightLimits(VEHICLE, GAINS), MODERATE._replace(thrust=VEHICLE.thrust_max_n)
    first = (FirstClimbLimit,)
    assert limits.apply(first, hard, at()) == hard, "no lift-off: it began in the air"
    limits.first_climb.lift_off(0.0, HOVER_N, 0.0)
    cut = limits.apply(first, hard, at(0.5 * FIRST_CLIMB_M, time_s=0.5))
    assert cut.thrust == pytest.approx(FIRST_CLIMB_SHARE * HOVER_N)
    assert cut.rates == hard.rates
    assert limits.apply(first, hard, at(0.5 * FIRST_CLIMB_M, time_s=9.0)) == cut
    assert limits.apply(first, hard, at(1.1 * FIRST_CLIMB_M, time_s=9.5)) == hard
    assert limits.apply(first, hard, at(0.5 * FIRST_CLIMB_M, time_s=9.6)) == hard


@pytest.mark.parametrize(
    ("degrees", "time_s", "is_cut"), [(25.0, 5.0, False), (45.0, 5.0, True), (35.0, 0.5, True)]
)
def test_rates_beyond_the_tilt_limit_are_turned_back(
    degrees: float, time_s: float, is_cut: bool
) -> None:
    rolls = ActuatorCommand(HOVER_N, (0.5, 0.0, 0.0))
    now = at(attitude=tilted(degrees), time_s=time_s)
    cut = FlightLimits(VEHICLE, GAINS).apply((TiltLimit,), rolls, now)
    assert (cut.rates[0] < rolls.rates[0]) is is_cut
    assert cut.thrust == rolls.thrust


def test_thrust_in_transit_neither_drops_the_vehicle_nor_drives_it_aside() -> None:
    limits = FlightLimits(VEHICLE, GAINS)
    low, high = MODERATE._replace(thrust=0.0), MODERATE._replace(thrust=VEHICLE.thrust_max_n)
    assert limits.apply((ThrustLimit,), low, at()).thrust == pytest.approx(
        LEAST_THRUST_SHARE * HOVER_N
    )
    assert limits.apply((ThrustLimit,), high, at()) == high, "level, it drives nothing aside"
    leaning = limits.apply((ThrustLimit,), high, at(attitude=tilted(60.0)))
    assert leaning.thrust * math.sin(math.radians(60.0)) == pytest.approx(
        HOVER_N * math.tan(math.radians(40.0))
    )


def test_near_the_ground_rates_only_level_and_only_while_contact_is_possible() -> None:
    limits, away = FlightLimits(VEHICLE, GAINS), ActuatorCommand(HOVER_N, (0.3, 0.2, 0.1))
    now = at(0.05, attitude=tilted(5.0))
    assert limits.apply((LevelNearGround,), away, now) == away
    near = replace(now, may_have_contact=True)
    roll, pitch, yaw = limits.apply((LevelNearGround,), away, near).rates
    assert roll < 0.0
    assert (pitch, yaw) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(("sinking_m_s", "share"), [(0.0, UPLINK_LOST_SHARE), (0.6, 1.0)])
def test_without_uplink_commands_are_gentle_and_let_the_vehicle_sink_slowly(
    sinking_m_s: float, share: float
) -> None:
    limits, hard = FlightLimits(VEHICLE, GAINS), ActuatorCommand(2.0 * HOVER_N, (2.0, -1.0, 0.5))
    now = at(sinking_m_s=sinking_m_s)
    assert limits.apply((UplinkLostLimit,), hard, now) == hard
    cut = limits.apply((UplinkLostLimit,), hard, replace(now, is_uplink_lost=True))
    assert cut.thrust == pytest.approx(share * HOVER_N)
    assert cut.rates == pytest.approx([UPLINK_LOST_GAIN * rate for rate in hard.rates])
