"""``--progress NAME``: a line every second or two that says how far the tests are and what runs; each failure at once.

For tests that workers run (``-n``): where the same process runs and tells, what it tells would be captured. In a
terminal the line is written over; several runs of tests may share one.
"""

import shutil
import sys
import threading
import time

import pytest

PERIOD_S = 1.5
LONGEST = 120
"""So many characters of a test's name are shown."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Without the option, pytest shows what it always shows."""
    parser.addoption("--progress", metavar="NAME", help="say how far the tests are, under this name")


@pytest.hookimpl(trylast=True)  # once there is a terminal to write to
def pytest_configure(config: pytest.Config) -> None:
    """Whoever starts workers tells for all of them."""
    name = config.getoption("progress")
    if name and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Progress(name, config))


class Progress:
    """Tells of tests under way."""

    def __init__(self, name: str, config: pytest.Config) -> None:
        self._name = name
        self._total = self._done = self._failed = 0
        self._since: dict[str, float] = {}
        """What runs → since when."""
        self._over = threading.Event()
        self._telling = threading.Lock()
        self._writer = config.get_terminal_writer()
        self._overwrites = sys.__stdout__ is not None and sys.__stdout__.isatty()
        self._thread = threading.Thread(target=self._tell_on, daemon=True)

    def line(self, now_s: float) -> str:
        """What is said at a time."""
        if not self._total:
            return f"{self._name}: looking for tests"
        failed = f", {self._failed} FAILED" if self._failed else ""
        running = ", ".join(
            f"{test.rpartition('/')[2][:LONGEST]} ({now_s - since_s:.0f} s)"
            for test, since_s in sorted(self._since.items())
        )
        return f"{self._name}: {self._done} of {self._total}{failed}; runs: {running}"

    def _tell_on(self) -> None:
        while not self._over.wait(PERIOD_S):
            line = self.line(time.monotonic())
            if self._overwrites:
                self._tell(f"\r\033[K{line[: shutil.get_terminal_size().columns - 1]}")
            else:
                self._tell(f"{line}\n")

    def _tell(self, text: str) -> None:
        with self._telling:
            self._writer.write(text, flush=True)

    def say(self, text: str) -> None:
        """Say something that stays."""
        self._tell(("\r\033[K" if self._overwrites else "") + text + "\n")

    @pytest.hookimpl(optionalhook=True)  # where there is no xdist
    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        """Every worker finds the same tests."""
        self._total = len(ids)

    def pytest_sessionstart(self) -> None:
        """Begin to tell."""
        self._thread.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """A test begins."""
        self._since[nodeid] = time.monotonic()

    @pytest.hookimpl(tryfirst=True)
    def pytest_report_teststatus(self, report: pytest.TestReport) -> tuple[str, str, str] | None:
        """No letters: they would stand in the middle of the line."""
        if report.failed:
            return ("failed" if report.when == "call" else "error"), "", ""
        if report.skipped:
            return "skipped", "", ""
        return ("passed" if report.when == "call" else ""), "", ""

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A failure is shown when it happens."""
        if report.failed:
            self._failed += 1
            self.say(f"\n{self._name}: FAILED {report.nodeid} ({report.when})\n{report.longreprtext}\n")
            for title, text in report.sections:
                self.say(f"---- {title}\n{text.rstrip()}")
        for name, value in report.user_properties:
            if name == "said" and report.when == "teardown":
                self.say(f"{self._name}: {value}")
        if report.when == "teardown":
            self._done += 1
            self._since.pop(report.nodeid, None)

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """All failures have been shown."""
        self._over.set()
        self._thread.join()
        self.say(self.line(time.monotonic()).partition("; runs")[0])
        session.config.option.tbstyle = "no"
