"""The gate in whole flights: it lets real ones be, and bears or ends those whose poses go wrong."""

import random

import pytest

from groundstation.core.messages import Pose, tell_lines
from groundstation.pose.sources import Gate
from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from sim.trackers import trackers
from tests.flight.flights import fly_fault
from tests.proving.faults.cell import NEAR
from tests.proving.faults.faults import find_fault


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


@pytest.mark.tried(1)  # pushes
@pytest.mark.parametrize(
    ("push", "jitter_s"),
    [("push: 6 for 1 s", 0.002), ("push: 6 for 0.4 s", 0.003), ("wind step: 5", 0.003)],
)
def test_a_push_is_flown_through_on_stamps_that_jitter(
    push: str, jitter_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Jitter of 2 ms, of 10 ms from pose to pose, is 4 mm at 2 m/s: ten times a hold's noise."""
    encoder, draw = trackers.json_encoder, random.Random(5)

    def with_jitter(config: trackers.JsonConfig) -> trackers.Encoder:
        encode = encoder(config)
        return lambda frame, stamp_s, bodies: encode(
            frame, stamp_s + draw.gauss(0.0, jitter_s), bodies
        )

    monkeypatch.setattr(trackers, "json_encoder", with_jitter)
    fault = find_fault(push, "tracking", "mavlink")._replace(source="json")
    row = fly_fault(push, fault, "tracking", overrides=NEAR)
    assert row.reaction == "flies on", row.why
    assert row.far_m < 1.0


def test_a_tracker_that_shows_a_hidden_body_where_it_was_last_is_found_out() -> None:
    world, config = prepare(SCENARIOS["paper"], ["sim.occlusion_s=0.1", "sim.mishap_period_s=4"])
    told: list[str] = []
    result = fly(world, config, seed=0, duration_s=8.0, watch=tell_lines(told.append))
    assert result.completed, result.why
    assert any("frozen (the same to the last bit" in line for line in told)
