"""Long runs, for `make soak`: whatever the quick tests do once, very often."""

import random
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from groundstation import load
from links.mavlink.protocol import MavlinkCodec
from sim.runs import fly_mission, from_floor
from sim.scenarios import SCENARIOS, prepare
from tests.e2e.test_vehicles import rehearsal, until
from tests.flight.flights import campaign_of, flown
from tests.growth import look, looks_within
from tests.known import known
from tests.mavlink_table import FRAMES
from tests.proving.bench.links import measure_all
from tests.proving.fuzz import LINKS, SOURCES, try_damaged

pytestmark = pytest.mark.soak
DATAGRAMS = 1_000_000


def mutated(data: bytes, draw: random.Random) -> bytes:
    """``data`` with a few bytes changed, cut or added."""
    changed = bytearray(data)
    for _ in range(draw.randrange(1, 6)):
        changed[draw.randrange(len(changed))] = draw.randrange(256)
    if draw.random() < 0.3:
        del changed[draw.randrange(len(changed) + 1) :]
    if draw.random() < 0.1:
        changed += draw.randbytes(draw.randrange(600))
    return bytes(changed)


@pytest.mark.parametrize("name", SOURCES | LINKS)
def test_a_million_broken_datagrams_raise_nothing(name: str) -> None:
    try_damaged((SOURCES | LINKS)[name], DATAGRAMS, seed=1)


def test_a_million_broken_datagrams_leave_nothing_in_the_mavlink_stream() -> None:
    draw = random.Random(2)
    originals = [golden.frame for golden in FRAMES]
    codec = MavlinkCodec(245, 190)
    tracemalloc.start()
    codec.feed(b"".join(originals))
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(DATAGRAMS):
        broken = mutated(draw.choice(originals), draw)
        codec.feed(broken)
        codec.feed(broken)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 1 << 20


def test_an_hour_of_flight_ends_as_well_as_a_minute() -> None:
    minute, hour = flown("paper").verdict, flown("paper", duration_s=3600.0).verdict
    assert known(hour.rms_cm) < 1.2 * known(minute.rms_cm)


def test_an_hour_of_flight_allocates_nothing_that_stays() -> None:
    looks = looks_within(3600.0, 20)
    warm, last = looks[5], looks[-1]  # deques and caches fill in the first quarter
    assert abs(last["objects"] - warm["objects"]) < 50
    assert abs(last["blocks"] - warm["blocks"]) < 1000
    assert last["resident_bytes"] - warm["resident_bytes"] < 1 << 20


def test_none_of_a_thousand_adverse_flights_crashes_or_errs_more_than_1_9_cm() -> None:
    facts = campaign_of(1000, duration_s=60.0, workers=2)
    assert facts["survived"] == 1.0
    assert facts["rms_cm"]["p50"] <= 1.05
    assert facts["rms_cm"]["p99"] <= 1.4
    assert facts["rms_cm"]["max"] <= 1.9


def test_missions_one_after_the_other_leave_nothing_behind() -> None:
    """Each in one process, from the floor and back; what the first leave are modules and caches."""
    world, config = from_floor(*prepare(SCENARIOS["adverse"], []), 20.0)
    looks = []
    for seed in range(12):
        assert fly_mission(world, config, seed=seed).landed
        looks.append(look())
    assert looks[-1]["objects"] - looks[3]["objects"] < 200
    assert looks[-1]["resident_bytes"] < 1.05 * looks[3]["resident_bytes"]


@pytest.mark.parametrize("scenario", ["paper", "fast", "adverse", "storm", "quad1kg"])
def test_a_hundred_seeds_of_every_scenario_complete(scenario: str) -> None:
    for seed in range(100, 200):
        result = flown(scenario, seed=seed)
        assert result.completed, (seed, result.why)


def test_frames_and_commands_keep_time_beside_the_least_that_this_machine_allows() -> None:
    facts = measure_all(60.0)["links"]
    assert list(facts["pose_to_command"]) == list(facts["echo"]) == ["50", "100", "250"]
    if facts["fifo"]:
        assert facts["ratios"]["p99"] < 2.0
        assert facts["pacer"]["lost"] <= facts["floor"]["lost"]
    for rate, figures in facts["pose_to_command"].items():
        assert figures["p50_us"] < 1000.0
        assert facts["latency_ratios"][rate]["p99"] < 3.0


def test_ten_vehicles_fly_in_real_time_and_each_command_leaves_in_time(short_path: Path) -> None:
    """On two cores that have nothing else to do, with poses at 50 Hz."""
    names = [f"quad{number}" for number in range(10)]
    with rehearsal(short_path, "--arm", "rehearsal", names=names) as (station, log):
        for name in names:
            until(log, rf"{name} +\| .* tracking: ")
        time.sleep(20.0)
        station.terminate()
        assert station.wait(60) == 0, log.read_text("utf-8")
    for name in names:
        (path,) = short_path.rglob(f"*-rehearsal-{name}.mcap")
        late_s = load(path).columns.scalars["lateness_s"]
        assert len(late_s) > 1000
        assert float(np.quantile(late_s, 0.99)) < 0.005
