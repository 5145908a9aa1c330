"""Time stamps in the wrong unit, stamps that stand still, and clocks that step again and again."""

import math
import random
from collections.abc import Callable
from itertools import accumulate
from typing import Any

import pytest

from groundstation.core.messages import Verdict
from groundstation.pose.sources import Intake, JsonConfig, JsonReader, VisionConfig, describe_drop
from groundstation.pose.sources.intake import Outbreaks
from groundstation.pose.sources.json_codec import encode, json_pose
from groundstation.pose.stamps import check_stamp_rate

# By their numbers: a limit that the test took from the code would bear out any value.
UNSTEADY_S = 30.0

LATENCY_S = 0.02
QUEUE_S = 0.3
"""From the middle of each stream on, a queue holds every message for so long [s]."""


class Stream:
    """A tracker whose messages wait in a queue from the middle of the stream on."""

    def __init__(self, stamp: Callable[[int], float], rate_hz: float, messages: int) -> None:
        frames = Intake(LATENCY_S, frame_s=0.02)
        self.reader = JsonReader("quad", Intake(LATENCY_S, frame_s=1.0), frames)
        self.ages: list[tuple[float, float]] = []
        for n in range(messages):
            left_s = n / rate_hz
            arrival_s = left_s + (QUEUE_S if n >= messages // 2 else 0.0)
            place = (1e-4 * n, 0.0, 0.0)
            pose = json_pose("quad", place, (1.0, 0.0, 0.0, 0.0), t=stamp(n))
            for got in self.reader.read(encode([pose]), arrival_s):
                self.ages.append((arrival_s - left_s + LATENCY_S, arrival_s - got.time_s))


@pytest.mark.parametrize("unit_s", [1.0, 1e-1, 1e-2, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("rate_hz", [30.0, 120.0])
def test_a_queue_is_told_in_full_whatever_the_unit_of_the_stamps(unit_s: float, rate_hz: float) -> None:
    stream = Stream(lambda n: n / rate_hz / unit_s, rate_hz, round(24.0 * rate_hz))
    late = stream.ages[len(stream.ages) // 2 :]
    assert len(late) > 10.0 * rate_hz
    assert all(told == pytest.approx(true, abs=5e-3) for true, told in late)


@pytest.mark.parametrize("factor", [2.5, 4.0, 60.0, 1e3, 1e6, 1e9, 0.4, 1e-3, 1e-6])
@pytest.mark.parametrize("begun_s", [1e4, 1.8e9])
def test_stamps_that_run_too_fast_or_too_slow_fail_with_the_factor_and_the_unit(factor: float, begun_s: float) -> None:
    intake = Intake(LATENCY_S)
    for n in range(110):
        intake.pose(factor * begun_s + factor * 0.02 * n, 5.0 + 0.02 * n, (1e-4 * n, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    check = check_stamp_rate(intake.status, JsonConfig())
    assert check is not None and check.verdict is Verdict.FAIL
    shown = max(factor, 1.0 / factor)
    assert f"{shown:.3g} times" in check.says or f"{shown:.0f} times" in check.says
    assert f"too {'fast' if factor > 1.0 else 'slow'}" in check.says
    assert "t is expected in seconds" in check.says
    assert ("looks like milliseconds" in check.says) == (factor == 1e3)
    by_vision = check_stamp_rate(intake.status, VisionConfig())
    assert by_vision is not None
    assert "usec is expected in microseconds" in by_vision.says
    assert ("looks like milliseconds" in by_vision.says) == (factor == 1e-3)


@pytest.mark.parametrize("factor", [0.9985, 1.0, 1.0015, 1.15])
@pytest.mark.parametrize("stall_s", [0.0, 0.25])
def test_clocks_that_drift_and_networks_that_stall_do_not_fail(factor: float, stall_s: float) -> None:
    intake = Intake(LATENCY_S)
    for n in range(110):
        arrival_s = 0.02 * n + max(0.0, stall_s - 0.02 * n)
        intake.pose(factor * 0.02 * n, arrival_s, (1e-4 * n, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    check = check_stamp_rate(intake.status, JsonConfig())
    assert check is None or check.verdict is Verdict.WARN


def same(n: int) -> float:
    return 0.0


def coarse(n: int) -> float:
    return float(int(0.02 * n))


@pytest.mark.parametrize(("stamp", "moves"), [(same, True), (same, False), (coarse, True)])
def test_stamps_that_do_not_change_from_pose_to_pose_are_named(stamp: Callable[[int], float], moves: bool) -> None:
    intake = Intake(LATENCY_S)
    for n in range(200):
        place = (1e-4 * n if moves else 0.0, 0.0, 0.0)
        intake.pose(stamp(n), 0.02 * n, place, (1.0, 0.0, 0.0, 0.0))
    assert intake.dropped["same_stamp"] >= 148
    assert "the sender does not set its time stamp" in str(describe_drop("same_stamp"))


_CHANCE = random.Random(7)
STEPS = list(accumulate(_CHANCE.expovariate(0.5) if _CHANCE.random() < 0.04 else 0.0 for _ in range(3000)))


def stepping(n: int) -> float:
    """Steps ahead by some seconds, now and then."""
    return 0.02 * n + STEPS[n]


def test_a_clock_that_steps_again_and_again_makes_no_late_pose_young() -> None:
    stream = Stream(stepping, 50.0, 1500)
    assert stream.reader.status.unsteady_clock
    late = stream.ages[len(stream.ages) // 2 :]
    assert min(told for _, told in late) > 0.9 * (QUEUE_S + LATENCY_S)


def test_one_step_is_forgiven() -> None:
    stream = Stream(lambda n: 0.02 * n + (3600.0 if n > 100 else 0.0), 50.0, 1500)
    assert not stream.reader.status.unsteady_clock
    assert stream.reader.status.clock_steps == 1
    assert all(told == pytest.approx(true, abs=5e-3) for true, told in stream.ages)


def fraction(n: int) -> float:
    """Only the fraction of each second, as where the field of the seconds was forgotten."""
    return math.fmod(0.02 * n, 1.0)


def test_a_clock_that_begins_anew_each_second_is_unsteady() -> None:
    assert Stream(fraction, 50.0, 1500).reader.status.unsteady_clock


def test_an_unsteady_clock_is_told_once_as_it_begins_and_once_as_it_is_over() -> None:
    intake, outbreaks = Intake(LATENCY_S), Outbreaks(0.25)
    told: list[Any] = []
    for n in range(3000):
        stamp = stepping(n) if n < 500 else 0.02 * n + 1e3
        intake.pose(stamp, 0.02 * n, (1e-4 * n, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        told += outbreaks.look(0.02 * n, intake.status, None)
    assert [event.id for event in told if "clock" in event.id] == ["pose.unsteady_clock", "pose.steady_clock"]
    assert any(f"3 times within {UNSTEADY_S:g} s" in event.text for event in told)
