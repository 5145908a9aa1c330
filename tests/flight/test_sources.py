"""The paper's flight through the real bytes of every pose source."""

import math

import pytest

from groundstation.core.messages import Pose
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from tests.flight.flights import flown

CAMERAS = ["natnet", "qualisys", "vision", "json"]


def rms_cm(source: str) -> float:
    result = flown("paper", source=source, duration_s=20.0)
    assert result.completed, result.why
    assert result.verdict.rms_cm is not None
    return result.verdict.rms_cm


@pytest.mark.tried(1)  # sources
@pytest.mark.parametrize("source", CAMERAS)
def test_paper_tracks_as_well_through_every_source_as_through_vicon(source: str) -> None:
    assert rms_cm(source) == pytest.approx(rms_cm("vicon"), rel=0.1)


def test_the_autopilots_odometry_which_has_a_velocity_is_no_worse() -> None:
    assert rms_cm("odometry") <= min(1.1 * rms_cm("vicon"), 0.30)


@pytest.mark.tried(1)  # vehicles and figures
@pytest.mark.parametrize("figure", [(), ("trajectory.kind=hold",)])
@pytest.mark.parametrize("scenario", ["paper", "quad1kg"])
def test_a_velocity_that_is_off_its_own_positions_moves_the_vehicle_little(
    scenario: str, figure: tuple[str, ...]
) -> None:
    biased = ("sim.velocity_bias=[0.011, -0.01, 0.006]", *figure)

    def rms_cm(*more: str) -> float:
        found = flown(scenario, *biased, *more, source="odometry", duration_s=20.0).verdict.rms_cm
        assert found is not None
        return found

    assert rms_cm() <= 0.4
    assert scenario == "quad1kg" or rms_cm() < 0.5 * rms_cm("controller.velocity_bias_m_s=0")


def test_a_mix_up_of_markers_reaches_the_flight_as_the_tracker_sends_it() -> None:
    world, config = prepare(
        SCENARIOS["paper"], ["sim.swap_s=0.1", "sim.mishap_period_s=4"], source="json"
    )
    poses: list[Pose] = []
    fly(world, config, seed=0, duration_s=4.0, on_pose=poses.append)
    far = [pose for pose in poses if math.hypot(*pose.position_ned[:2]) > 2.0]
    assert 4 <= len(far) <= 6  # 0.1 s of 50 Hz, on the other body's circle
