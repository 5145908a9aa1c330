"""Excitation tones: their closed-form motion is what the model makes of their commands."""

import math

import msgspec
import pytest

from groundstation.core.control import ExcitationTones
from groundstation.core.geometry import euler_zyx, so3
from groundstation.core.messages import Estimate
from groundstation.core.vehicle import ActuatorCommand, Motion, Vehicle
from tests.calm_air import fly_on

G = 9.81
LARGE = Vehicle(mass_kg=1.0, thrust_max_n=20.0, thrust_lag_s=0.03, rate_lag_s=0.02)
VEHICLES = [Vehicle(), msgspec.structs.replace(LARGE, frame_period_s=0.01)]
ZERO = (0.0, 0.0, 0.0)


def full_tones(vehicle: Vehicle) -> ExcitationTones:
    tones = ExcitationTones(vehicle, G)
    tones.set_level(0.0, 1.0)
    return tones


def flown(vehicle: Vehicle, yaw_rad: float, until_s: float) -> tuple[list[float], list[Motion]]:
    """Instants and motions of a hovering vehicle that is given the tones alone, frame by frame."""
    tones, hover = full_tones(vehicle), vehicle.mass_kg * G
    attitude = so3.from_euler_zyx(0.0, 0.0, yaw_rad)
    motion = Motion(ZERO, ZERO, attitude, hover, ZERO)
    times, motions = [], []
    frame_s = vehicle.frame_period_s
    for n in range(round(until_s / frame_s)):
        drive = tones.add_to(ActuatorCommand(hover, ZERO), n * frame_s)
        motion = fly_on(vehicle, motion, drive, frame_s)
        times.append((n + 1) * frame_s)
        motions.append(motion)
    return times, motions


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.5])
def test_tilt_rates_and_accelerations_are_those_of_the_model(
    vehicle: Vehicle, yaw_rad: float
) -> None:
    times, motions = flown(vehicle, yaw_rad, 4.0)
    tones = full_tones(vehicle)
    late = [(t, m) for t, m in zip(times, motions, strict=True) if t > 2.0]
    for time_s, motion in late:
        tone = tones.motion(time_s, yaw_rad)
        assert tone.rates == pytest.approx(motion.rates[:2], abs=0.06)
        share = motion.thrust / (vehicle.mass_kg * G) - 1.0
        assert tone.thrust_share == pytest.approx(share, abs=0.006)
    # Tilt and place drift by how the tones began; what swings is told.
    roll = [euler_zyx(m.attitude)[0] - tones.motion(t, yaw_rad).tilt[0] for t, m in late]
    assert max(roll) - min(roll) < math.radians(0.5)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_every_vehicle_makes_the_same_small_motion(vehicle: Vehicle) -> None:
    tones = full_tones(vehicle)
    seen = [tones.motion(2.0 + 0.001 * n, 0.0) for n in range(4000)]
    aside = math.sqrt(sum(x.position[0] ** 2 + x.position[1] ** 2 for x in seen) / len(seen))
    height = math.sqrt(sum(x.position[2] ** 2 for x in seen) / len(seen))
    assert 0.001 < aside < 0.0025
    assert 0.0005 < height < 0.002


def test_the_state_without_the_tones_is_the_one_before_them() -> None:
    tones = full_tones(VEHICLES[0])
    tone = tones.motion(3.0, 0.7)
    attitude = so3.rotate(so3.from_euler_zyx(0.0, 0.0, 0.7), (*tone.tilt, 0.0))
    motion = Motion(
        tone.position, tone.velocity, attitude, 0.8 * (1.0 + tone.thrust_share), (*tone.rates, 0.1)
    )
    without = tones.take_out(Estimate(3.0, motion, ZERO, ZERO), 0.7).motion
    assert without.position == pytest.approx(ZERO, abs=1e-12)
    assert without.velocity == pytest.approx(ZERO, abs=1e-12)
    assert without.thrust == pytest.approx(0.8)
    assert without.rates == pytest.approx((0.0, 0.0, 0.1), abs=1e-12)
    assert euler_zyx(without.attitude)[:2] == pytest.approx((0.0, 0.0), abs=1e-3)


def test_tones_come_and_go_without_a_step() -> None:
    tones, hover = ExcitationTones(VEHICLES[0], G), ActuatorCommand(0.8, ZERO)
    assert tones.add_to(hover, 1.0) == hover
    tones.set_level(1.0, 1.0)
    assert tones.level_at(1.0) == 0.0
    assert tones.level_at(1.15) == pytest.approx(0.5)
    assert tones.level_at(9.0) == 1.0
    tones.set_level(9.0, 0.0)
    assert tones.level_at(9.0) == 1.0
    assert tones.add_to(hover, 9.6) == hover


@pytest.mark.parametrize(
    ("rates_rad_s", "has_room"),
    [
        ((3.4, -3.4, 0.0), True),
        ((3.5, 0.0, 0.0), False),
        ((0.0, -3.5, 0.0), False),
        ((0.0, 0.0, 3.5), True),
    ],
)
def test_tones_have_no_room_where_roll_or_pitch_is_limited(
    rates_rad_s: tuple[float, float, float], has_room: bool
) -> None:
    """200 deg/s are 3.49 rad/s; the tones do not turn about yaw."""
    tones = ExcitationTones(Vehicle(rate_limits_deg_s=(200.0, 200.0, 200.0)), G)
    assert tones.has_room(ActuatorCommand(0.8, rates_rad_s)) is has_room
