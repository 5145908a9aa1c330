"""What ``groundstation-sim dev autopilots`` makes of what it sees; the firmware is somebody's own."""

import argparse
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from groundstation.config import ConfigError
from tests.proving.onboard import (
    FLIGHTS,
    NAMES,
    TOLD,
    StrikeResult,
    autopilots,
    set_up,
)

SAFE = StrikeResult("aborted", 5.0, 0.1, 1.0, 1.2, 0.5, 2.0)


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
    assert replace(SAFE, **changed).beyond(ends=True) == beyond


def test_a_flight_that_a_strike_does_not_end_may_go_on() -> None:
    assert replace(SAFE, off_s=None).beyond(ends=False) == []


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
