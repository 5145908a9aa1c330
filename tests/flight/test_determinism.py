"""A flight in virtual time is a pure function of scenario, seed and overrides."""

import cProfile
import sys

import pytest

from sim.runs import fly
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.stations import run_command
from tests.growth import looks_within

MOST_CALLS = 175_000
"""Function calls of one second of flight: 154,000 in `paper`, by CPython 3.11 [1/s]."""


@pytest.mark.tried(1)  # links
@pytest.mark.parametrize("link", ["mavlink", "rf_bridge"])
def test_another_process_with_another_hash_seed_gives_the_same_bytes(link: str) -> None:
    """test_library.py flies twice in one process."""
    code = (
        "from sim.scenarios import SCENARIOS, prepare; from sim.runs import fly;w, c = "
        f"prepare(SCENARIOS['adverse'], [], link='{link}'); print(fly(w, c, seed=3, "
        "duration_s=4.0).log_sha256)"
    )
    first, second = (
        run_command([sys.executable, "-c", code], env={"PYTHONHASHSEED": seed})
        for seed in ("1", "2")
    )
    assert len(first.stdout) > 64, first.stderr
    assert first.stdout == second.stdout


def test_a_second_of_flight_makes_no_more_calls_than_it_may() -> None:
    """Their number stands for processor time: it is the same on every machine, however busy."""
    world, config = prepare(SCENARIOS["paper"], [])

    def count_calls(duration_s: float) -> int:
        with cProfile.Profile() as calls:
            fly(world, config, seed=0, duration_s=duration_s)
        return sum(entry.callcount for entry in calls.getstats())

    assert count_calls(4.0) - count_calls(2.0) < 2.0 * MOST_CALLS


def test_a_minute_of_flight_allocates_nothing_that_stays() -> None:
    _, warm, *_, last = looks_within(60.0, 4)  # few: each goes through all that the tests hold
    assert abs(last["objects"] - warm["objects"]) < 50
    assert abs(last["blocks"] - warm["blocks"]) < 1000
