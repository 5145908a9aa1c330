"""The paper's flight through the real bytes of every pose source."""

import math
from functools import partial

import pytest

from groundstation.core.messages import Pose
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from tests.flight import flights

CAMERAS = ["natnet", "qualisys", "vision", "json"]


rms_cm = partial(flights.rms_cm, duration_s=20.0)


@pytest.mark.tried(1)  # sources
@pytest.mark.parametrize("source", CAMERAS)
def test_paper_tracks_as_well_through_every_source_as_through_vicon(source: str) -> None:
    assert rms_cm("paper", source=source) == pytest.approx(rms_cm("paper"), rel=0.1)


def test_the_autopilots_odometry_which_has_a_velocity_is_no_worse() -> None:
    assert rms_cm("paper", source="odometry") <= min(1.1 * rms_cm("paper"), 0.30)


@pytest.mark.tried(1)  # vehicles and figures
@pytest.mark.parametrize("figure", [(), ("trajectory.kind=hold",)])
@pytest.mark.parametrize("scenario", ["paper", "quad1kg"])
def test_a_velocity_that_is_off_its_own_positions_moves_the_vehicle_little(
    scenario: str, figure: tuple[str, ...]
) -> None:
    biased = ("sim.velocity_bias=[0.011, -0.01, 0.006]", *figure)
    off_cm = rms_cm(scenario, *biased, source="odometry")
    assert off_cm <= 0.4
    if scenario == "paper":
        believed = (*biased, "controller.velocity_bias_m_s=0")
        assert off_cm < 0.5 * rms_cm(scenario, *believed, source="odometry")


def test_a_mix_up_of_markers_reaches_the_flight_as_the_tracker_sends_it() -> None:
    swaps = ["sim.swap_s=0.1", "sim.mishap_period_s=4"]
    world, config = prepare(SCENARIOS["paper"], swaps, source="json")
    poses: list[Pose] = []
    fly(world, config, seed=0, duration_s=4.0, on_pose=poses.append)
    far = [pose for pose in poses if math.hypot(*pose.position_ned[:2]) > 2.0]
    assert 4 <= len(far) <= 6  # 0.1 s of 50 Hz, on the other body's circle
