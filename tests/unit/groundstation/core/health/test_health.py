"""Health of the poses of a vehicle that is flown by tones."""

import math
from collections.abc import Callable

import pytest

from groundstation.core import geometry as geo
from groundstation.core.geometry import FLOATS, IDENTITY, ZERO, Quat, Vec3, so3
from groundstation.core.health import HealthState, PoseHealth
from groundstation.core.health.health import ClimbMonitor, StopDetector, YawMonitor
from groundstation.core.messages import Pose
from groundstation.core.vehicle import (
    ActuatorCommand,
    Motion,
    Vehicle,
    begin_response,
    integrate_actuators,
)
from tests.calm_air import fly_on

# By their numbers: a limit that the test took from the code would bear out any value.
BLOCK_S = 0.05
BLOCKS = (8, 12, 24, 48)

VEHICLE = Vehicle()
GRAVITY = 9.81
HOVER_N = GRAVITY * VEHICLE.mass_kg
LAGS = (VEHICLE.thrust_lag_s, VEHICLE.rate_lag_s)
DT_S = 0.01
NOISE_M = 0.0003
TONES_RAD_S = (10.5, 14.0, 18.5)
"""Frequencies of the tones."""
TONE_RATE_RAD_S = 0.4
"""Amplitude of the body rate of one tone."""
TONE_SHARE = 0.05
"""Amplitude of the thrust of one tone, as a share of the hover thrust [-]."""

Distort = Callable[[float, list[Motion]], tuple[Vec3, Quat]]
"""The shown position and attitude, by the time [s] and the true motions m at all poses so far."""


def command(time_s: float, yaw_rad_s: float = 0.0) -> ActuatorCommand:
    """Command at ``time_s`` of a vehicle that flies nothing but three tones around the hover."""
    cosines = sum(math.cos(w * time_s) for w in TONES_RAD_S)
    sines = sum(math.sin(w * time_s) for w in TONES_RAD_S)
    rates = (TONE_RATE_RAD_S * cosines, TONE_RATE_RAD_S * sines, yaw_rad_s)
    return ActuatorCommand(HOVER_N * (1.0 + TONE_SHARE * sines), rates)


def fly(
    distort: Distort,
    for_s: float = 3.0,
    *,
    agrees: bool | None = None,
    health: PoseHealth | None = None,
    yaw_rad_s: float = 0.0,
) -> PoseHealth:
    """Fly for ``for_s`` [s], or until the poses fail.

    ``agrees`` is what the autopilot's own attitude says of them.
    """
    health = PoseHealth(VEHICLE.mass_kg, GRAVITY) if health is None else health
    health.set_autopilot_agreement(agrees)
    motions = [Motion((0.0, 0.0, -1.0), ZERO, IDENTITY, HOVER_N, ZERO)]
    for n in range(round(for_s / DT_S)):
        before, time_s = motions[-1], n * DT_S
        drive = command(time_s, yaw_rad_s)
        response = integrate_actuators(FLOATS, begin_response(before), drive, DT_S, *LAGS)
        now = fly_on(VEHICLE, before, drive, DT_S)
        motions.append(now)
        position, attitude = distort(time_s, motions)
        roll, pitch, _ = so3.rotation_vector(
            so3.multiply(so3.conjugate(before.attitude), response.attitude)
        )
        health.add_pose(
            Pose(n, time_s, time_s, position, attitude), before, response,
            geo.subtract(now.position, before.position), (roll, pitch), ZERO, 1.0, NOISE_M, NOISE_M,
            counts=True,
        )  # fmt: skip
        if health.has_failed:
            break
    return health


def shrink_attitude(share: float) -> Distort:
    """Poses that show a share of each turn from level [-]."""

    def distort(time_s: float, m: list[Motion]) -> tuple[Vec3, Quat]:
        turned = so3.rotation_vector(m[-1].attitude)
        return m[-1].position, so3.rotate(IDENTITY, geo.scale(share, turned))

    return distort


def mirror_north(time_s: float, m: list[Motion]) -> tuple[Vec3, Quat]:
    return geo.multiply_each((-1.0, 1.0, 1.0), m[-1].position), m[-1].attitude


def turn_unasked(time_s: float, m: list[Motion]) -> tuple[Vec3, Quat]:
    return m[-1].position, so3.rotate(m[-1].attitude, (0.0, 0.0, 0.4 * time_s))


def run_away(time_s: float, m: list[Motion]) -> tuple[Vec3, Quat]:
    return geo.add(m[-1].position, (0.5 * 15.0 * time_s**2, 0.0, 0.0)), m[-1].attitude


SHOWN: dict[str, Distort] = {
    "truth": lambda _, m: (m[-1].position, m[-1].attitude),
    "attitude freezes": lambda _, m: (m[-1].position, IDENTITY),
    "attitude is late": lambda _, m: (m[-1].position, m[max(len(m) - 21, 0)].attitude),
    "attitude is a twentieth": shrink_attitude(0.05),
    "attitude is a fifth": shrink_attitude(0.2),
    "attitude is twice": shrink_attitude(2.0),
    "position freezes": lambda _, m: (m[0].position, m[-1].attitude),
    "north is mirrored": mirror_north,
    "height freezes": lambda _, m: ((*m[-1].position[:2], -1.0), m[-1].attitude),
    "yaw turns unasked": turn_unasked,
    "runs away": run_away,
}
"""What poses show."""


NO_ANSWER, NOT_THERE = "pose.attitude_no_answer", "pose.position_no_answer"


@pytest.mark.parametrize(
    ("shown", "agrees", "reason_id", "failed_s", "alarm"),
    [
        ("attitude freezes", None, NO_ANSWER, 0.6, 1.20),
        ("attitude is a twentieth", None, NO_ANSWER, 0.6, 1.08),
        ("attitude is a fifth", None, NO_ANSWER, 1.2, 1.34),
        ("attitude is a fifth", False, "pose.autopilot_disagrees", 0.6, 0.72),
        ("attitude is twice", None, NO_ANSWER, 0.6, 1.20),
        ("attitude is late", None, "pose.late", 1.0, 0.0),
        ("position freezes", None, NOT_THERE, 0.85, 3.09),
        ("north is mirrored", None, NOT_THERE, 0.9, 8.97),
        ("height freezes", None, NOT_THERE, 0.9, 1.15),
        ("height freezes", True, NOT_THERE, 0.9, 1.15),
        ("yaw turns unasked", None, "pose.yaw_unasked", 0.5, 1.05),
        ("yaw turns unasked", True, "pose.yaw_unasked", 0.5, 1.05),
        ("runs away", None, "pose.position_mirrored", 0.13, 0.0),
    ],
)
def test_poses_that_show_another_motion_fail_for_their_reason_and_leave_what_still_responds(
    shown: str, agrees: bool | None, reason_id: str, failed_s: float, alarm: float
) -> None:
    health = fly(SHOWN[shown], agrees=agrees)
    assert (health.state, health.reason_id) == (HealthState.FAILED, reason_id)
    assert health.windows * BLOCK_S == pytest.approx(failed_s, abs=0.5 * BLOCK_S + DT_S)
    assert health.alarm == pytest.approx(alarm, rel=0.03, abs=0.01)
    assert health.is_attitude_usable is not shown.startswith("attitude")
    assert not health.is_position_usable
    assert not health.is_confirmed
    assert health.believed_until_s <= failed_s - 0.4, "not within the window that shows it"


@pytest.mark.parametrize("shown", ["truth", "attitude freezes", "attitude is late"])
def test_true_poses_are_confirmed_and_an_autopilot_that_agrees_clears_any_attitude(
    shown: str,
) -> None:
    health = fly(SHOWN[shown], agrees=True)
    assert (health.state, health.reason_id) == (HealthState.OK, "")
    assert health.alarm == pytest.approx(0.0, abs=1e-9)
    assert not health.is_suspect
    assert health.is_confirmed is (shown == "truth")
    assert health.is_attitude_usable and health.is_position_usable
    assert health.calm_s == pytest.approx(2.95)
    assert health.believed_until_s == pytest.approx(health.calm_s - BLOCKS[0] * BLOCK_S)


@pytest.mark.parametrize("yaw_rad_s", [0.3, -0.3])
def test_a_vehicle_that_turns_as_it_is_told_is_not_suspect(yaw_rad_s: float) -> None:
    health = fly(SHOWN["truth"], yaw_rad_s=yaw_rad_s)
    assert health.state is HealthState.OK and health.is_confirmed
    assert health.alarm < 0.01


def test_a_weak_response_is_suspect_for_a_second_at_most() -> None:
    health = fly(shrink_attitude(0.2), 0.8)
    assert (health.state, health.reason_id) == (HealthState.SUSPECT, "pose.suspect")
    assert health.is_suspect and health.is_attitude_usable and not health.is_confirmed
    passing = PoseHealth(VEHICLE.mass_kg, GRAVITY)
    passing.suspect(0.0)
    fly(SHOWN["truth"], 0.3, health=passing)
    assert passing.is_suspect, "true poses are known after their shortest window"
    fly(SHOWN["truth"], 1.0, health=passing)
    assert (passing.state, passing.reason_id) == (HealthState.OK, "")


def test_failed_is_final_and_keeps_the_first_reason() -> None:
    health = PoseHealth(VEHICLE.mass_kg, GRAVITY)
    health.believed_until_s = 5.0
    health.fail("pose.late", 3.0)
    health.fail("pose.yaw_unasked", 1.0)
    health.suspect(4.0)
    assert (health.state, health.reason_id) == (HealthState.FAILED, "pose.late")
    assert health.believed_until_s == 3.0


@pytest.mark.parametrize("lag_s", [0.0, 0.3, 0.5])
def test_a_yaw_that_follows_its_command_within_the_autopilots_lag_is_no_drift(lag_s: float) -> None:
    monitor, commanded = YawMonitor(), [0.5 if 50 <= n < 100 else 0.0 for n in range(200)]
    lag = round(lag_s / DT_S)
    shown = [0.0] * lag + commanded
    drifts = [monitor.add_pose(n * DT_S, shown[n], commanded[n], DT_S) for n in range(200)]
    assert max(drifts) == 0.0


@pytest.mark.parametrize(("beyond_rad_s", "dt_s"), [(0.3, 0.01), (-0.3, 0.02)])
def test_a_yaw_that_nobody_asked_for_is_its_mean_over_a_second(
    beyond_rad_s: float, dt_s: float
) -> None:
    monitor, count = YawMonitor(), round(1.0 / dt_s)
    shown = 0.2 + beyond_rad_s
    drifts = [monitor.add_pose(n * dt_s, shown, 0.2, dt_s) for n in range(count)]
    assert drifts[-1] == pytest.approx(0.3 * (1.0 - 1.0 / math.e), rel=0.02)


@pytest.mark.parametrize(
    ("hover_share", "thrust_share", "shown_m_s", "noise_m", "behind_s"),
    [
        (1.0, 1.0, 0.5, 0.0003, None),  # it climbs as its thrust makes it
        (1.0, 1.0, 0.0, 0.0003, 0.15),  # the poses stay on the floor
        (0.8, 0.8, 0.0, 0.0003, 0.15),  # a light vehicle hovers by less
        (1.0, 1.3, 0.0, 0.0003, 0.11),  # with more thrust it would be higher
        (1.0, 1.0, 0.0, 0.006, 0.21),  # noise takes three of its errors
        (1.0, 1.0, 0.25, 0.0003, None),  # half the climb: wind may hold it down so long
    ],
)
def test_a_height_behind_its_thrust_is_found_until_the_vehicle_has_climbed_out(
    hover_share: float,
    thrust_share: float,
    shown_m_s: float,
    noise_m: float,
    behind_s: float | None,
) -> None:
    monitor, force = ClimbMonitor(hover_share, 0.5, GRAVITY), -GRAVITY * thrust_share
    pushed = (force * DT_S, 0.5 * force * DT_S * DT_S)
    behind, n = False, 0
    while not behind and not monitor.is_over:
        n += 1
        behind = bool(monitor.add_pose(shown_m_s * DT_S, *pushed, DT_S, noise_m))
    assert behind is (behind_s is not None)
    if behind_s is not None:
        assert n * DT_S == pytest.approx(behind_s, abs=1e-6)
    else:
        assert n * DT_S == pytest.approx(0.25 / shown_m_s, abs=0.02)


# ---- a place that stopped dead

FRAME_S = 0.02


def watch_stop(
    places_m: list[float],
    model_m_s: list[float],
    commanded_m_s2: float = 0.0,
    noise_m: float = NOISE_M,
    way: Vec3 = (1.0, 0.0, 0.0),
) -> tuple[bool, bool]:
    """Whether a vehicle at ``places_m`` along ``way`` stopped dead by its poses, and is asked.

    The model has it at ``model_m_s`` before each pose, and commands give it ``commanded_m_s2``.
    """
    detector, stopped, asked, since_s = StopDetector(), False, False, 0.0
    for n, (place_m, speed_m_s) in enumerate(zip(places_m, model_m_s, strict=True)):
        pose = Pose(n, since_s, since_s, geo.scale(place_m, way), IDENTITY)
        before = Motion(ZERO, geo.scale(speed_m_s, way), IDENTITY, 0.8, ZERO)
        commanded = geo.scale(commanded_m_s2, way)
        found_s = detector.add_pose(pose, before, commanded, ZERO, FRAME_S, noise_m)
        stopped |= found_s is not None
        asked |= detector.is_driven
        since_s += FRAME_S
    return stopped, asked


def test_a_speed_that_only_the_model_has_is_no_stop() -> None:
    """After an outage in gusts the model may have a speed that no pose has shown."""
    assert watch_stop(30 * [0.0], 30 * [0.3]) == (False, False)


@pytest.mark.parametrize(
    ("speed_m_s", "commanded_m_s2", "noise_m", "stopped"),
    [
        (0.3, 0.0, NOISE_M, True),
        (-0.6, 0.0, NOISE_M, True),
        (1.5, 0.0, NOISE_M, True),
        (0.16, 0.0, NOISE_M, True),
        (0.14, 0.0, NOISE_M, False),  # a collision takes .15 m/s within a pose; less is noise
        (0.24, 3.0, NOISE_M, True),
        (0.21, 3.0, NOISE_M, False),  # and 25 ms of a push beyond that: commands may be mistimed so
        (0.36, 0.0, 0.002, False),  # within four sigma, 8 mm, 1 g turns back up to 0.4 m/s
        (0.44, 0.0, 0.002, True),
    ],
)
def test_a_picture_that_freezes_is_stopped_dead_unless_its_motion_was_slow_or_lost_in_noise(
    speed_m_s: float, commanded_m_s2: float, noise_m: float, stopped: bool
) -> None:
    moves = [n * FRAME_S * speed_m_s for n in range(10)]
    watched = moves + 9 * moves[-1:], 19 * [speed_m_s], commanded_m_s2, noise_m
    for way in (
        (1.0, 0.0, 0.0),
        (0.70711, 0.70711, 0.0),
        (-0.70711, 0.70711, 0.0),
        (0.0, 0.0, 1.0),
    ):
        assert watch_stop(*watched, way)[0] is stopped


@pytest.mark.parametrize(
    ("commanded_m_s2", "stopped", "asked"),
    [
        (0.3, False, False),
        (1.0, False, True),
        (1.25, False, True),
        (1.4, False, True),
        (1.45, True, True),
        (2.5, True, True),
    ],
)
def test_a_place_that_stands_while_commands_push_is_asked_and_beyond_any_wind_accused(
    commanded_m_s2: float, stopped: bool, asked: bool
) -> None:
    assert watch_stop(28 * [0.0], 28 * [0.0], commanded_m_s2) == (stopped, asked)
