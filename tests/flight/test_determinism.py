"""A flight in virtual time is a pure function of scenario, seed and overrides."""

import sys
import time

import pytest

from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.stations import run_command
from tests.growth import looks_within

LONGEST = 60.0
"""A minute of flight, in times that two million additions take: measured 24 to 33 [-]."""


@pytest.mark.tried(1)  # links
@pytest.mark.parametrize("link", ["mavlink", "rf_bridge"])
def test_another_process_with_another_hash_seed_gives_the_same_bytes(link: str) -> None:
    """test_library.py flies twice in one process."""
    code = (
        "from sim.scenarios import SCENARIOS, prepare; from sim.runs import fly;"
        f"w, c = prepare(SCENARIOS['adverse'], [], link='{link}'); print(fly(w, c, seed=3, duration_s=4.0).log_sha256)"
    )
    first, second = (run_command([sys.executable, "-c", code], env={"PYTHONHASHSEED": seed}) for seed in ("1", "2"))
    assert len(first.stdout) > 64, first.stderr
    assert first.stdout == second.stdout


def test_a_minute_of_flight_takes_no_longer_than_some_millions_of_additions() -> None:
    """What a minute is promised to take, of whatever processor there is: both are measured by turns."""
    world, config = prepare(SCENARIOS["paper"], [])
    flights, floors = [], []
    for seed in range(3):
        begun = time.process_time()
        fly(world, config, seed=seed, duration_s=10.0)
        flown = time.process_time()
        sum(number & 3 for number in range(2_000_000))
        flights.append(flown - begun)
        floors.append(time.process_time() - flown)
    assert 6.0 * min(flights) < LONGEST * min(floors)


def test_a_minute_of_flight_allocates_nothing_that_stays() -> None:
    _, warm, *_, last = looks_within(60.0, 4)  # few: each goes through all that the tests hold
    assert abs(last["objects"] - warm["objects"]) < 50
    assert abs(last["blocks"] - warm["blocks"]) < 1000
