"""Tests in real time on a machine that is too busy for them: told so, and tried once more.

What is kept waiting for a processor is late, and says nothing about the code. So where such a test fails, the machine
is asked at once what share of a processor it gives to whoever wants all of one. Where that is little, the test waits a
while for better, and runs once more; where it fails again and the share is as little, it is left out, loudly.
"""

import time
from collections.abc import Callable

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


def await_enough(share: Callable[[], float] = share, patience_s: float = PATIENCE_S) -> None:
    """Wait for a machine that has enough to give, but not for ever."""
    until = time.monotonic() + patience_s
    while share() < ENOUGH and time.monotonic() < until:
        time.sleep(1.0)


def retried(attempt: Callable[[], bool], share: Callable[[], float], wait: Callable[[], None]) -> tuple[bool, str]:
    """Whether the last attempt counts, and what is to be said; ``attempt`` is True where it succeeds."""
    if attempt() or (first := share()) >= ENOUGH:
        return True, ""
    wait()
    if attempt():
        return True, f"machine too busy ({first:.0%} of a processor), passed when tried again"
    second = share()
    return second >= ENOUGH, f"machine too busy ({first:.0%} of a processor), failed when tried again ({second:.0%})"


@pytest.hookimpl(trylast=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run one test in real time; of two attempts, the second is reported."""
    if item.get_closest_marker("real_time") is None:
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports: list[pytest.TestReport] = []

    def attempt() -> bool:
        if reports:
            # What the first attempt shares with others was as late as itself.
            item.session._setupstate.teardown_exact(None)
        reports[:] = runtestprotocol(item, log=False, nextitem=nextitem)
        return not any(report.failed for report in reports)

    counts, said = retried(attempt, share, await_enough)
    for report in reports:
        if said:
            report.user_properties.append(("said", f"{item.nodeid}: {said}"))
        if not counts and report.failed:
            report.outcome = "skipped"
            report.longrepr = (str(item.path), item.location[1] or 0, TOO_BUSY)
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
