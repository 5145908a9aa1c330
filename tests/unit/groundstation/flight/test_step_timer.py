"""The timer of the user's steps names slow ones, interrupts hung ones and keeps others' alarms."""

import asyncio
import contextlib
import contextvars
import math
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from groundstation.config import STEP_LIMIT_S, STEP_WATCH, ConfigError, UserCodeFault, find_object
from groundstation.config.user_code import SelfInterrupt
from groundstation.core.control import Custom, make_controller
from groundstation.core.messages import Sentence
from groundstation.core.trajectory import OwnTrajectoryConfig, Reference
from groundstation.core.vehicle import Vehicle
from groundstation.flight import StepTimeout, StepTimer
from groundstation.flight.step_timer import SLOW_S

ALARMS: list[str] = []


@pytest.fixture(autouse=True)
def alarms() -> Iterator[None]:
    ALARMS.clear()
    numbers = (signal.SIGALRM, signal.SIGUSR2, signal.SIGINT)
    before = {number: signal.getsignal(number) for number in numbers}
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    for number, handler in before.items():
        signal.signal(number, handler)


Clock = Callable[[], float]


def watched(work: Callable[[StepTimer, Clock], Any], kind: type[StepTimer] = StepTimer) -> Any:
    """``work`` where a timer of that ``kind`` watches, in a context of its own."""
    loop = asyncio.new_event_loop()

    def do() -> Any:
        timer = kind.start()
        timer.on_alarm = lambda: ALARMS.append("told")
        assert STEP_WATCH.get() is timer
        return work(timer, loop.time)

    try:
        return contextvars.copy_context().run(do)
    finally:
        loop.close()


@contextlib.contextmanager
def step_of(timer: StepTimer, now_s: Clock, what: str = "controller mine:Own") -> Iterator[None]:
    """A step of the user's; one that hangs must not take ten seconds."""
    begun_s = now_s()
    timer.begin(what)
    try:
        yield
    finally:
        timer.end()
        assert now_s() - begun_s < 10.0


def spend(now_s: Clock, lasts_s: float) -> None:
    begun_s = now_s()
    while now_s() - begun_s < lasts_s:
        pass


def test_a_step_that_hangs_is_interrupted_and_the_timer_is_off_afterwards() -> None:
    def work(timer: StepTimer, now_s: Clock) -> float:
        begun_s = now_s()
        with (
            step_of(timer, now_s),
            pytest.raises(StepTimeout, match="did not return within 500 ms"),
        ):
            spend(now_s, 30.0)
        took_s = now_s() - begun_s
        spend(now_s, 0.2)
        return took_s

    assert STEP_LIMIT_S - 0.06 < watched(work) < 10.0
    assert signal.getitimer(signal.ITIMER_REAL)[0] == 0.0
    assert ALARMS == []


def test_steps_of_another_thread_run_without_a_watch_as_signals_are_for_the_main_thread() -> None:
    def work(timer: StepTimer, _: Clock) -> float:
        async def run() -> float:
            to_thread = asyncio.to_thread  # noqa: TID251  # what is tried is a step in another thread
            root: float = await to_thread(timer.run, "controller mine:Fine", 0.5, math.sqrt, 4.0)
            return root

        return asyncio.run(run())

    assert watched(work) == 2.0


@pytest.mark.parametrize("nested", [False, True])
def test_code_that_swallows_everything_is_interrupted_at_its_next_line(nested: bool) -> None:
    def swallow(now_s: Clock) -> None:
        while True:
            try:
                spend(now_s, 30.0)
            except:  # noqa: E722  # as a user may write it
                now_s()

    def outer(now_s: Clock) -> None:
        try:
            swallow(now_s)
        except BaseException:  # noqa: BLE001  # as a user may write it
            swallow(now_s)

    def work(timer: StepTimer, now_s: Clock) -> None:
        with step_of(timer, now_s):
            (outer if nested else swallow)(now_s)

    before = sys.gettrace()
    with pytest.raises(StepTimeout):
        watched(work)
    assert sys.gettrace() in (None, before)


def test_a_step_that_takes_the_alarm_is_interrupted_by_a_key_and_the_next_by_the_alarm_again() -> (
    None
):
    def ignore(now_s: Clock) -> None:
        signal.signal(signal.SIGALRM, signal.SIG_IGN)
        spend(now_s, 0.1)
        os.kill(os.getpid(), signal.SIGUSR2)  # not late yet
        spend(now_s, STEP_LIMIT_S)
        os.kill(os.getpid(), signal.SIGUSR2)
        spend(now_s, 30.0)

    def work(timer: StepTimer, now_s: Clock) -> None:
        timer.interrupt_by(signal.SIGUSR2)
        for step in (ignore, lambda now: spend(now, 30.0)):
            with step_of(timer, now_s), pytest.raises(StepTimeout):
                step(now_s)

    watched(work)


def test_a_key_and_the_alarm_at_once_interrupt_a_step_once() -> None:
    both = {signal.SIGALRM, signal.SIGUSR2}

    def work(timer: StepTimer, now_s: Clock) -> None:
        timer.interrupt_by(signal.SIGUSR2)
        with step_of(timer, now_s):
            signal.pthread_sigmask(signal.SIG_BLOCK, both)  # as where compiled code does not return
            try:
                spend(now_s, STEP_LIMIT_S + 0.1)
                os.kill(os.getpid(), signal.SIGUSR2)
            finally:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, both)

    with pytest.raises(StepTimeout) as raised:
        watched(work)
    assert raised.value.__context__ is None, "nothing was raised where it was handled"


@pytest.mark.real_time  # a busy machine lengthens the short step
def test_the_first_slow_step_is_told_and_the_newest_is_a_cause_of_a_late_command() -> None:
    def work(timer: StepTimer, now_s: Clock) -> list[tuple[Sentence | None, Sentence | None]]:
        told = []
        for lasts_s in (0.5 * SLOW_S, SLOW_S + 0.01, 2.0 * SLOW_S):
            with step_of(timer, now_s, "controller mine:Slow"):
                spend(now_s, lasts_s)
            told.append((timer.slow, timer.find_recent()))
        spend(now_s, 1.1)
        assert timer.find_recent() is None
        return told

    quick, (slow, cause), (still, newest) = watched(work)
    assert quick == (None, None)
    assert slow is still is cause
    assert str(slow).startswith("controller mine:Slow took ")
    assert "poses that came meanwhile are not used, limit 50 ms" in str(slow)
    assert str(newest).startswith("controller mine:Slow took 1")


def test_somebody_else_s_alarm_is_handed_on() -> None:
    def work(timer: StepTimer, now_s: Clock) -> None:
        os.kill(os.getpid(), signal.SIGALRM)
        spend(now_s, 0.05)
        with step_of(timer, now_s):
            os.kill(os.getpid(), signal.SIGALRM)  # in a step that is not late it is no timeout
            spend(now_s, 0.05)

    watched(work)
    assert ALARMS == ["told"]


def hanging(time_s: float) -> Reference:
    while time_s > 0.0:
        pass
    return Reference((0.0, 0.0, -1.0))


class Hasty(StepTimer):
    """Makers have a second."""

    def begin(self, what: str, limit_s: float = STEP_LIMIT_S) -> None:
        super().begin(what, limit_s if limit_s == STEP_LIMIT_S else 1.0)


def made_never() -> Reference:
    while True:
        pass


NEVER_RETURN: dict[str, tuple[Callable[[], object], str]] = {
    "a trajectory": (
        lambda: OwnTrajectoryConfig(factory=f"{__name__}:hanging").build().at(1.0),
        "hanging .* within 500 ms",
    ),
    "what makes a controller": (
        lambda: make_controller(Custom(factory=f"{__name__}:made_never"), Vehicle()),
        "made_never .* within 1 s",
    ),
    "an import": (lambda: find_object("controller.kind", "imported_never:Own"),
        "import imported_never: StepTimeout"),
}  # fmt: skip


@pytest.mark.parametrize(("step", "says"), NEVER_RETURN.values(), ids=NEVER_RETURN)
def test_users_code_that_never_returns_is_interrupted_wherever_it_runs(
    step: Callable[[], object], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "imported_never.py").write_text("while True:\n    pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises((ConfigError, UserCodeFault), match=says):
        watched(lambda timer, now_s: step(), Hasty)


def test_an_interrupt_that_the_step_itself_raises_ends_it_as_a_fault_of_its_own() -> None:
    def decide() -> None:
        raise KeyboardInterrupt

    def work(timer: StepTimer, _: Clock) -> list[str]:
        with pytest.raises(KeyboardInterrupt):  # Ctrl-C, while the program is loaded
            timer.run("controller mine:Quits", 0.5, decide)
        timer.interrupt_by(signal.SIGINT)
        with pytest.raises(SelfInterrupt) as caught:  # the event loop hears keys: it is none
            timer.run("controller mine:Quits", 0.5, decide)
        fault = UserCodeFault("controller mine:Quits", caught.value)
        assert "failed: SelfInterrupt: KeyboardInterrupt, by its own code and no key" in str(fault)
        return [frame.name for frame in traceback.extract_tb(caught.value.__traceback__)]

    assert watched(work) == ["decide"]
