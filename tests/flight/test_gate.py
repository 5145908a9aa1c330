"""The gate in whole flights: it lets real ones be, and bears or ends those whose poses go wrong."""

import pytest

from groundstation.core.messages import Pose, tell_lines
from groundstation.pose.sources import Gate
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare


@pytest.mark.tried(1)  # scenarios
@pytest.mark.parametrize("scenario", list(SCENARIOS))
def test_no_pose_of_any_scenario_is_dropped_or_changed(scenario: str) -> None:
    world, config = prepare(SCENARIOS[scenario], [])
    poses: list[Pose] = []
    duration_s = 12.0 if world.pose_rate_hz < 200.0 else 4.0
    assert fly(world, config, seed=1, duration_s=duration_s, on_pose=poses.append).completed
    gate = Gate(config.gate)
    assert len(poses) > 500
    assert all(gate.filter_pose(pose) == (pose, None) for pose in poses)


def test_a_tracker_that_shows_a_hidden_body_where_it_was_last_is_found_out() -> None:
    world, config = prepare(SCENARIOS["paper"], ["sim.occlusion_s=0.1", "sim.mishap_period_s=4"])
    told: list[str] = []
    result = fly(world, config, seed=0, duration_s=8.0, watch=tell_lines(told.append))
    assert result.completed, result.why
    assert any("frozen (the same to the last bit" in line for line in told)
