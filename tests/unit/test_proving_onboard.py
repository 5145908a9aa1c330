"""What ``groundstation-sim dev autopilots --lockstep`` makes of what it sees; the firmware is somebody's own."""

import argparse
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundstation.config import ConfigError
from sim.runs import MissionResult
from tests.proving.onboard import (
    FLIGHTS,
    NAMES,
    STRIKES,
    TOLD,
    Change,
    Facts,
    Struck,
    TakeOff,
    as_json,
    fly_in_lockstep,
    set_up,
    tables,
)
from tests.proving.takeoff_start import TakeoffStart

LANDED = MissionResult(
    landed=True, why="landed", states=(), touchdown_m_s=0.3, rms_cm=0.25, max_cm=0.9, figure_s=25.0, home_m=0.004,
    fault="", warnings=(), tilt_max_deg=5.0, duration_s=80.0, wall_s=40.0,
)  # fmt: skip
LOST = msgspec.structs.replace(LANDED, landed=False, rms_cm=None, max_cm=None)
SAFE = Struck("aborted", 5.0, 0.1, 1.0, 1.2, 0.5, 2.0)


def start(thrust: float) -> TakeoffStart:
    made = TakeoffStart()
    made.thrust, made.climb, made.tilt_deg, made.b = [thrust], [0.1], [2.0], [0.2]
    return made


def facts(**changed: Any) -> Facts:
    return Facts(
        [Change("EKF2_HGT_REF", 1.0, 3.0)],
        {name: [LANDED, LANDED] for name in FLIGHTS},
        [TakeOff(LANDED, start(1.0)), TakeOff(LANDED, start(1.0))],
        {name: [SAFE] for name in STRIKES},
    )._replace(**changed)


def test_the_tables_have_a_row_for_each_flight_and_strike() -> None:
    text = tables({"PX4": facts()})
    assert "| PX4, hover | 0.25 (0.25) | 0.9 | 0.3 |" in text
    assert "| PX4 | 2 of 2 | 2 of 2 | 1.00 to 1.00 |" in text
    assert text.count("| yes |") == len(STRIKES)
    assert text.endswith("The doctor set on PX4: `EKF2_HGT_REF` 1 → 3.")


def test_what_was_lost_and_what_went_too_far_is_named() -> None:
    lost = {name: [LANDED, LOST] for name in FLIGHTS}
    text = tables({"PX4": facts(figures=lost, take_offs=[TakeOff(LOST, TakeoffStart()), TakeOff(LANDED, start(1.5))])})
    assert "| PX4, hover | 0.25 (0.25), 1 of 2 lost |" in text
    assert "| PX4 | 1 of 2 | 0 of 2 | 1.50 to 1.50 |" in text
    none = facts(take_offs=[TakeOff(LOST, TakeoffStart())])
    assert "| PX4 | 0 of 1 | 0 of 1 | – |" in tables({"PX4": none})


@pytest.mark.parametrize(
    ("changed", "beyond"),
    [
        ({}, []),
        ({"up_m": 1.1}, ["up 1 m"]),
        ({"aside_m": 3.1}, ["aside 3 m"]),
        ({"speed_m_s": 3.1}, ["3 m/s"]),
        ({"hit_m_s": 1.1}, ["floor 1 m/s"]),
        ({"hit_m_s": None}, []),
        ({"off_s": None}, ["rotors off"]),
    ],
)
def test_a_strike_is_judged_by_the_limits_of_the_page_on_trust(changed: dict[str, Any], beyond: list[str]) -> None:
    assert SAFE._replace(**changed).beyond(ends=True) == beyond


def test_a_flight_that_a_strike_does_not_end_may_go_on() -> None:
    assert SAFE._replace(off_s=None).beyond(ends=False) == []


def test_the_same_facts_are_json() -> None:
    read = json.loads(as_json({"PX4": facts()}))["PX4"]
    assert read["changes"] == [{"name": "EKF2_HGT_REF", "before": 1.0, "now": 3.0}]
    assert read["strikes"]["kill -9"][0]["aside_m"] == 1.0
    assert read["take_offs"][0]["smooth"]


@pytest.mark.parametrize("kind", NAMES)
def test_every_flight_is_set_up_with_forwarded_poses_from_the_floor(kind: str) -> None:
    for figure, _ in FLIGHTS.values():
        world, config = set_up((*TOLD[kind], *figure), 40.0, "natnet")
        assert config.forwards is not None
        assert config.flight.start == "floor"
        assert world.plant == "rotors"
        assert not world.own_estimate


@pytest.mark.parametrize("kind", NAMES)
def test_a_folder_in_which_nothing_was_built_is_one_sentence(kind: str, tmp_path: Path) -> None:
    args = argparse.Namespace(px4=None, ardupilot=None, write=None, json=False, take_offs=1)
    setattr(args, kind, tmp_path)
    with pytest.raises(ConfigError, match=f"--{kind}: expected a folder in which"):
        fly_in_lockstep(args)
