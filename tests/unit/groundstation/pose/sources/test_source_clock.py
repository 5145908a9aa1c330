"""The source's stamps on our clock: backlogs, lateness that stays, wrong rates, steps, restarts, gaps, drift."""

from collections.abc import Iterable

import pytest

from groundstation.core.geometry import Quat, Vec3
from groundstation.pose.sources import Intake
from groundstation.pose.sources.intake import SourceClock

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
        if n % 100 == 0:
            clock.apply_exchange(0.01 * n - (arrival_s - 0.002))  # it showed 0.01 n no earlier than 2 ms ago
    assert max(ages) < 0.12


@pytest.mark.parametrize("told_hz", [25.0, 50.0, 200.0, 1000.0])
def test_a_wrong_rate_is_found_out_within_three_seconds(told_hz: float) -> None:
    clock = SourceClock(1.0 / told_hz)
    true_hz = 100.0
    arrivals = [20.0 + n / true_hz + (0.0, 0.004, 0.001)[n % 3] for n in range(600)]
    ages = [arrival - time for arrival, time in zip(arrivals, times(clock, enumerate(arrivals)), strict=True)]
    assert max(ages[300:]) < 0.008
    assert clock.interval_s == pytest.approx(1.0 / true_hz, rel=0.1)
    assert clock.drift == pytest.approx(told_hz / true_hz - 1.0, abs=0.01 * told_hz / true_hz)


def test_a_clock_that_falls_back_is_counted_and_believed_after_a_second() -> None:
    clock = SourceClock()
    times(clock, ((0.01 * n, 0.01 * n) for n in range(500)))
    got = times(clock, ((0.01 * n - 3.0, 0.01 * n) for n in range(500, 1500)))
    assert clock.restarts == 1
    assert len(got) == pytest.approx(899, abs=2)
    assert got[-1] == pytest.approx(14.99, abs=1e-6)


def test_a_clock_that_begins_anew_is_a_reset_that_no_count_of_the_sources_own_hides() -> None:
    intake = Intake(0.0)
    before = intake.pose(500.0, 10.0, HERE, LEVEL, resets=1)
    after = [intake.pose(3.0 + 0.1 * n, 11.0 + 0.1 * n, HERE, LEVEL, resets=0) for n in range(20)][-1]
    assert before is not None and after is not None
    assert after.reset_count != before.reset_count
