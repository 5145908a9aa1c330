"""Tests in real time that fail run once more, and it is said.

A machine that could not keep time is told apart.

What is kept waiting for a processor is late, and says nothing about the code. A floor tells: on
each processor, a process that does nothing but keep a plain timer of a radio frame's period. Where
it was late by half a period and more for over a twentieth of the second attempt's own time, or for
a fifth of a second without a break, nothing could have kept time there, and the test is left out,
loudly. Anything less excuses nothing: what fails twice has failed.
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
from pathlib import Path
from typing import NamedTuple

import pytest
from _pytest.runner import runtestprotocol

PERIOD_S = 0.0225
"""Of the timer: DSM's, the slowest that we keep [s]."""
GROSS = 0.05
"""Share of moments late by half a period above which nothing could keep time [-]."""
STALL_S = 0.2
"""Time without a moment on time, after which nothing could have kept time [s]: a flight ends by
itself after 0.25 s without a pose."""
LEAST_S = 1.0
"""No share is taken of less: a single late moment is no excuse for a short test [s]."""
PATIENCE_S = 20.0
"""How long a test waits for a machine that keeps time again [s]."""
TOO_BUSY = "left out: machine too busy"
RARELY = 20_000
"""Garbage collection begins at so many new objects [-]: it took a fortieth of all time."""

# Each moment has its own due time: who is held up for a second misses all of a second's.
SLEEPER = f"""
import os, sys, time
os.sched_setaffinity(0, {{int(sys.argv[1])}})
parent = os.getppid()
os.set_blocking(1, False)
due = time.monotonic()
while os.getppid() == parent:
    due += {PERIOD_S}
    time.sleep(max(0.0, due - time.monotonic()))
    if time.monotonic() - due > {PERIOD_S / 2.0}:
        try:
            os.write(1, b"%f\\n" % due)
        except BlockingIOError:
            pass
"""


class Sleeper:
    """A process of its own that keeps a plain timer on one processor."""

    def __init__(self, processor: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", SLEEPER, str(processor)], stdout=subprocess.PIPE
        )
        self._late_at_s: deque[float] = deque(maxlen=10_000)

    def late(self, since_s: float) -> float:
        """Share of its moments since a monotonic time that came late [-]."""
        out = self._process.stdout
        assert out is not None
        os.set_blocking(out.fileno(), False)
        with suppress(BlockingIOError):
            while found := os.read(out.fileno(), 1 << 20):
                self._late_at_s += map(float, found.split())
        late_s = [due_s for due_s in self._late_at_s if due_s >= since_s]
        in_a_row = round(STALL_S / PERIOD_S)
        for first_s, last_s in zip(late_s, late_s[in_a_row:], strict=False):
            if last_s - first_s < STALL_S + PERIOD_S:
                return 1.0
        return PERIOD_S * len(late_s) / max(LEAST_S, time.monotonic() - since_s)

    def end(self) -> None:
        """End it."""
        self._process.kill()
        self._process.communicate()


class Machine:
    """What tests in real time run on."""

    def __init__(self) -> None:
        self._sleepers: list[Sleeper] = []

    def watch(self) -> None:
        """Tests in real time begin."""
        self._sleepers = self._sleepers or [
            Sleeper(processor) for processor in os.sched_getaffinity(0)
        ]

    def late(self, since_s: float) -> float:
        """For what share of the time since then its worst processor kept no time [-]."""
        return max(each.late(since_s) for each in self._sleepers)

    def await_better(self) -> None:
        """Wait until it keeps time, but not for ever."""
        until_s = time.monotonic() + PATIENCE_S
        while (now_s := time.monotonic()) < until_s:
            time.sleep(1.0)
            if self.late(now_s) <= GROSS:
                return

    def end(self) -> None:
        """The tests are over."""
        for each in self._sleepers:
            each.end()


class Attempt(NamedTuple):
    """One run of a test."""

    failure: str
    """The line at which it failed, and by what; empty where it passed."""
    late: float
    """For what share of its time the machine kept none [-]."""


def retry(run: Callable[[], Attempt], wait: Callable[[], None]) -> tuple[bool, str]:
    """Whether the last attempt counts, and what is to be said."""
    first = run()
    if not first.failure:
        return True, ""
    said = f"failed ({first.failure}; machine late {first.late:.0%} of the time)"
    if first.late > GROSS:
        wait()
    second = run()
    if not second.failure:
        return True, f"{said}, passed when tried again"
    same = second.failure.partition(": ")[0] == first.failure.partition(": ")[0]
    place = "at the same line" if same else second.failure
    again = f"{place}; machine late {second.late:.0%} of the time"
    return second.late <= GROSS, f"{said}, failed when tried again ({again})"


MACHINE = Machine()


def pytest_collection_finish() -> None:
    """Freeze the collected tests: garbage collection of them takes a tenth of a second."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(RARELY, *gc.get_threshold()[1:])


def pytest_sessionfinish() -> None:
    """Nothing goes on after the tests."""
    MACHINE.end()


def failure_of(reports: list[pytest.TestReport]) -> str:
    """The file, line and exception of the first that failed; empty where none did."""
    for report in reports:
        if report.failed:
            crash = getattr(report.longrepr, "reprcrash", None)
            where = report.longreprtext
            if crash:
                where = f"{Path(crash.path).name}:{crash.lineno}: {crash.message}"
            return (where.splitlines() or [report.when or ""])[0]
    return ""


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run one test in real time; of two attempts, the second is reported."""
    if item.get_closest_marker("real_time") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    MACHINE.watch()
    reports: list[pytest.TestReport] = []

    def run() -> Attempt:
        if reports:
            # What the first attempt shares with others was as late as itself; and what it left open
            # is no failure of the second.
            item.session._setupstate.teardown_exact(None)
            reports.clear()
            sys.last_type = sys.last_value = sys.last_traceback = None
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                gc.collect()
        begun_s = time.monotonic()
        reports[:] = runtestprotocol(item, log=False, nextitem=nextitem)
        return Attempt(failure_of(reports), MACHINE.late(begun_s))

    counts, said = retry(run, MACHINE.await_better)
    for report in reports:
        if said:
            report.user_properties.append(("said", f"{item.nodeid}: {said}"))
        if not counts and report.failed:
            report.outcome = "skipped"
            report.longrepr = (str(item.path), item.location[1] or 0, TOO_BUSY)
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
