"""The page of a report in a real browser: no error, nothing fetched, every figure there."""

import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from groundstation.analysis.identify import find_outside
from groundstation.analysis.report import report_command
from groundstation.analysis.report.figures import FIGURES
from tests.e2e.chromium import BROWSERS
from tests.recordings import recorded

LOOK = """<script>
document.title = [...document.images].map(i => i.naturalWidth + "x" + i.naturalHeight)
</script>"""


class Seen(NamedTuple):
    title: str
    console: list[str]
    fetched: set[str]


def opened(browser: str, page: Path, folder: Path) -> Seen:
    """What the browser made of ``page``. It resolves no name: what it asks for on its own account gets nowhere."""
    log = folder / "net.json"
    command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    command += ["--no-first-run", "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}"]
    command += ["--enable-logging=stderr", f"--log-net-log={log}", "--virtual-time-budget=5000", "--dump-dom"]
    done = subprocess.run([*command, page.as_uri()], capture_output=True, text=True, timeout=60.0, check=True)
    (title,) = re.findall(r"<title>(.*?)</title>", done.stdout)
    asked = [event.get("params", {}) for event in json.loads(log.read_text("utf-8"))["events"]]
    fetched = {one["url"] for one in asked if "url" in one and one.get("initiator", "not an origin") != "not an origin"}
    return Seen(title, re.findall(r"CONSOLE.*", done.stderr), {url for url in fetched if not url.startswith("data:")})


@pytest.mark.matrix  # flight/test_report.py reads the page
def test_the_page_opens_without_an_error_and_without_asking_anybody_for_anything(
    tmp_path: Path, needs_program: Callable[..., str]
) -> None:
    browser = needs_program(*BROWSERS)
    report_command([recorded()[0]], tmp_path, find_outside, as_json=False)
    seen = opened(browser, tmp_path / "report.html", tmp_path)
    assert seen.title.startswith("mqx, adaptive")
    assert seen.console == []
    assert seen.fetched == set()
    # The same once more with a script that tells how large each picture came out; the page's own policy forbids any.
    text = (tmp_path / "report.html").read_text("utf-8")
    looked = text.replace("default-src 'none'", "default-src 'none'; script-src 'unsafe-inline'")
    (tmp_path / "looked.html").write_text(looked.replace("</body>", f"{LOOK}</body>"), "utf-8")
    sizes = re.findall(r"(\d+)x(\d+)", opened(browser, tmp_path / "looked.html", tmp_path).title)
    assert len(sizes) == len(FIGURES)
    assert all(int(width) > 900 and int(height) > 300 for width, height in sizes)


def test_an_error_and_a_fetch_would_be_seen(tmp_path: Path, needs_program: Callable[..., str]) -> None:
    browser = needs_program(*BROWSERS)
    (tmp_path / "bad.html").write_text(
        '<title>bad</title><script>nothing()</script><img src="http://pictures.invalid/x.png">'
    )
    seen = opened(browser, tmp_path / "bad.html", tmp_path)
    assert any("nothing is not defined" in line for line in seen.console)
    assert "http://pictures.invalid/x.png" in seen.fetched
