"""True flights from the floor with the monitor of the poses armed: it accuses nobody, and does not come near it."""

import json
import sys

import pytest

from groundstation.control.obedience import Contradiction
from sim import alarms_command
from sim.__main__ import main
from sim.alarms import KINDS, SHARES, Alarms, Watched, detections, watch_all, watched

NEAR = 0.7
"""No statistic of a true flight comes nearer to what convicts [-]."""


def assert_innocent(found: Alarms) -> None:
    assert [(one.seed, one.accused) for one in found.accused] == []
    assert max(found.largest.values()) < NEAR, found.largest


@pytest.mark.parametrize("scenario", ["paper", "adverse", "storm", "gust_front"])
def test_the_poses_of_a_true_flight_are_not_accused(scenario: str) -> None:
    found = watch_all(scenario, range(3), figure_s=15.0, workers=1)
    assert_innocent(found)
    assert all(one.windows > 300 for one in found.flights), "it looked all the way"
    assert all(one.largest["attitude"] > 0.0 for one in found.flights), "and it saw something"


@pytest.mark.parametrize("first", range(3, 50, 6))
@pytest.mark.parametrize("scenario", ["adverse", "storm"])
def test_nor_are_those_of_many_in_bad_air(scenario: str, first: int) -> None:
    assert_innocent(watch_all(scenario, range(first, min(first + 6, 50)), figure_s=15.0, workers=1))


def test_an_estimate_that_wanders_and_turns_its_heading_is_not_accused() -> None:
    """As PX4's does, without a position sensor."""
    wanders = ("sim.estimate_wander_m=0.05", "sim.estimate_yaw_step_deg=19")
    assert_innocent(watch_all("paper", range(2), overrides=wanders, source="odometry", figure_s=15.0, workers=1))


def test_axes_that_are_set_up_wrongly_are_told_and_end_the_command_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(alarms_command, "watch_all", lambda *_, **__: Alarms(flights=(_watched(("convicted: x",)),)))
    monkeypatch.setattr(sys, "argv", ["groundstation-sim", "alarms", "--flights", "1"])
    assert main() == 1
    assert "seed 7: convicted: x" in capsys.readouterr().out


def test_the_command_tells_windows_and_the_largest_statistics(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["groundstation-sim", "alarms", "--scenario", "paper", "--flights", "2", "--workers", "2", "--json"]
    monkeypatch.setattr(sys, "argv", [*words, "--duration", "1"])
    assert main() == 0
    told = json.loads(capsys.readouterr().out)
    assert told["windows"] == sum(one["windows"] for one in told["flights"]) > 500
    assert list(told["largest"]) == list(KINDS)
    assert [one["seed"] for one in told["flights"]] == [0, 1]
    assert told["accused"] == 0
