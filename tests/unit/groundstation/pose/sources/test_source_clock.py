"""The source's stamps on our clock: backlogs, lateness that stays, wrong rates, steps, restarts, gaps, drift."""

from collections.abc import Iterable

import pytest

from groundstation.core.geometry import Quat, Vec3
from groundstation.core.messages import Others
from groundstation.pose.sources import Intake
from groundstation.pose.sources.intake import FrameCount, SourceClock

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
    assert times(clock, messages) == pytest.approx([0.01 * n for n in range(800)], abs=1e-9)


@pytest.mark.tried(2)  # lengths of the queue
@pytest.mark.parametrize("late_s", [0.1, 0.2, 0.4])
@pytest.mark.parametrize("frame_s", [None, 0.01])
def test_a_queue_that_stays_for_good_is_never_forgotten(frame_s: float | None, late_s: float) -> None:
    clock = SourceClock(frame_s)
    stamps = [n if frame_s else 0.01 * n for n in range(60_000)]  # ten minutes
    got = times(clock, ((s, 0.01 * n + (late_s if n >= 2000 else 0.0)) for n, s in enumerate(stamps)))
    assert got == pytest.approx([0.01 * n for n in range(60_000)], abs=1e-6)
    assert clock.late_s == pytest.approx(late_s, abs=1e-6)


@pytest.mark.parametrize("frame_s", [None, 0.01])
def test_a_queue_that_fills_is_not_taken_for_a_slow_clock(frame_s: float | None) -> None:
    clock = SourceClock(frame_s)
    stamps = [n if frame_s else 0.01 * n for n in range(5000)]
    got = times(clock, ((s, 0.01 * n + 0.05 * 0.01 * max(0, n - 3000)) for n, s in enumerate(stamps)))  # 50 ms a second
    assert max(got[n] - 0.01 * n for n in range(5000)) < 0.01
    assert clock.late_s == pytest.approx(1.0, abs=0.08), "as of two blocks ago"


def test_what_is_late_for_a_moment_only_is_not_told_as_lateness() -> None:
    clock = SourceClock()
    for n in range(3000):
        held_up_s = max(0.0, 0.4 - 0.01 * (n % 500))  # each five seconds all stands still for 0.4 s
        times(clock, [(0.01 * n, 0.01 * n + held_up_s)])
        assert clock.late_s == 0.0


@pytest.mark.parametrize("leap_s", [1.0, 3600.0])
def test_the_clock_of_a_late_source_may_leap_ahead_and_the_source_is_as_late_as_before(leap_s: float) -> None:
    clock = SourceClock()
    before = [(0.01 * n, 0.01 * n + (0.1 if n >= 1000 else 0.0)) for n in range(2000)]
    after = [(0.01 * n + leap_s, 0.01 * n + 0.1) for n in range(2000, 3000)]
    got = times(clock, before + after)
    assert clock.steps == 1
    assert got == pytest.approx([0.01 * n for n in range(3000)], abs=1e-6)


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


def test_a_frame_counter_that_pauses_looks_late_until_it_is_stopped_for_longer() -> None:
    clock = SourceClock(0.01)
    paused = [(n, 0.01 * n + (1.0 if n >= 1500 else 0.0)) for n in range(3000)]
    assert times(clock, paused)[-1] == pytest.approx(paused[-1][1] - 1.0, abs=1e-6)
    stopped = [(n, 0.01 * n + 6.0) for n in range(3000, 3500)]
    assert times(clock, stopped)[-1] == pytest.approx(stopped[-1][1], abs=1e-6)


@pytest.mark.parametrize(("before_hz", "after_hz"), [(100.0, 200.0), (200.0, 100.0), (100.0, 98.0), (100.0, 102.0)])
def test_a_rate_that_the_operator_changes_on_the_ground_is_found_by_itself(before_hz: float, after_hz: float) -> None:
    clock = SourceClock(1.0 / before_hz)
    arrivals = [n / before_hz for n in range(round(20 * before_hz))]
    arrivals += [20.0 + n / after_hz for n in range(round(260 * after_hz))]
    got = times(clock, enumerate(arrivals))
    assert got[-1] == pytest.approx(arrivals[-1], abs=1e-3)
    later = [arrival + 0.1 for arrival in (280.0 + n / after_hz for n in range(round(60 * after_hz)))]
    late = times(clock, enumerate(later, len(arrivals)))
    assert late[-1] == pytest.approx(later[-1] - 0.1, abs=1e-3), "and from then on it is late what is late"


def test_an_exchange_of_clocks_tells_a_slow_clock_from_late_messages() -> None:
    clock = SourceClock()
    ages = []
    for n in range(2000):
        arrival_s = 0.01 * n * 1.1  # a simulated autopilot on a machine that is too slow for it
        ages.append(arrival_s - times(clock, [(0.01 * n, arrival_s)])[0])
        if n % 100 == 0:
            clock.apply_exchange(0.01 * n - (arrival_s - 0.002))  # it showed 0.01 n no earlier than 2 ms ago
    assert max(ages) < 0.12


def test_an_exchange_with_another_clock_than_the_one_that_stamps_changes_nothing() -> None:
    clock = SourceClock()
    times(clock, ((0.01 * n, 0.01 * n + (0.1 if n >= 1000 else 0.0)) for n in range(2000)))
    for ahead_s in (1.7e9, -1.7e9):
        clock.apply_exchange(ahead_s)
    assert times(clock, [(20.0, 20.1)]) == pytest.approx([20.0], abs=1e-6)


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


@pytest.mark.parametrize("drift", [2e-4, -2e-4, 1e-3])
def test_drift_is_measured(drift: float) -> None:
    clock = SourceClock()
    times(clock, ((0.01 * n, 7.0 + 0.01 * n * (1.0 + drift)) for n in range(1500)))
    assert clock.drift == pytest.approx(drift, abs=1e-6)


@pytest.mark.parametrize("leap_s", [1.0, 3600.0])
def test_a_clock_that_leaps_ahead_is_counted_and_poses_stay_young(leap_s: float) -> None:
    clock = SourceClock()
    before = [(0.01 * n, 0.01 * n) for n in range(500)]
    after = [(0.01 * n + leap_s, 0.01 * n) for n in range(500, 1500)]
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


def test_other_bodies_in_a_stream_that_is_late_are_as_old_as_our_own() -> None:
    others = Others(["wand"])
    intake = Intake(0.02, others=others)
    for n in range(2000):
        arrival_s = 0.01 * n + (0.1 if n >= 1000 else 0.0)
        intake.other("wand", arrival_s, HERE)
        intake.pose(0.01 * n, arrival_s, HERE, LEVEL)
    sight = others.sighting("wand")
    assert sight is not None
    assert sight.time_s == pytest.approx(19.99 - 0.02, abs=1e-6)


@pytest.mark.parametrize(
    ("position", "attitude", "stamp", "reason"),
    [
        ((float("nan"), 0.0, 0.0), LEVEL, 1.0, "not_finite"),
        (HERE, (float("inf"), 0.0, 0.0, 0.0), 1.0, "not_finite"),
        (HERE, LEVEL, float("nan"), "not_finite"),
        (HERE, (0.0, 0.0, 0.0, 0.0), 1.0, "not_unit"),
        ((2e6, 0.0, 0.0), LEVEL, 1.0, "absurd"),
        (HERE, LEVEL, 1e300, "absurd_stamp"),
        (HERE, LEVEL, -1e300, "absurd_stamp"),
    ],
)
def test_what_is_no_pose_is_counted_by_reason(position: Vec3, attitude: Quat, stamp: float, reason: str) -> None:
    intake = Intake(0.0)
    assert intake.pose(stamp, 1.0, position, attitude) is None
    assert (intake.accepted, intake.dropped) == (0, {reason: 1})


def test_a_clock_that_begins_anew_is_a_reset_that_no_count_of_the_sources_own_hides() -> None:
    intake = Intake(0.0)
    before = intake.pose(500.0, 10.0, HERE, LEVEL, resets=1)
    after = [intake.pose(3.0 + 0.1 * n, 11.0 + 0.1 * n, HERE, LEVEL, resets=0) for n in range(20)][-1]
    assert before is not None and after is not None
    assert after.reset_count != before.reset_count
