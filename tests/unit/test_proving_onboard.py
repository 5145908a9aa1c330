"""What ``groundstation-sim dev autopilots`` makes of what it sees.

The firmware is somebody's own.
"""

from typing import Any

import pytest
from msgspec.structs import replace

from tests.proving.onboard import FLIGHTS, NAMES, TOLD, StrikeResult, set_up

SAFE = StrikeResult("aborted", 5.0, 0.1, 1.0, 1.2, 0.5, 2.0)


@pytest.mark.parametrize(
    ("changed", "ends", "beyond"),
    [
        ({}, True, []),
        ({"up_m": 1.1}, True, ["up 1 m"]),
        ({"aside_m": 3.1}, True, ["aside 3 m"]),
        ({"speed_m_s": 3.1}, True, ["3 m/s"]),
        ({"hit_m_s": 1.1}, True, ["floor 1 m/s"]),
        ({"hit_m_s": None}, True, []),
        ({"off_s": None}, True, ["rotors off"]),
        ({"off_s": None}, False, []),
    ],
)
def test_a_strike_is_judged_by_the_limits_of_the_page_on_trust(
    changed: dict[str, Any], ends: bool, beyond: list[str]
) -> None:
    assert replace(SAFE, **changed).beyond(ends=ends) == beyond


@pytest.mark.parametrize("kind", NAMES)
def test_every_flight_is_set_up_with_forwarded_poses_from_the_floor(kind: str) -> None:
    for figure, _ in FLIGHTS.values():
        world, config = set_up((*TOLD[kind], *figure), 40.0, "natnet")
        assert config.forwards is not None
        assert config.flight.start == "floor"
        assert world.plant == "rotors"
        assert not world.own_estimate
