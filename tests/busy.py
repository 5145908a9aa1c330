"""Tests in real time on a machine that is too busy for them: told so, and tried once more.

What is kept waiting for a processor is late, and says nothing about the code. Two things tell of it, and neither
depends on what is tested: what share of a processor the machine gives, right after a failure, to whoever wants all of
one; and by how much a process that sleeps for moments was woken too late, while the test ran and while what it shares
with others was set up. Where they tell of it, a test that failed waits a while for better. Every one that failed runs
once more, and it is said; where it fails again and the machine is as busy, it is left out, loudly.
"""

import gc
import os
import subprocess
import sys
import time
import warnings
from collections import deque
from collections.abc import Callable
from contextlib import suppress

import pytest
from _pytest.runner import runtestprotocol

ENOUGH = 0.75
"""Of a processor, for who wants all of it: with less, a test in real time proves nothing by its failure [-]."""
LOOK_S = 0.25
"""How long the share is measured [s]."""
PATIENCE_S = 20.0
"""How long a test waits for a machine that has enough to give [s]."""
TOO_BUSY = "left out: machine too busy"


def share() -> float:
    """What part of a processor this thread gets that wants all of one [-]."""
    begun, used = time.perf_counter(), time.thread_time()
    while (lasted := time.perf_counter() - begun) < LOOK_S:
        pass
    return (time.thread_time() - used) / lasted


SLEEPER = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
parent = os.getppid()
os.set_blocking(1, False)
while os.getppid() == parent:
    due = time.monotonic() + 0.01
    time.sleep(0.01)
    if (late := time.monotonic() - due) > 0.005:
        try:
            os.write(1, b"%f %f\\n" % (due, late))
        except BlockingIOError:
            pass
"""
LATE_S = 0.02
"""Who is woken so late [s] has not had what a test in real time needs."""


class Sleeper:
    """A process of its own that sleeps for moments, on one processor."""

    def __init__(self, processor: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", SLEEPER, str(processor)], stdout=subprocess.PIPE
        )
        self._woken: deque[tuple[float, float]] = deque(maxlen=10_000)

    def late_s(self, since_s: float) -> float:
        """How late it was woken at the most, since a time on the monotonic clock [s]."""
        out = self._process.stdout
        assert out is not None
        os.set_blocking(out.fileno(), False)
        with suppress(BlockingIOError):
            while found := os.read(out.fileno(), 1 << 20):
                for line in found.decode().splitlines():
                    due_s, late_s = line.split()
                    self._woken.append((float(due_s), float(late_s)))
        return max((late_s for due_s, late_s in self._woken if due_s >= since_s), default=0.0)

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.communicate()


class Machine:
    """What tests in real time run on."""

    def __init__(self) -> None:
        self._sleepers: list[Sleeper] = []
        self.since_s: dict[str, float] = {}
        """When the tests of each file began to run here."""

    def watch(self, path: str) -> None:
        """A test of this file begins."""
        self._sleepers = self._sleepers or [Sleeper(processor) for processor in os.sched_getaffinity(0)]
        self.since_s.setdefault(path, time.monotonic())

    def is_too_busy(self, path: str) -> str:
        """How it shows, as words; empty where it does not."""
        late_s, got = max(each.late_s(self.since_s[path]) for each in self._sleepers), share()
        if late_s < LATE_S and got >= ENOUGH:
            return ""
        return f"{got:.0%} of a processor, up to {1e3 * late_s:.0f} ms late"

    def await_enough(self, path: str) -> None:
        """Wait for better, but not for ever; what was late until then is over."""
        until = time.monotonic() + PATIENCE_S
        while share() < ENOUGH and time.monotonic() < until:
            time.sleep(1.0)
        self.since_s[path] = time.monotonic()

    def end(self) -> None:
        """The tests are over."""
        for each in self._sleepers:
            each.end()


def retried(attempt: Callable[[], bool], too_busy: Callable[[], str], wait: Callable[[], None]) -> tuple[bool, str]:
    """Whether the last attempt counts, and what is to be said; ``attempt`` is True where it succeeds."""
    if attempt():
        return True, ""
    busy = too_busy()
    if busy:
        wait()
    first = f"machine too busy ({busy})" if busy else "failed"
    if attempt():
        return True, f"{first}, passed when tried again"
    second = too_busy()
    return not second, f"{first}, failed when tried again ({second or 'with enough of it'})"


MACHINE = Machine()


def pytest_collection_finish() -> None:
    """All tests are known: to look at them as garbage again would hold up one in real time for a tenth of a second."""
    gc.collect()
    gc.freeze()


def pytest_sessionfinish() -> None:
    """Nothing goes on after the tests."""
    MACHINE.end()


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run one test in real time; of two attempts, the second is reported."""
    if item.get_closest_marker("real_time") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    path = str(item.path)
    MACHINE.watch(path)
    reports: list[pytest.TestReport] = []

    def attempt() -> bool:
        if reports:
            # What the first attempt shares with others was as late as itself; and what it left open is no failure of
            # the second.
            item.session._setupstate.teardown_exact(None)
            reports.clear()
            sys.last_type = sys.last_value = sys.last_traceback = None
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                gc.collect()
        reports[:] = runtestprotocol(item, log=False, nextitem=nextitem)
        return not any(report.failed for report in reports)

    counts, said = retried(attempt, lambda: MACHINE.is_too_busy(path), lambda: MACHINE.await_enough(path))
    for report in reports:
        if said:
            report.user_properties.append(("said", f"{item.nodeid}: {said}"))
        if not counts and report.failed:
            report.outcome = "skipped"
            report.longrepr = (str(item.path), item.location[1] or 0, TOO_BUSY)
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
