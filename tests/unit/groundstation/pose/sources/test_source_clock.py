"""Stamps of a source on our clock: lateness, wrong rates and units, steps, restarts, drift."""

import math
import random
from collections.abc import Callable, Iterable
from itertools import accumulate
from statistics import fmean
from typing import Any

import pytest

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Verdict
from groundstation.pose.sources import Intake, JsonConfig, JsonReader, VisionConfig, describe_drop
from groundstation.pose.sources.intake import Outbreaks, SourceClock
from groundstation.pose.sources.json_codec import encode, json_pose
from groundstation.pose.stamps import check_stamp_rate

HERE: Vec3 = (1.0, 2.0, 3.0)
LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)


def times(clock: SourceClock, messages: Iterable[tuple[float, float]]) -> list[float]:
    """The time of each (stamp, arrival) that is not stale."""
    return [clock.time_s(*message) for message in messages if not clock.stale(*message)]


def test_frames_that_waited_in_the_kernel_are_as_old_as_their_numbers_say() -> None:
    clock = SourceClock(0.01)
    times(clock, ((n, 50.0 + 0.01 * n) for n in range(100)))
    backlog = [(100 + n, 51.2) for n in range(20)]  # all of 200 ms at once
    got = times(clock, backlog)
    assert got == pytest.approx([51.0 + 0.01 * n for n in range(20)], abs=0.003)


def test_after_a_long_silence_it_begins_anew_and_after_a_hidden_body_it_does_not() -> None:
    for hears in (False, True):
        clock = SourceClock()
        times(clock, ((0.01 * n, 0.01 * n) for n in range(1500)))
        if hears:
            for n in range(1500, 2500):
                clock.mark_alive(0.01 * n)
        got = times(clock, [(0.01 * n, 0.01 * n + 0.3) for n in range(2500, 3000)])  # 10 s later
        assert got[-1] == pytest.approx(29.99 if hears else 30.29, abs=1e-6)
        assert clock.late_s == pytest.approx(0.3 if hears else 0.0, abs=1e-6)


def test_an_exchange_of_clocks_tells_a_slow_clock_from_late_messages() -> None:
    clock = SourceClock()
    ages = []
    for n in range(2000):
        arrival_s = 0.01 * n * 1.1  # a simulated autopilot on a machine that is too slow for it
        ages.append(arrival_s - times(clock, [(0.01 * n, arrival_s)])[0])
        if n % 100 == 0:  # it showed 0.01 n no earlier than 2 ms ago
            clock.apply_exchange(0.01 * n - (arrival_s - 0.002))
    assert max(ages) < 0.12


@pytest.mark.parametrize("told_hz", [25.0, 50.0, 200.0, 1000.0])
def test_a_wrong_rate_is_found_out_within_three_seconds(told_hz: float) -> None:
    clock = SourceClock(1.0 / told_hz)
    true_hz = 100.0
    arrivals = [20.0 + n / true_hz + (0.0, 0.004, 0.001)[n % 3] for n in range(600)]
    got = times(clock, enumerate(arrivals))
    ages = [arrival - time for arrival, time in zip(arrivals, got, strict=True)]
    assert max(ages[300:]) < 0.008
    assert clock.interval_s == pytest.approx(1.0 / true_hz, rel=0.1)
    assert clock.drift == pytest.approx(told_hz / true_hz - 1.0, abs=0.01 * told_hz / true_hz)


@pytest.mark.parametrize("seed", range(8))
def test_jitter_is_no_drift_of_a_clock_whose_rate_is_known(seed: int) -> None:
    clock, chance, drifts = SourceClock(), random.Random(seed), []
    for n in range(2000):
        times(clock, [(0.02 * n, 0.02 * n + 0.01 * chance.random())])
        drifts.append(abs(clock.drift))
    assert max(drifts) < 4e-5, "measured over fewer than 20 blocks it is 6e-5 and more"


def test_a_clock_that_falls_back_is_counted_and_believed_after_a_second() -> None:
    clock = SourceClock()
    times(clock, ((0.01 * n, 0.01 * n) for n in range(500)))
    got = times(clock, ((0.01 * n - 3.0, 0.01 * n) for n in range(500, 1500)))
    assert clock.restarts == 1
    assert len(got) == pytest.approx(899, abs=2)
    assert got[-1] == pytest.approx(14.99, abs=1e-6)


@pytest.mark.parametrize(
    ("frame_s", "numbers"),
    [
        (None, (3850, 0.02639667, 0.3039631, 0.009999984, -0.0005013558, 0, 0.8517843, 1, 1)),
        (0.012, (3950, 0.02560976, 0.3039737, 0.009999871, -0.1666774, 0, 1.02163, 1, 0)),
    ],
)
def test_a_stream_in_all_kinds_of_trouble_has_these_numbers(
    frame_s: float | None, numbers: tuple[float, ...]
) -> None:
    """Jitter, a drift, a gap, a queue, and a clock that falls back; frames of an unknown rate."""
    clock, chance, ages_s, arrival_s = SourceClock(frame_s), random.Random(1), list[float](), 0.0
    for n in [*range(1500), *range(1550, 4000)]:
        left_s = 0.01 * n + (5.0 if n >= 2300 else 0.0)
        queued_s = 0.3 if 2000 <= n < 2200 or n >= 3900 else 0.0
        arrival_s = max(arrival_s, left_s + queued_s + 0.004 * chance.random())
        stamp = 1.0005 * 0.01 * n - (2.0 if n >= 2500 else 0.0)
        told = times(clock, [(stamp if frame_s is None else n, arrival_s)])
        ages_s += [arrival_s - time_s for time_s in told]
        if n == 1000:
            clock.apply_exchange(stamp - left_s + 0.001)
    found = len(ages_s), fmean(ages_s), max(ages_s), clock.interval_s, clock.drift, clock.late_s
    assert (*found, clock.stamp_rate, clock.gaps, clock.restarts) == pytest.approx(numbers, 1e-5)


def test_a_clock_that_begins_anew_is_a_reset_that_no_count_of_the_sources_own_hides() -> None:
    intake = Intake(0.0)
    before = intake.pose(500.0, 10.0, HERE, LEVEL, resets=1)
    *_, after = (
        intake.pose(3.0 + 0.1 * n, 11.0 + 0.1 * n, HERE, LEVEL, resets=0) for n in range(20)
    )
    assert before is not None and after is not None
    assert after.reset_count != before.reset_count


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
            pose = json_pose("quad", (1e-4 * n, 0.0, 0.0), LEVEL, t=stamp(n))
            for got in self.reader.read(encode([pose]), arrival_s):
                self.ages.append((arrival_s - left_s + LATENCY_S, arrival_s - got.time_s))


@pytest.mark.parametrize("unit_s", [1.0, 1e-1, 1e-2, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("rate_hz", [30.0, 120.0])
def test_a_queue_is_told_in_full_whatever_the_unit_of_the_stamps(
    unit_s: float, rate_hz: float
) -> None:
    stream = Stream(lambda n: n / rate_hz / unit_s, rate_hz, round(24.0 * rate_hz))
    late = stream.ages[len(stream.ages) // 2 :]
    assert len(late) > 10.0 * rate_hz
    assert all(told == pytest.approx(true, abs=5e-3) for true, told in late)


@pytest.mark.parametrize("factor", [2.5, 4.0, 60.0, 1e3, 1e6, 1e9, 0.4, 1e-3, 1e-6])
@pytest.mark.parametrize("begun_s", [1e4, 1.8e9])
def test_stamps_that_run_too_fast_or_too_slow_fail_with_the_factor_and_the_unit(
    factor: float, begun_s: float
) -> None:
    intake = Intake(LATENCY_S)
    for n in range(110):
        stamp = factor * begun_s + factor * 0.02 * n
        intake.pose(stamp, 5.0 + 0.02 * n, (1e-4 * n, 0.0, 0.0), LEVEL)
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
def test_clocks_that_drift_and_networks_that_stall_do_not_fail(
    factor: float, stall_s: float
) -> None:
    intake = Intake(LATENCY_S)
    for n in range(110):
        arrival_s = 0.02 * n + max(0.0, stall_s - 0.02 * n)
        intake.pose(factor * 0.02 * n, arrival_s, (1e-4 * n, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    check = check_stamp_rate(intake.status, JsonConfig())
    assert check is None or check.verdict is Verdict.WARN


@pytest.mark.parametrize("factor", [1.19, 1.21, 1.0 / 1.19, 1.0 / 1.21])
def test_a_rate_of_stamps_that_is_off_by_a_fifth_is_warned_of(factor: float) -> None:
    intake = Intake(LATENCY_S)
    for n in range(110):
        intake.pose(factor * 0.02 * n, 0.02 * n, (1e-4 * n, 0.0, 0.0), LEVEL)
    check = check_stamp_rate(intake.status, JsonConfig())
    assert (check is not None) is (max(factor, 1.0 / factor) > 1.2)


STUCK: dict[str, tuple[Callable[[int], float], bool]] = {
    "same": (lambda n: 0.0, True),
    "same at rest": (lambda n: 0.0, False),
    "whole seconds": (lambda n: float(int(0.02 * n)), True),
}


@pytest.mark.parametrize(("stamp", "moves"), STUCK.values(), ids=STUCK)
def test_stamps_that_do_not_change_from_pose_to_pose_are_named(
    stamp: Callable[[int], float], moves: bool
) -> None:
    intake = Intake(LATENCY_S)
    for n in range(200):
        place = (1e-4 * n if moves else 0.0, 0.0, 0.0)
        intake.pose(stamp(n), 0.02 * n, place, (1.0, 0.0, 0.0, 0.0))
    assert intake.dropped["same_stamp"] >= 148
    assert "the sender does not set its time stamp" in str(describe_drop("same_stamp"))


_CHANCE = random.Random(7)
STEPS = list(
    accumulate(_CHANCE.expovariate(0.5) if _CHANCE.random() < 0.04 else 0.0 for _ in range(3000))
)


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
    forgotten = Stream(lambda n: math.fmod(0.02 * n, 1.0), 50.0, 1500)
    assert forgotten.reader.status.unsteady_clock, "the field of the seconds was forgotten"


def test_an_unsteady_clock_is_told_once_as_it_begins_and_once_as_it_is_over() -> None:
    intake, outbreaks = Intake(LATENCY_S), Outbreaks(0.25)
    told: list[Any] = []
    for n in range(3000):
        stamp = stepping(n) if n < 500 else 0.02 * n + 1e3
        intake.pose(stamp, 0.02 * n, (1e-4 * n, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        told += outbreaks.look(0.02 * n, intake.status, None)
    clocks = [event.id for event in told if "clock" in event.id]
    assert clocks == ["pose.unsteady_clock", "pose.steady_clock"]
    assert any(f"3 times within {UNSTEADY_S:g} s" in event.text for event in told)
