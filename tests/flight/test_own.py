"""A user's own configuration at the desk: every preset vehicle, courses from rest to rest."""

import math
from pathlib import Path

import pytest

from groundstation.config import ConfigError, presets
from groundstation.core.vehicle import Vehicle
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare_own
from tests.flight.flights import ticks_to

COURSE = "t_s,north_m,east_m,up_m,yaw_deg\n0,0,0,1,0\n2,1,0,1.2,45\n4,1,1,1,90\n6.5,0,0,1.5,0\n"
SQUARE = (
    'kind = "waypoints"\npoints_ned = [[0, 0, -1], [1, 0, -1], [1, 1, -1.5], [0, 0, -1]]\n'
    "max_speed_m_s = 1.0"
)


def flown_cm(
    folder: Path, vehicle: str, trajectory: str, duration_s: float, *overrides: str
) -> list[float]:
    """The true error at every plant step [cm]."""
    path = folder / "lab.toml"
    poses = "latency_s = 0.01\nrate_hz = 100.0"
    poses = "[pose]\nkind = 'vicon'\nlatency_s = 0.01\nrate_hz = 100.0"
    path.write_text(f"[vehicle]\n{vehicle}\n{poses}\n[trajectory]\n{trajectory}\n", "utf-8")
    world, config, _ = prepare_own(SCENARIOS["paper"], path, list(overrides))
    starts: list[float] = []
    watch = ticks_to(lambda tick: starts.append(tick.estimate.time_s - tick.flight_time_s))
    result = fly(world, config, seed=3, duration_s=duration_s, watch=watch)
    assert result.completed, result.why
    return [100.0 * error for error in result.track.errors(config.trajectory.build(), starts[0])]


@pytest.mark.tried(1)  # vehicles
@pytest.mark.parametrize("name", presets(Vehicle))
@pytest.mark.parametrize("trajectory", ["hold", "lemniscate"])
def test_every_vehicle_that_comes_along_holds_and_flies_the_eight(
    name: str, trajectory: str, tmp_path: Path
) -> None:
    errors = flown_cm(tmp_path, f'preset = "{name}"', f'kind = "{trajectory}"', 8.0)
    late = errors[-len(errors) // 4 :]
    assert math.sqrt(sum(e * e for e in late) / len(late)) < 0.3


@pytest.mark.tried(1)  # courses, which contract/test_trajectories.py has
@pytest.mark.parametrize(
    "trajectory",
    [
        'kind = "waypoints"\nfile = "course.csv"',
        SQUARE,
        'kind = "lemniscate"\nlaps = 1\nramp_s = 3.0\nspeed_m_s = 1.0',
    ],
    ids=["a course from a CSV", "points with times found", "a lap of the eight"],
)
def test_a_course_from_rest_to_rest_is_followed_to_its_end(trajectory: str, tmp_path: Path) -> None:
    (tmp_path / "course.csv").write_text(COURSE, "utf-8")
    # Hover thrust and no wind from the start on: whatever error there is, the course makes.
    calm = ("sim.wind_mean=[0.0, 0.0, 0.0]", "sim.start_thrust=0.9")
    errors = flown_cm(tmp_path, 'preset = "x500"', trajectory, 10.0, *calm)
    assert max(errors) < 1.5
    assert max(errors[-100:]) < 0.3


def test_the_eight_at_full_speed_from_the_start_is_not_what_a_ramp_is(tmp_path: Path) -> None:
    calm = ("sim.wind_mean=[0.0, 0.0, 0.0]", "sim.start_thrust=0.9")
    eight = 'kind = "lemniscate"\nspeed_m_s = 1.0'
    errors = flown_cm(tmp_path, 'preset = "x500"', eight, 4.0, *calm)
    assert max(errors) > 10.0


def test_the_truth_follows_the_told_vehicle_until_it_is_overridden(tmp_path: Path) -> None:
    path = tmp_path / "lab.toml"
    path.write_text('[vehicle]\npreset = "x500"\n[flight]\nduration_s = 7.0\n', "utf-8")
    overrides = ["vehicle.mass_kg=2.2", "sim.thrust_gain=0.9", "sim.thrust_lag_s=0.05"]
    world, config, wanted_s = prepare_own(SCENARIOS["adverse"], path, overrides)
    assert wanted_s == 7.0
    assert (world.mass_kg, world.thrust_max_n, world.thrust_lag_s) == (2.2, 34.2, 0.05)
    assert (world.thrust_gain, world.pose_loss) == (0.9, SCENARIOS["adverse"].world.pose_loss)
    assert (config.vehicle.mass_kg, config.vehicle.thrust_lag_s) == (2.2, 0.025)
    assert world.command_delay_s == config.vehicle.command_delay_s == 0.005
    with pytest.raises(ConfigError, match=r"sim\.masskg: unknown key"):
        prepare_own(SCENARIOS["paper"], path, ["sim.masskg=1"])
