"""The gate in whole flights: it lets real ones be, and bears or ends those whose poses go wrong."""

from functools import cache

import pytest

from groundstation.core.messages import Pose
from groundstation.pose.sources import Gate
from sim.runs import fly
from sim.runs.flight import Result
from sim.scenarios import SCENARIOS, prepare


@cache
def told(scenario: str, *overrides: str, source: str = "vicon", duration_s: float = 8.0) -> tuple[Result, list[str]]:
    """A flight, and what the operator was told of its poses."""
    world, config = prepare(SCENARIOS[scenario], list(overrides), source=source)
    events: list[str] = []
    result = fly(world, config, seed=0, duration_s=duration_s, on_event=lambda event: events.append(event.line))
    return result, [
        line.partition(" ")[2] for line in events if "dropped" in line or line.split(" ", 1)[1].startswith("poses are")
    ]


@pytest.mark.tried(1)  # scenarios
@pytest.mark.parametrize("scenario", list(SCENARIOS))
def test_no_pose_of_any_scenario_is_dropped_or_changed(scenario: str) -> None:
    world, config = prepare(SCENARIOS[scenario], [])
    poses: list[Pose] = []
    duration_s = 12.0 if world.pose_rate_hz < 200.0 else 4.0
    assert fly(world, config, seed=1, duration_s=duration_s, on_pose=poses.append).completed
    gate = Gate(config.gate)
    assert len(poses) > 500
    assert all(gate.take(pose) == (pose, None) for pose in poses)


@pytest.mark.tried(1)  # sources
@pytest.mark.parametrize("source", ["vicon", "natnet", "json", "vision"])
def test_a_short_mix_up_of_bodies_does_not_reach_the_controller(source: str) -> None:
    mishaps = ("sim.swap_s=0.1", "sim.mishap_period_s=4", "sim.other_bodies=2")
    result, words = told("paper", *mishaps, source=source, duration_s=20.0)
    assert result.completed, result.why
    assert result.verdict.max_cm is not None and result.verdict.max_cm < 3.0
    assert sum(line.startswith("poses are dropped: jump") for line in words) == 5
    assert sum(line.startswith("jump is over: 5 dropped") for line in words) >= 4


def test_a_long_mix_up_ends_the_flight_by_its_bring_down_and_is_told_as_that() -> None:
    mishaps = ("sim.swap_s=1.0", "sim.mishap_period_s=4", "sim.other_bodies=2")
    result, words = told("paper", *mishaps, source="json")
    assert "no pose for 2" in result.why
    assert words[0].startswith("poses are dropped: jump")


def test_a_tracker_that_shows_a_hidden_body_where_it_was_last_is_found_out() -> None:
    mishaps = ("sim.occlusion_s=0.1", "sim.mishap_period_s=4")
    result, words = told("paper", *mishaps)
    assert result.completed, result.why
    assert any("frozen (the same to the last bit" in line for line in words)
