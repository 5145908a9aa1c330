"""True flights from the floor with the monitor of the poses armed: it accuses nobody, and does not come near it."""

import json
import sys

import pytest

from sim import alarms_command
from sim.__main__ import main
from sim.alarms import KINDS, SHARES, Alarms, Watched, detections, watch_all

NEAR = 0.7
"""No statistic of a true flight comes nearer to what ends it, in the few flights that every run flies [-]."""


def accused(found: Alarms) -> list[tuple[int, tuple[str, ...]]]:
    return [(one.seed, one.accused) for one in found.accused]


@pytest.mark.parametrize("scenario", ["storm", "paper", "adverse", "gust_front"])
def test_the_poses_of_true_flights_are_not_accused(scenario: str) -> None:
    found = watch_all(scenario, range(3), figure_s=15.0, workers=1)
    assert accused(found) == []
    assert max(found.largest.values()) < NEAR, found.largest
    assert all(one.windows > 300 for one in found.flights), "it looked all the way"
    assert all(one.largest["attitude"] > 0.0 for one in found.flights), "and it saw something"


@pytest.mark.parametrize("first", range(3, 24, 3))
@pytest.mark.parametrize("scenario", ["adverse", "storm"])
def test_no_flight_in_bad_air_ends_by_its_poses(scenario: str, first: int) -> None:
    found = watch_all(scenario, range(first, first + 3), figure_s=15.0, workers=1)
    assert [one.seed for one in found.flights if one.ended_by_poses] == []
    assert max(found.largest[kind] for kind in ("attitude", "axes", "heading")) < 1.0


@pytest.mark.soak
@pytest.mark.parametrize("scenario", ["adverse", "storm"])
def test_nor_does_one_of_very_many(scenario: str) -> None:
    found = watch_all(scenario, range(24, 224), figure_s=15.0, workers=2)
    assert [one.seed for one in found.flights if one.ended_by_poses] == []


def test_no_flight_by_an_estimate_that_wanders_and_turns_its_heading_ends_by_its_poses() -> None:
    wanders = ("sim.estimate_wander_m=0.05", "sim.estimate_yaw_step_deg=19")
    found = watch_all("paper", range(2), overrides=wanders, source="odometry", figure_s=15.0, workers=1)
    assert [one.seed for one in found.flights if one.ended_by_poses] == []


def test_a_picture_that_stands_is_seen_the_later_the_higher_the_threshold() -> None:
    curve = detections(1)
    assert [one.share for one in curve] == list(SHARES)
    for times in ([one.hold_s[0] for one in curve], [one.tracking_s[0] for one in curve]):
        found = [time for time in times if time is not None]
        assert found == sorted(found)
    ends = curve[SHARES.index(1.0)]
    assert ends.hold_s[0] is not None
    assert ends.hold_s[0] < 2.0
    assert ends.tracking_s[0] is not None
    assert ends.tracking_s[0] < 1.0


def test_the_command_tells_windows_and_the_largest_statistics(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["alarms", "--scenario", "paper", "--seed", "4", "--flights", "2", "--workers", "2", "--duration", "1"]
    monkeypatch.setattr(sys, "argv", ["groundstation-sim", *words, "--json"])
    assert main() == 0
    told = json.loads(capsys.readouterr().out)
    assert told["windows"] == sum(one["windows"] for one in told["flights"]) > 500
    assert list(told["largest"]) == list(KINDS)
    assert [one["seed"] for one in told["flights"]] == [4, 5]
    assert told["accused"] == 0


def test_an_accusation_is_told_with_its_flight_and_ends_the_command_with_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    one = Watched(
        seed=7, windows=10, largest=dict.fromkeys(KINDS, 0.6), passed=(3, 2, 1, 0, 0, 0, 0),
        accused=("suspicion: they stand",), landed=False, why="a fence",
    )  # fmt: skip
    monkeypatch.setattr(alarms_command, "watch_all", lambda *_, **__: Alarms(flights=(one,)))
    monkeypatch.setattr(sys, "argv", ["groundstation-sim", "alarms", "--flights", "1"])
    assert main() == 1
    told = capsys.readouterr().out.splitlines()
    assert "above 0.5: 1 flights" in told
    assert told[-2:] == ["seed 7: suspicion: they stand", "seed 7: did not land as planned: a fence"]
