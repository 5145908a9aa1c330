"""When a command is due, when a last chance is taken, and what has waited while the program stood still."""

import asyncio
import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, cast

import pytest

from groundstation.flight import FrameLateness
from groundstation.flight.flight import DRAIN_S, LAST_CHANCE_S, LOOK_S, STALL_S, Pacing, StallDetector
from groundstation.flight.mission_executive import LOST_S, SILENT_S, Hearing
from links.core import CommandLink
from tests.loops import in_virtual_time

PERIOD_S = 0.0225


@dataclass
class Link:
    """As much of a link as pacing asks of it."""

    follows_poses: bool
    period_s: float = PERIOD_S


def left(deadline_s: float, *, follows_poses: bool, until_s: float = 0.5) -> list[float]:
    """When commands leave that all rest on the one pose with that deadline."""

    async def main() -> list[float]:
        loop = asyncio.get_running_loop()
        pacing = Pacing(cast(CommandLink, cast(Any, Link(follows_poses))))
        pacing.begin()
        times: list[float] = []
        while loop.time() < until_s:
            times.append(loop.time())
            assert len(times) < 1000, "time stands still"
            await pacing.next(times[-1], deadline_s)
        return times

    return in_virtual_time(main)()


@pytest.mark.parametrize("follows_poses", [False, True])
@pytest.mark.parametrize("step", range(40))
def test_one_command_leaves_just_before_a_deadline_whatever_its_last_digits(follows_poses: bool, step: int) -> None:
    deadline = 0.2 + step * 1.37e-4 / 3.0
    times = left(deadline, follows_poses=follows_poses)
    assert min(abs(t - (deadline - LAST_CHANCE_S)) for t in times) < 1e-8
    pace = 1.5 * PERIOD_S if follows_poses else PERIOD_S
    assert len(times) <= 0.5 / pace + 3
    assert max(b - a for a, b in zip(times, times[1:], strict=False)) <= 1.5 * PERIOD_S + 1e-8


def test_a_last_chance_that_a_timer_meets_a_tick_early_is_taken() -> None:
    async def main() -> float:
        pacing = Pacing(cast(CommandLink, cast(Any, Link(False))))
        pacing.begin()
        await pacing.next(0.0, LAST_CHANCE_S + 5e-10)  # the chance is half a nanosecond ahead
        return asyncio.get_running_loop().time()

    assert in_virtual_time(main)() == pytest.approx(PERIOD_S, abs=1e-8)


def link(period_s: float, *, follows_poses: bool = False) -> Any:
    return SimpleNamespace(period_s=period_s, follows_poses=follows_poses)


def test_a_frame_is_late_by_what_it_misses_and_one_in_between_is_none() -> None:
    due = FrameLateness(link(0.02))
    seen = [due.late_s(now, 0, 0.0) for now in (1.0, 1.02, 1.043, 1.05, 1.06, 1.101, 1.121)]
    assert seen == pytest.approx([0.0, 0.0, 0.003, None, 0.0, 0.021, 0.0], abs=1e-9)


def test_the_first_command_behind_an_idle_one_is_in_time() -> None:
    due = FrameLateness(link(0.02))
    due.late_s(1.0, 0, 0.0)
    due.begin()
    assert due.late_s(7.0, 0, 0.0) == 0.0


def test_where_commands_follow_poses_each_new_pose_counts_from_its_arrival() -> None:
    due = FrameLateness(link(0.02, follows_poses=True))
    seen = [due.late_s(*at) for at in ((1.003, 5, 1.0), (1.02, 5, 1.0), (1.021, 6, 1.02))]
    assert seen == pytest.approx([0.003, None, 0.001], abs=1e-9)


def test_a_period_that_the_link_learns_by_connecting_counts() -> None:
    radio = link(0.5)
    due = FrameLateness(radio)
    radio.period_s = 0.02
    assert [due.late_s(now, 0, 0.0) for now in (1.0, 1.02, 1.05)] == pytest.approx([0.0, 0.0, 0.01], abs=1e-9)


def heard(interval_s: float, seconds: float = 10.0) -> tuple[Hearing, float]:
    """One that has told so often; and when last [s]."""
    hearing, now_s = Hearing(), 0.0
    while now_s < seconds:
        hearing.hear(now_s)
        now_s += interval_s
    return hearing, now_s - interval_s


def test_who_was_never_heard_is_not_silent() -> None:
    assert Hearing().stalls(100.0) == 0.0


@pytest.mark.parametrize("interval_s", [0.02, 0.05])
def test_one_that_tells_often_is_silent_after_150_ms(interval_s: float) -> None:
    hearing, last_s = heard(interval_s)
    assert hearing.stalls(last_s + SILENT_S - 0.01) == 0.0
    assert hearing.stalls(last_s + SILENT_S + 0.01) == pytest.approx(SILENT_S + 0.01)


@pytest.mark.parametrize("interval_s", [0.17, 0.25, 1.0])
def test_one_that_tells_seldom_is_not_silent_between_two_tellings(interval_s: float) -> None:
    """ArduPilot tells four times a second where nothing else is asked of it: the monitor was off all the time."""
    hearing, last_s = heard(interval_s)
    assert hearing.stalls(last_s + 1.5 * interval_s) == 0.0
    assert hearing.stalls(last_s + min(3.0 * interval_s, LOST_S - 0.01)) > 0.0


def test_one_that_has_told_nothing_for_long_only_tells_no_more() -> None:
    hearing, last_s = heard(0.02)
    assert hearing.stalls(last_s + LOST_S + 0.1) == 0.0
    assert hearing.stalls(math.inf) == 0.0


def looked(*times_s: float) -> StallDetector:
    standstill = StallDetector()
    for time_s in times_s:
        standstill.look(time_s)
    return standstill


def test_before_the_first_look_nothing_has_waited() -> None:
    standstill = StallDetector()
    assert not standstill.may_be_stale(1.0)
    assert not standstill.may_be_stale(5.0)


def test_a_program_that_looks_often_takes_everything() -> None:
    standstill = looked(0.0)
    for step in range(1, 100):
        standstill.look(step * LOOK_S)
        assert not standstill.may_be_stale((step + 0.5) * LOOK_S)


def test_a_little_late_is_not_standing_still() -> None:
    assert not looked(1.0).may_be_stale(1.0 + 0.9 * STALL_S)


def test_what_is_read_right_after_a_standstill_has_waited_and_what_comes_later_has_not() -> None:
    standstill = looked(1.0)
    assert standstill.may_be_stale(1.15)
    assert standstill.may_be_stale(1.15 + 0.1 * DRAIN_S)
    assert standstill.may_be_stale(1.15 + 0.9 * DRAIN_S)
    assert not standstill.may_be_stale(1.15 + 1.1 * DRAIN_S)


def test_a_timer_that_is_served_before_the_socket_does_not_hide_the_standstill() -> None:
    standstill = looked(1.0, 1.15)
    assert standstill.may_be_stale(1.15 + 0.1 * DRAIN_S)
    assert not standstill.may_be_stale(1.15 + 1.1 * DRAIN_S)
