"""A Chromium without a window, driven by its own protocol (devtools) through two pipes."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

BEGIN = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]
os.dup2(ends[0], 3)
os.dup2(ends[1], 4)
os.execvp(sys.argv[3], sys.argv[3:])
"""
"""Begins a browser with its pipes where it looks for them: at 3 and 4."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


class Tab:
    """One page. Everything that has happened to it is in ``events``, oldest first."""

    def __init__(self, reading: int, writing: int) -> None:
        self.events: list[dict[str, Any]] = []
        self._reading, self._writing = reading, writing
        self._came = b""
        self._number = 0
        self._session: dict[str, str] = {}
        [page] = [one for one in self.do("Target.getTargets")["targetInfos"] if one["type"] == "page"]
        attached = self.do("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = {"sessionId": attached["sessionId"]}
        for domain in ("Page", "Network", "Runtime", "Log"):
            self.do(f"{domain}.enable")

    def do(self, method: str, **params: Any) -> dict[str, Any]:
        self._number += 1
        order = {"id": self._number, "method": method, "params": params, **self._session}
        os.write(self._writing, json.dumps(order).encode() + b"\0")
        while (message := self._message()).get("id") != self._number:
            self.events.append(message)
        assert "error" not in message, message
        result: dict[str, Any] = message["result"]
        return result

    def script(self, text: str) -> Any:
        return self.do("Runtime.evaluate", expression=text, returnByValue=True)["result"].get("value")

    def press(self, key: str, code: int, *, ctrl: bool = False) -> None:
        about = {"key": key, "windowsVirtualKeyCode": code, "modifiers": 2 if ctrl else 0}
        self.do("Input.dispatchKeyEvent", type="keyDown", **about, **({} if ctrl else {"text": key}))
        self.do("Input.dispatchKeyEvent", type="keyUp", **about)

    def until(self, true: Callable[[], Any]) -> None:
        limit = time.monotonic() + 60.0
        while not true():
            assert time.monotonic() < limit, self.events[-5:]
            time.sleep(0.05)

    def of(self, method: str) -> list[dict[str, Any]]:
        return [event["params"] for event in self.events if event["method"] == method]

    def _message(self) -> dict[str, Any]:
        while b"\0" not in self._came:
            data = os.read(self._reading, 1 << 20)
            assert data, "the browser has ended"
            self._came += data
        message, _, self._came = self._came.partition(b"\0")
        decoded: dict[str, Any] = json.loads(message)
        return decoded


@contextmanager
def opened(browser: str, url: str, folder: Path) -> Iterator[Tab]:
    """The page at ``url``, drawn without WebGL. The browser resolves no name but this machine's."""
    orders, order = os.pipe()
    answer, answers = os.pipe()
    command = [browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-3d-apis"]
    command += [
        "--no-first-run",
        "--disable-background-networking",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    ]
    command += ["--remote-debugging-pipe", f"--user-data-dir={folder / 'profile'}", "about:blank"]
    process = subprocess.Popen(
        [sys.executable, "-c", BEGIN, str(orders), str(answers), *command],
        pass_fds=(orders, answers),
        stderr=subprocess.DEVNULL,
    )
    os.close(orders)
    os.close(answers)
    try:
        tab = Tab(answer, order)
        tab.do("Page.navigate", url=url)
        yield tab
    finally:
        process.kill()
        process.wait()
        os.close(order)
        os.close(answer)
