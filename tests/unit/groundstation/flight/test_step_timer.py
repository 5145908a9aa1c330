"""The timer of the user's steps: slow ones are named, those that hang are interrupted, others' alarms count."""

import asyncio
import contextvars
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import pytest

from groundstation.config import STEP_WATCH, UserCodeFault
from groundstation.core.trajectory import OwnTrajectoryConfig, Reference
from groundstation.flight import StepTimeout, StepTimer
from groundstation.flight.step_timer import LIMIT_S, SLOW_S

ALARMS: list[str] = []


@pytest.fixture(autouse=True)
def alarms() -> Iterator[None]:
    ALARMS.clear()
    before = signal.getsignal(signal.SIGALRM)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


def watched(work: Callable[[StepTimer, Callable[[], float]], Any]) -> Any:
    """``work`` where a timer watches, in a context of its own."""
    loop = asyncio.new_event_loop()

    def do() -> Any:
        timer = StepTimer(loop.time, lambda: ALARMS.append("told"))
        timer.start()
        assert STEP_WATCH.get() is timer
        return work(timer, loop.time)

    try:
        return contextvars.copy_context().run(do)
    finally:
        loop.close()


def spend(now_s: Callable[[], float], lasts_s: float) -> None:
    begun_s = now_s()
    while now_s() - begun_s < lasts_s:
        pass


def test_a_step_that_hangs_is_interrupted_and_the_timer_is_off_afterwards() -> None:
    def work(timer: StepTimer, now_s: Callable[[], float]) -> float:
        begun_s = now_s()
        timer.begin("controller mine:Hang")
        with pytest.raises(StepTimeout, match="did not return within 500 ms"):
            spend(now_s, 30.0)
        timer.end()
        took_s = now_s() - begun_s
        spend(now_s, 0.2)
        return took_s

    assert LIMIT_S - 0.06 < watched(work) < 10.0
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0
    assert ALARMS == []


def test_code_that_swallows_exceptions_is_interrupted_all_the_same() -> None:
    def work(timer: StepTimer, now_s: Callable[[], float]) -> None:
        timer.begin("controller mine:Deaf")
        try:
            while True:
                with suppress(Exception):
                    spend(now_s, 30.0)
        finally:
            timer.end()

    with pytest.raises(StepTimeout):
        watched(work)


def test_a_slow_step_is_named_with_its_time_and_again_only_where_it_is_much_slower() -> None:
    def work(timer: StepTimer, now_s: Callable[[], float]) -> list[str]:
        told = []
        for lasts_s in (0.01, SLOW_S + 0.02, SLOW_S + 0.03, 0.0, 2.5 * SLOW_S):
            timer.begin("controller mine:Slow")
            spend(now_s, lasts_s)
            timer.end()
            told.append(timer.slow)
        assert "took 2" in timer.find_recent()
        spend(now_s, 1.1)
        assert timer.find_recent() == ""
        return told

    told = watched(work)
    assert told[0] == ""
    assert told[1].startswith("controller mine:Slow took 1")
    assert "ms, limit 100 ms" in told[1]
    assert told[1] == told[2] == told[3] != told[4]


def test_somebody_else_s_alarm_is_handed_on() -> None:
    def work(timer: StepTimer, now_s: Callable[[], float]) -> None:
        os.kill(os.getpid(), signal.SIGALRM)
        spend(now_s, 0.05)
        timer.begin("controller mine:Own")
        os.kill(os.getpid(), signal.SIGALRM)  # in a step that is not late it is no timeout
        spend(now_s, 0.05)
        timer.end()

    watched(work)
    assert ALARMS == ["told"]


def hanging(time_s: float) -> Reference:
    while time_s > 0.0:
        pass
    return Reference((0.0, 0.0, -1.0))


def test_the_step_of_a_trajectory_is_watched_too() -> None:
    def work(timer: StepTimer, now_s: Callable[[], float]) -> None:
        trajectory = OwnTrajectoryConfig(factory=f"{__name__}:hanging").build()
        assert trajectory.at(0.0).position_ned == (0.0, 0.0, -1.0)
        trajectory.at(1.0)

    with pytest.raises(UserCodeFault, match="hanging failed: StepTimeout: it did not return within 500 ms"):
        watched(work)


def test_nothing_is_timed_where_nobody_has_started_a_timer() -> None:
    assert STEP_WATCH.get().slow == STEP_WATCH.get().find_recent() == ""
    trajectory = OwnTrajectoryConfig(factory=f"{__name__}:hanging").build()
    trajectory.at(0.0)
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0
