"""What ``groundstation-sim dev autopilots`` makes of what it sees; the firmware is somebody's own."""

import argparse
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
    StrikeResult,
    TakeOff,
    autopilots,
    set_up,
)
from tests.proving.takeoff_start import TakeoffStart

LANDED = MissionResult(
    landed=True, why="landed", states=(), touchdown_m_s=0.3, rms_cm=0.25, max_cm=0.9, figure_s=25.0, home_m=0.004,
    fault="", warnings=(), tilt_max_deg=5.0, duration_s=80.0, wall_s=40.0,
)  # fmt: skip
LOST = msgspec.structs.replace(LANDED, landed=False, rms_cm=None, max_cm=None)
SAFE = StrikeResult("aborted", 5.0, 0.1, 1.0, 1.2, 0.5, 2.0)


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
        autopilots(args)
