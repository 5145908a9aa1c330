"""The source's stamps on our clock: backlogs, wrong rates, steps, restarts, gaps, drift."""

from collections.abc import Iterable

import pytest

from groundstation.ops import Quat, Vec3
from groundstation.poses.intake import FrameCount, Intake
from groundstation.poses.source_clock import SourceClock

HERE: Vec3 = (1.0, 2.0, 3.0)
LEVEL: Quat = (1.0, 0.0, 0.0, 0.0)


def times(clock: SourceClock, messages: Iterable[tuple[float, float]]) -> list[float]:
    """The time of each (stamp, arrival) that is not stale."""
    return [clock.time_s(stamp, arrival) for stamp, arrival in messages if not clock.stale(stamp, arrival)]


def test_frames_that_waited_in_the_kernel_are_as_old_as_their_numbers_say() -> None:
    clock = SourceClock(0.01)
    times(clock, ((n, 50.0 + 0.01 * n) for n in range(100)))
    backlog = [(100 + n, 51.2) for n in range(20)]  # all of 200 ms at once
    got = times(clock, backlog)
    assert got == pytest.approx([51.0 + 0.01 * n for n in range(20)], abs=0.003)


def test_a_queue_that_stays_for_a_second_does_not_make_old_poses_look_young() -> None:
    clock = SourceClock(0.01)
    messages = [(n, 0.01 * n + (0.2 if 500 <= n < 600 else 0.0)) for n in range(800)]
    got = times(clock, messages)
    assert max(time - 0.01 * n for n, time in enumerate(got)) < 0.07
    assert got[610:] == pytest.approx([0.01 * n for n in range(610, 800)], abs=1e-3)


def test_a_queue_that_grows_slowly_is_not_taken_for_a_slow_clock_at_once() -> None:
    clock = SourceClock(0.01)
    times(clock, ((n, 0.01 * n) for n in range(1000)))
    got = times(clock, ((n, 0.01 * n + 0.05 * 0.01 * (n - 1000)) for n in range(1000, 1300)))  # 50 ms a second
    true_delay_s = 0.05 * 3.0
    assert 0.01 * 1299 + true_delay_s - got[-1] > 0.5 * true_delay_s


@pytest.mark.parametrize("told_hz", [25.0, 50.0, 200.0, 1000.0])
def test_a_wrong_rate_is_found_out_within_three_seconds(told_hz: float) -> None:
    clock = SourceClock(1.0 / told_hz)
    true_hz = 100.0
    arrivals = [20.0 + n / true_hz + (0.0, 0.004, 0.001)[n % 3] for n in range(600)]
    ages = [arrival - time for arrival, time in zip(arrivals, times(clock, enumerate(arrivals)), strict=True)]
    assert max(ages[300:]) < 0.008
    assert clock.interval_s == pytest.approx(1.0 / true_hz, rel=0.1)
    assert clock.drift == pytest.approx(told_hz / true_hz - 1.0, abs=0.01 * told_hz / true_hz)


def test_frames_that_are_skipped_by_the_sender_are_no_wrong_rate() -> None:
    # Tracker sends every second frame of its cameras: numbers 0, 2, 4, … of 100 Hz.
    clock = SourceClock(0.01)
    messages = [(2 * n, 0.02 * n) for n in range(300)]
    assert times(clock, messages) == pytest.approx([arrival for _, arrival in messages], abs=1e-9)
    assert clock.drift == pytest.approx(0.0, abs=1e-9)
    assert clock.gaps == 0


@pytest.mark.parametrize("drift", [2e-4, -2e-4, 5e-3])
def test_drift_is_measured(drift: float) -> None:
    clock = SourceClock()
    times(clock, ((0.01 * n, 7.0 + 0.01 * n * (1.0 + drift)) for n in range(1500)))
    assert clock.drift == pytest.approx(drift, abs=1e-6)


def test_a_clock_that_leaps_ahead_is_counted_and_poses_stay_young() -> None:
    clock = SourceClock()
    before = [(0.01 * n, 0.01 * n) for n in range(500)]
    after = [(0.01 * n + 3600.0, 0.01 * n) for n in range(500, 1500)]
    got = times(clock, before + after)
    assert clock.steps == 1
    assert got == pytest.approx([0.01 * n for n in range(1500)], abs=1e-6)


def test_a_clock_that_falls_back_is_counted_and_believed_after_a_second() -> None:
    clock = SourceClock()
    times(clock, ((0.01 * n, 0.01 * n) for n in range(500)))
    got = times(clock, ((0.01 * n - 3.0, 0.01 * n) for n in range(500, 1500)))
    assert clock.restarts == 1
    assert len(got) == pytest.approx(899, abs=2)
    assert got[-1] == pytest.approx(14.99, abs=1e-6)


def test_missing_messages_are_counted_as_gaps() -> None:
    clock = SourceClock()
    lost = {200, 201, 300, 301, 302, 400}  # a single one is no gap
    times(clock, ((0.01 * n, 0.01 * n) for n in range(500) if n not in lost))
    assert clock.gaps == 2


def test_a_counter_of_32_bits_never_runs_over() -> None:
    frames = FrameCount(32)
    assert [frames.whole(n) for n in (2**32 - 2, 2**32 - 1, 0, 1, 2**32 - 1)] == [
        2**32 - 2, 2**32 - 1, 2**32, 2**32 + 1, 2**32 - 1,
    ]  # fmt: skip


def test_the_latency_is_that_of_the_longest_wait_too() -> None:
    intake = Intake(0.02)
    for n in range(100):
        intake.pose(0.01 * n, 0.01 * n + (0.05 if n == 50 else 0.0), HERE, LEVEL)
    status = intake.status
    assert status.latency_s == pytest.approx(0.02, abs=0.002)
    assert status.latency_max_s == pytest.approx(0.07, abs=1e-3)
    assert status.rate_hz == pytest.approx(100.0, rel=0.01)


@pytest.mark.parametrize(
    ("position", "attitude", "stamp", "reason"),
    [
        ((float("nan"), 0.0, 0.0), LEVEL, 1.0, "not_finite"),
        (HERE, (float("inf"), 0.0, 0.0, 0.0), 1.0, "not_finite"),
        (HERE, LEVEL, float("nan"), "not_finite"),
        (HERE, (0.0, 0.0, 0.0, 0.0), 1.0, "not_unit"),
        ((2e6, 0.0, 0.0), LEVEL, 1.0, "absurd"),
        (HERE, LEVEL, 1e300, "absurd"),
        (HERE, LEVEL, -1e300, "absurd"),
    ],
)
def test_what_is_no_pose_is_counted_by_reason(position: Vec3, attitude: Quat, stamp: float, reason: str) -> None:
    intake = Intake(0.0)
    assert intake.pose(stamp, 1.0, position, attitude) is None
    assert (intake.accepted, intake.dropped) == (0, {reason: 1})
