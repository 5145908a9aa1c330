"""True flights from the floor with the monitor of the poses: none ends by its poses."""

import math
from pathlib import Path
from statistics import mean

import pytest

from groundstation.analysis.evidence import drive_flight, load_flight
from groundstation.core.pilot import Pilot
from groundstation.core.safety import WANDERING_M
from tests.proving.alarms import WRONGS, Watch, WatchedHealth, plan_floors, watch_all

GOLDEN = Path(__file__).parents[1] / "golden"
BEFORE_S = 10.0
"""Poses and set-points of a recorded flight are taken from so long before it on [s]."""
STOOD_S = 1.0
"""Time before a recorded flight in which it stands where its floor is [s]."""


@pytest.mark.tried(1)  # the worst air
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("scenario", ["storm", "adverse", "gust_front"])
def test_no_flight_in_bad_air_ends_by_its_poses(scenario: str, seed: int) -> None:
    (found,) = watch_all([Watch(scenario, figure_s=5.0)], (seed,), workers=1)
    assert not found.ended_by_poses
    assert found.alarm < 1.0
    assert all(one.windows > 200 for one in found.flights), "it looked all the way"
    assert found.alarm > 0.0, "and it saw something"


@pytest.mark.tried(1)  # flights
@pytest.mark.parametrize(
    ("scenario", "seed", "what"),
    [
        ("adverse", 7000036, "wind that the law answered held the height still while it climbed"),
        ("adverse", 7000029, "the same in a hold"),
        ("storm", 7000019, "speed that the model alone had after an outage"),
        ("storm", 7000017, "a short window knew its own scatter too well"),
        ("storm", 8000082, "a window that rested on the pose after an outage"),
    ],
)
def test_flights_that_a_monitor_ended_once_are_flown(scenario: str, seed: int, what: str) -> None:
    (found,) = watch_all([Watch(scenario)], (seed,), workers=1)
    assert not found.ended_by_poses, what
    assert found.alarm < 0.75, what


@pytest.mark.tried(1)  # what is wrong
@pytest.mark.parametrize("floor", WRONGS, ids=lambda floor: floor.name)
def test_no_flight_ends_by_its_poses_where_something_is_configured_wrong(floor: object) -> None:
    (*_, watch) = [one for one in plan_floors(Watch("", figure_s=5.0)) if one.floor == floor]
    (found,) = watch_all([watch], (0,), workers=1)
    assert not found.ended_by_poses
    # Of what it was told it would weigh 174 % at full thrust, and stays on the floor.
    assert found.not_flown == (1 if watch.floor is not None and "0.62" in watch.floor.name else 0)


@pytest.mark.tried(1)  # the one whose height is wrong on the floor
@pytest.mark.parametrize(
    ("scenario", "seed"), [("quad1kg", 16), ("quad1kg", 18), ("paper", 0), ("paper", 1)]
)
def test_an_estimate_that_wanders_and_turns_its_heading_fails_not_and_lands(
    scenario: str, seed: int
) -> None:
    wanders = ("sim.estimate_wander_m=0.05", "sim.estimate_yaw_step_deg=19")
    own = ("sim.own_estimate=true",) if scenario == "quad1kg" else ()
    watch = Watch(scenario, overrides=own + wanders, source="odometry")
    (found,) = watch_all([watch], (seed,), workers=1)
    assert not found.ended_by_poses
    assert [one.why for one in found.flights if not one.landed] == []


def watch_recording(file: Path) -> WatchedHealth:
    """Monitor the poses of a recorded autopilot's flight, with the commands that were sent."""
    driven = drive_flight(load_flight(file), [])
    config, poses = driven.config, driven.flight.poses
    begin, end = driven.air.start, driven.air.stop
    lifts_s, ends_s = poses[begin].arrival_s, poses[end - 1].arrival_s
    last_s = lifts_s - BEFORE_S
    stood = [pose.position_ned[2] for pose in poses[:begin] if pose.arrival_s >= lifts_s - STOOD_S]
    floor_z_m = mean(stood) if stood else math.inf  # a recording may begin in the air
    pilot = Pilot(
        config.vehicle, config.controller, config.flight.coast_s, floor_z_m, health=WatchedHealth
    )
    state, lifted = pilot.state, False
    pilot.set_on_floor()
    events = [(pose.arrival_s, 0, i) for i, pose in enumerate(poses)]
    events += [(time_s, 1, i) for i, (time_s, _) in enumerate(driven.commands)]
    for time_s, is_command, index in sorted(e for e in events if last_s <= e[0] <= ends_s):
        if not is_command:
            pose = poses[index]
            pilot.estimate_state(pose)
            if not lifted and index >= begin and floor_z_m - pose.position_ned[2] > WANDERING_M:
                lifted = True
                pilot.lift_off(time_s, 1.0, -(pose.velocity_ned or (0.0, 0.0, 0.0))[2])
        elif state.newest_pose is not None:
            state.add_command(time_s, driven.commands[index][1])
            state.mean_disturbance.add(state.estimator.predict(time_s), time_s - last_s)
            last_s = time_s
    assert isinstance(state.health, WatchedHealth), "made by this"
    return state.health


@pytest.mark.parametrize("name", ["px4_takeoff", "ardupilot_landing"])
def test_poses_of_real_autopilots_do_not_fail(name: str) -> None:
    health = watch_recording(GOLDEN / f"{name}.tlog")
    assert not health.has_failed, health.reason_id
    assert health.windows > 50
