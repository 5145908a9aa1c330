"""Model, actuators and estimator against the simulated plant, which shares no code with them."""

import math
import random
from statistics import fmean

import msgspec
import pytest
from hypothesis import given, strategies as st

from groundstation.core.control import Gains
from groundstation.core.estimation import ModelEstimator
from groundstation.core.estimation.estimator import (
    AlongTrack,
    Covariance,
    find_direction,
    fourth_difference,
    part_along,
    split_noise,
    turn_track,
    widen_covariance,
)
from groundstation.core.geometry import FLOATS, IDENTITY, ZERO, Vec3, so3
from groundstation.core.messages import Pose
from groundstation.core.vehicle import (
    ActuatorCommand,
    ActuatorResponse,
    Motion,
    Vehicle,
    integrate_motion,
    lead,
)
from groundstation.core.vehicle.vehicle import approach
from sim.world import Quadrotor, Wind, World, generator, rows
from tests.calm_air import fly_on

VEHICLE = Vehicle()
CALM = World(wind_mean=(0.0, 0.0, 0.0), floor_z_m=1e6)


def flown(
    world: World, seconds: float, composite: str = "provable", seed: int = 5, **gains: float | None
) -> tuple[ModelEstimator, Quadrotor]:
    """An estimator that has watched the plant under gently changing commands, perfectly told."""
    plant = Quadrotor(world, Wind(world, rows(generator(seed, "wind").standard_normal, 3)))
    plant.release(0.0)
    gauss = random.Random(seed).gauss
    estimator = ModelEstimator(
        VEHICLE, msgspec.structs.replace(Gains(), composite=composite, **gains)
    )
    frame, pose = 0, 0
    while pose * 0.02 <= seconds:
        if frame * 0.0225 <= pose * 0.02:
            t = frame * 0.0225
            hover = VEHICLE.mass_kg * 9.81 * (1.0 + 0.05 * math.sin(t))
            drive = ActuatorCommand(hover, (0.2 * math.sin(2.0 * t), 0.2 * math.cos(2.0 * t), 0.0))
            plant.command(t, *drive)
            estimator.add_command(t, drive)
            frame += 1
            continue
        t = pose * 0.02
        truth = plant.truth(t)
        n, a = world.pose_noise_m, world.attitude_noise_rad
        north, east, down = (part + gauss(0, n) for part in truth.position_ned)
        turned = so3.rotate(truth.attitude, (gauss(0, a), gauss(0, a), gauss(0, a)))
        estimator.update(Pose(pose, t, t + 0.02, (north, east, down), turned))
        pose += 1
    return estimator, plant


@given(st.floats(0.001, 0.1), st.floats(0.01, 0.5))
def test_a_command_led_through_the_lag_arrives_where_it_should(hold: float, lag: float) -> None:
    wanted_rise = 0.3
    command = 1.0 + lead(FLOATS, hold, lag) * wanted_rise
    assert 1.0 + approach(FLOATS, hold, lag) * (command - 1.0) == pytest.approx(
        1.0 + hold * wanted_rise
    )


def test_the_rolled_model_agrees_with_the_plant() -> None:
    plant = Quadrotor(CALM, Wind(CALM, rows(generator(0, "wind").standard_normal, 3)))
    plant.release(0.0)
    drive = ActuatorCommand(0.9, (1.0, -0.8, 0.5))
    plant.command(0.0, *drive)
    start = plant.truth(0.0)
    motion = Motion(
        start.position_ned, start.velocity_ned, start.attitude, start.thrust_n, start.rates_rad_s
    )
    for _ in range(8):
        motion = fly_on(VEHICLE, motion, drive, 0.0225)
    truth = plant.truth(8 * 0.0225)
    assert motion.position == pytest.approx(truth.position_ned, abs=2e-4)
    assert motion.velocity == pytest.approx(truth.velocity_ned, abs=1e-3)
    assert motion.thrust == pytest.approx(truth.thrust_n, abs=1e-9)
    assert motion.rates == pytest.approx(truth.rates_rad_s, abs=1e-9)
    assert motion.attitude == pytest.approx(truth.attitude, abs=1e-4)


def test_the_observer_finds_velocity_far_better_than_differences_do() -> None:
    world = msgspec.structs.replace(CALM, pose_noise_m=0.0003)
    estimator, plant = flown(world, 6.0)
    truth = plant.truth(6.0)
    motion = estimator.predict(6.0).motion
    # A difference of two poses with 0.3 mm noise 20 ms apart is wrong by 21 mm/s RMS per axis.
    assert math.dist(motion.velocity, truth.velocity_ned) < 0.012


@pytest.mark.parametrize("wind", [(0.5, -0.3, 0.8), (-2.0, 1.0, 0.0)])
def test_the_observer_finds_the_disturbance(wind: Vec3) -> None:
    estimator, _ = flown(
        msgspec.structs.replace(CALM, wind_mean=wind, pose_noise_m=0.0001),
        8.0,
        effectiveness_deviation=0.0,
    )
    assert math.dist(estimator.predict(8.0).disturbance, wind) < 0.1


def test_prediction_reaches_over_the_latency() -> None:
    world = msgspec.structs.replace(CALM, pose_noise_m=0.0, attitude_noise_rad=0.0)
    estimator, plant = flown(world, 4.0)
    ahead = estimator.predict(4.06).motion
    truth = plant.truth(4.06)
    assert math.dist(ahead.position, truth.position_ned) < 1e-3
    assert math.dist(ahead.velocity, truth.velocity_ned) < 5e-3


def test_a_pose_that_is_not_newer_changes_nothing() -> None:
    estimator, _ = flown(CALM, 1.0)
    before = estimator.predict(1.0)
    estimator.update(Pose(99, 0.5, 0.5, (9.0, 9.0, 9.0), so3.IDENTITY))
    assert estimator.predict(1.0) == before


def test_an_attitude_that_is_not_newer_changes_nothing_and_one_before_any_pose_is_not_taken() -> (
    None
):
    turned = so3.from_euler_zyx(0.3, 0.0, 0.0)
    estimator, _ = flown(CALM, 1.0)
    before = estimator.motion
    estimator.update_attitude(Pose(99, 0.98, 1.1, (0.0, 0.0, -1.0), turned))
    assert estimator.motion == before
    fresh = ModelEstimator(VEHICLE, Gains())
    fresh.update_attitude(Pose(0, 0.0, 0.0, (0.0, 0.0, -1.0), turned))
    assert fresh.motion is None


@pytest.mark.parametrize("until_s", [3.0, 6.0])
def test_innovations_of_true_poses_are_as_large_as_the_filter_expects(until_s: float) -> None:
    estimator, plant = flown(CALM, until_s)
    draw, next_s, found = random.Random(8), until_s + 0.02, list[float]()
    truth, noise_m = plant.truth(next_s), CALM.pose_noise_m
    for _ in range(300):
        north, east, down = (part + draw.gauss(0.0, noise_m) for part in truth.position_ned)
        pose = Pose(0, next_s, next_s, (north, east, down), truth.attitude)
        found.append(estimator.consistency(pose))
    assert 1.5 < fmean(found) < 6.0


def test_a_command_that_acts_from_before_the_newest_pose_on_is_flown_from_that_pose_on() -> None:
    late, on_time = ModelEstimator(VEHICLE, Gains()), ModelEstimator(VEHICLE, Gains())
    for estimator, acts_s in ((late, 0.99), (on_time, 1.0)):
        estimator.add_command(0.0, ActuatorCommand(0.0, (0.0, 0.0, 0.0)))
        estimator.update(Pose(0, 1.0, 1.0, (0.0, 0.0, 0.0), so3.IDENTITY))
        estimator.add_command(acts_s, ActuatorCommand(1.0, (0.1, 0.0, 0.0)))
    assert late.predict(1.02) == on_time.predict(1.02)


def test_a_second_command_for_the_same_instant_replaces_the_first() -> None:
    estimator = ModelEstimator(VEHICLE, Gains())
    estimator.update(Pose(0, 0.0, 0.0, (0.0, 0.0, 0.0), so3.IDENTITY))
    estimator.add_command(0.0, ActuatorCommand(0.1, (0.0, 0.0, 0.0)))
    estimator.add_command(0.0, ActuatorCommand(1.0, (0.0, 0.0, 0.0)))
    expected = 1.0 - (1.0 - 0.0) * math.exp(-0.05 / VEHICLE.thrust_lag_s)
    assert estimator.predict(0.05).motion.thrust == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("late", ["thrust", "rate"])
def test_thrust_and_rates_begin_to_follow_a_command_each_after_its_own_delay(late: str) -> None:
    told = msgspec.structs.replace(VEHICLE, **{f"{late}_delay_s": 0.03})
    estimator, plain = ModelEstimator(told, Gains()), ModelEstimator(VEHICLE, Gains())
    for each in (estimator, plain):
        each.add_command(-0.1, ActuatorCommand(1.0, (0.0, 0.0, 0.0)))
        each.update(Pose(0, 0.0, 0.0, (0.0, 0.0, 0.0), so3.IDENTITY))
        for i in range(9):
            each.add_command(0.01 * i, ActuatorCommand(1.0 + 0.1 * i, (0.1 * i, 0.0, 0.0)))
            each.predict(0.01 * i + 0.005)
    now, then, on_time = (
        one.predict(t).motion for one, t in ((estimator, 0.12), (plain, 0.09), (plain, 0.12))
    )
    for name, delayed in (("thrust", late == "thrust"), ("rates", late == "rate")):
        expected = getattr(then if delayed else on_time, name)
        assert getattr(now, name) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("across_m2", "along_m2", "configured_s", "split"),
    [
        # more than twice as noisy along the motion: the stamps jitter
        (1e-6, 2.1e-6, None, (1e-6, 1.1e-6 / 4.0)),
        (1e-6, 1.9e-6, None, (3.9e-6 / 3.0, 0.0)),  # by chance
        (1e-6, 9.0e-6, 0.0, (11e-6 / 3.0, 0.0)),  # told that there is none
        (1e-6, 1.0e-6, 0.003, (1e-6, 9e-6)),  # told how large it is
        (1e-8, 9.0e-6, None, (1e-7, 8.9e-6 / 4.0)),  # never less noise than the least one
    ],
)
def test_noise_is_split_into_that_of_positions_and_the_jitter_of_stamps(
    across_m2: float, along_m2: float, configured_s: float | None, split: tuple[float, float]
) -> None:
    mean_m2 = (2.0 * across_m2 + along_m2) / 3.0
    assert split_noise(FLOATS, mean_m2, (along_m2, 4.0), 1e-7, configured_s) == pytest.approx(
        split, rel=1e-4
    )


@pytest.mark.parametrize(
    ("jitter_s", "lost_every", "configured_s", "told_s"),
    [
        (0.0, 0, None, 0.0),
        (0.002, 0, None, 0.002),
        (0.0, 7, None, 0.0),  # lost poses are no jitter
        (0.002, 0, 0.0, 0.0),
        (0.0, 0, 0.003, 0.003),
    ],
)
def test_uneven_stamps_of_a_vehicle_at_rest_are_noise_once_it_moves(
    jitter_s: float, lost_every: int, configured_s: float | None, told_s: float
) -> None:
    estimator, draw = ModelEstimator(VEHICLE, Gains(pose_jitter_s=configured_s)), random.Random(5)
    for n in range(1000):
        if not lost_every or n % lost_every:
            stamp_s = 0.01 * n + draw.gauss(0.0, jitter_s)
            estimator.update(Pose(n, stamp_s, stamp_s, (0.0, 0.0, 0.0), so3.IDENTITY))
    noise_m = estimator.noise_m
    assert estimator.find_noise((0.0, 0.0, 0.0)) == noise_m
    noisy_m = math.hypot(noise_m, told_s)
    assert estimator.find_noise((0.6, 0.0, -0.8)) == pytest.approx(noisy_m, rel=0.15)


@pytest.mark.parametrize("uneven", [False, True])
def test_fourth_differences_show_noise_and_jitter_and_no_smooth_motion(uneven: bool) -> None:
    draw, noise_m, jitter_s, speed_m_s = random.Random(3), 0.001, 0.002, 1.5
    sums = [0.0, 0.0, 0.0]
    for _ in range(4000):
        times = [0.01 * k + (0.004 * (k % 2) if uneven else 0.0) for k in range(5)]
        seen = [t + draw.gauss(0.0, jitter_s) for t in times]
        places = [
            (
                speed_m_s * t + 3.0 * t * t + draw.gauss(0.0, noise_m),
                2.0 * t**3 + draw.gauss(0.0, noise_m),
                draw.gauss(0.0, noise_m),
            )
            for t in seen
        ]
        for i, value in enumerate(fourth_difference(times, places)):
            sums[i] += value / 4000.0
    mean_m2, along_m2, way2 = sums
    way_m = 0.04 * speed_m_s + 3.0 * 0.04**2
    expected_m2 = noise_m**2 + (way_m / 0.04 * jitter_s) ** 2
    assert way2 == pytest.approx(way_m**2, rel=0.02)
    assert along_m2 == pytest.approx(expected_m2, rel=0.15)
    assert mean_m2 == pytest.approx((2.0 * noise_m**2 + expected_m2) / 3.0, rel=0.15)


def test_a_direction_is_a_unit_vector_and_none_at_rest() -> None:
    axis, speed2 = find_direction(FLOATS, (1.0, -2.0, 2.0))
    assert (*axis, speed2) == pytest.approx((1.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0, 9.0))
    assert find_direction(FLOATS, (0.0, 0.0, 0.0)) == ((0.0, 0.0, 0.0), 0.0)
    assert part_along((0.6, 0.8, 0.0), (1.0, 2.0, 3.0)) == pytest.approx(
        (2.2 * 0.6, 2.2 * 0.8, 0.0)
    )


@pytest.mark.parametrize(("step_m", "factor"), [(0.2, 1.0), (0.6, 2.0), (3.0, 5.0)])
def test_a_covariance_is_widened_until_it_explains_an_innovation_and_by_five_at_most(
    step_m: float, factor: float
) -> None:
    upper: Covariance = (0.01, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
    # 0.42 m is three times what is expected of three axes of 0.02 m²
    side_m = step_m / math.sqrt(3.0)
    widened = widen_covariance(FLOATS, upper, 0.01, (side_m, -side_m, side_m))
    assert widened == pytest.approx([factor * one for one in upper])


def test_at_lift_off_the_hover_thrusts_error_is_shared_and_friction_forgotten_beside_wind() -> None:
    estimator, _ = flown(CALM, 1.0, effectiveness_deviation=0.15)
    estimator.freeze_effectiveness()
    estimator.set_landing(True)
    estimator.drive((3.0, 4.0, 2.0))
    left = estimator.lift_off(0.4, 1.2)
    # Thrust may be off by 0.15 g = 1.47 m/s², the disturbance by 1 m/s²: 68 % of the error are
    # thrust's.
    weight = 1.4715**2 / (1.4715**2 + 1.0)
    share = 1.0 / (1.0 + 0.2 * weight)
    # Of 5 m/s² aside 0.5 may be friction.
    assert left == pytest.approx((2.7, 3.6, (1.2 * share - 1.0) * 9.81))
    assert estimator.effectiveness == pytest.approx(share)
    assert estimator.effectiveness_deviation == pytest.approx(0.15 * math.sqrt(1.0 - weight))
    assert estimator.motion is not None and estimator.motion.velocity[2] == -0.4
    assert estimator._learns_thrust
    estimator.drive((0.3, 0.0, 0.0))
    assert estimator.lift_off(0.4, 1.0) == pytest.approx((0.0, 0.0, 0.0)), "friction alone"


def test_what_is_held_stays_until_the_poses_are_believed_again() -> None:
    estimator, plant = flown(CALM, 1.0)
    held, told = (0.5, -0.5, 1.0), (0.1, 0.0, 0.0)
    before = estimator.disturbance
    estimator.hold(held, 0.9)
    assert (estimator.effectiveness, estimator.disturbance) == (0.9, before)

    def look(time_s: float) -> None:
        truth = plant.truth(time_s)
        estimator.update(Pose(99, time_s, time_s, truth.position_ned, truth.attitude))

    look(1.02)
    assert (estimator.disturbance, estimator.effectiveness) == (held, 0.9)
    estimator.resume()
    look(1.04)
    assert estimator.disturbance != held
    moved = Motion((1.0, 2.0, -3.0), (0.1, 0.2, 0.3), so3.IDENTITY, 1.0, (0.0, 0.0, 0.0))
    estimator.believe(moved, told, 1.1)
    assert (estimator.motion, estimator.disturbance) == (moved, told)
    assert estimator.effectiveness == 1.1
    estimator.reset_motion(moved)
    look(1.06)
    assert estimator.disturbance != told


@pytest.mark.parametrize(
    ("turned_deg", "across", "along"), [(0.0, 1.0, 5.0), (90.0, 3.0, 1.0), (45.0, 2.0, 3.0)]
)
def test_covariances_turn_with_the_motion(turned_deg: float, across: float, along: float) -> None:
    """Noise along the motion has 5, and noise across it 1: the mean of both directions."""
    angle = math.radians(turned_deg)
    ones: Covariance = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    fives: Covariance = (5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0, 5.0)
    turned = turn_track(
        ones, AlongTrack((1.0, 0.0, 0.0), fives), (math.cos(angle), 0.0, math.sin(angle))
    )
    assert [{round(one, 9) for one in found} for found in turned] == [{across}, {along}]


DRAG = 0.8
"""Linear drag [1/s]."""


@pytest.mark.parametrize("duration_s", [0.02, 0.1, 0.2])
@pytest.mark.parametrize(("speed_m_s", "push_m_s2"), [(2.0, 0.0), (0.0, 3.0), (-1.0, 5.0)])
def test_a_steady_push_against_drag_is_exact_but_for_the_third_order_of_the_time(
    duration_s: float, speed_m_s: float, push_m_s2: float
) -> None:
    motion = Motion(ZERO, (speed_m_s, 0.0, 0.0), IDENTITY, 0.0, ZERO)
    response = ActuatorResponse(IDENTITY, 0.0, ZERO, ZERO, ZERO)
    found = integrate_motion(motion, response, duration_s, 0.1, (push_m_s2, 0.0, 0.0), ZERO, DRAG)
    gone, final = 1.0 - math.exp(-DRAG * duration_s), push_m_s2 / DRAG
    way = final * duration_s + (speed_m_s - final) * gone / DRAG
    beyond = (abs(speed_m_s) / 6.0 + push_m_s2 * duration_s / 24.0) * DRAG**2 * duration_s**3
    assert found.position[0] == pytest.approx(way, abs=beyond)
    assert found.velocity[0] == pytest.approx(
        speed_m_s + (final - speed_m_s) * gone, abs=DRAG * beyond
    )
