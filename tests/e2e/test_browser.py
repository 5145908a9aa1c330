"""The dashboard as a page in a real browser: drawn there, deaf to orders, and asking nobody else for anything."""

import asyncio
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from groundstation.__main__ import main
from groundstation.analysis.identify import find_outside
from groundstation.analysis.report import report_command
from groundstation.analysis.report.figures import FIGURES
from groundstation.interfaces.tui import browser
from tests.e2e.chromium import BROWSERS, Tab, opened
from tests.e2e.stations import run_here
from tests.e2e.test_mqtt import free_tcp_port
from tests.recordings import recorded


@pytest.fixture
def page(tmp_path: Path) -> Iterator[str]:
    """The address of a page that shows a made-up flight."""
    path, port = tmp_path / "mqx.sock", asyncio.run(free_tcp_port())
    screen = ["-m", "groundstation", "tui", "--socket", str(path), "--browser", str(port)]
    with (
        running(["-m", "tests.sample_flight", str(path)]),
        running(screen) as server,
    ):
        assert server.stdout is not None
        assert f"to look at only: http://127.0.0.1:{port}" in server.stdout.readline()
        yield f"http://127.0.0.1:{port}/"


@contextmanager
def running(words: list[str]) -> Iterator["subprocess.Popen[str]"]:
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


def shown(tab: Tab) -> str:
    """What the rows of the terminal say to whoever looks."""
    rows = tab.script("document.querySelector('.xterm-rows')?.innerText") or ""
    return str(rows).replace("\N{NO-BREAK SPACE}", " ")


def test_the_page_shows_the_flight_takes_no_order_and_fetches_nothing_from_elsewhere(
    page: str, tmp_path: Path, needs_program: Callable[..., str]
) -> None:
    with opened(needs_program(*BROWSERS), page, tmp_path) as tab:
        tab.until(lambda: "following the trajectory" in shown(tab))
        assert "read only: orders nothing" in shown(tab)
        assert "NOTHING WAS ORDERED" not in shown(tab)
        tab.press("l", 76, ctrl=True)
        tab.until(lambda: "NOTHING WAS ORDERED" in shown(tab))
        tab.press("5", 53)
        tab.until(lambda: "100.000 tracking" in shown(tab))
        asked = [one["request"]["url"] for one in tab.of("Network.requestWillBeSent")]
        assert len(asked) >= 3
        assert all(url.startswith((page, "data:")) for url in asked), asked
        assert tab.of("Network.loadingFailed") + tab.of("Runtime.exceptionThrown") + tab.of("Log.entryAdded") == []


def test_the_word_behind_browser_is_a_port_or_the_recording(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    served: list[tuple[int, str]] = []
    monkeypatch.chdir(tmp_path)
    done = run_here(main, "tui", "--browser", "LOG.mcap")
    assert done.returncode == 2 and "cannot read LOG.mcap: No such file" in done.stderr and not served
    Path("LOG.mcap").symlink_to(recorded()[0])
    monkeypatch.setattr(browser, "serve", lambda command, port, title: served.append((port, title)))
    for words in (["LOG.mcap", "--browser"], ["--browser", "LOG.mcap"], ["--browser", "8001", "LOG.mcap"]):
        assert run_here(main, "tui", *words).returncode == 0
    assert served == [(8000, "LOG.mcap"), (8000, "LOG.mcap"), (8001, "LOG.mcap")]
    for words in (["--browser", "-1", "LOG.mcap"], ["--browser", "A.mcap", "B.mcap"]):
        assert run_here(main, "tui", *words).returncode == 2


def test_a_recording_is_shown_in_the_browser(tmp_path: Path, needs_program: Callable[..., str]) -> None:
    log, port = recorded()[0], asyncio.run(free_tcp_port())
    with running(["-m", "groundstation", "tui", str(log), "--browser", str(port)]) as server:
        assert server.stdout is not None
        assert f"http://127.0.0.1:{port}" in server.stdout.readline()
        with opened(needs_program(*BROWSERS), f"http://127.0.0.1:{port}/", tmp_path) as tab:
            tab.until(lambda: "mqx" in shown(tab) and "recording" in shown(tab).lower())


def test_the_page_of_a_report_opens_without_an_error_and_fetches_nothing(
    tmp_path: Path, needs_program: Callable[..., str]
) -> None:
    report_command([recorded()[0]], tmp_path, find_outside, as_json=False)
    with opened(needs_program(*BROWSERS), (tmp_path / "report.html").as_uri(), tmp_path) as tab:
        tab.until(lambda: tab.script("document.readyState") == "complete")
        sizes = tab.script("[...document.images].map(one => [one.naturalWidth, one.naturalHeight])")
        asked = [one["request"]["url"] for one in tab.of("Network.requestWillBeSent")]
        assert asked and all(url.startswith(("file:", "data:")) for url in asked), asked
        assert tab.of("Network.loadingFailed") + tab.of("Runtime.exceptionThrown") + tab.of("Log.entryAdded") == []
    assert len(sizes) == len(FIGURES) and all(width > 900 and height > 300 for width, height in sizes)


def test_a_page_of_somebody_elses_cannot_look(page: str) -> None:
    with urllib.request.urlopen(page) as answer:
        assert answer.status == 200
    for name, value in (("Host", "lab.example:8000"), ("Origin", "http://lab.example"), ("Origin", "null")):
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(urllib.request.Request(page, headers={name: value}))
