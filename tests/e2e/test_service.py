"""Parts of the daemon: notifications, log lines and the unit file."""

import json
import logging
import os
import shutil
import socket as sockets
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from groundstation.config import ConfigError, load
from groundstation.core.messages import Notice
from groundstation.core.safety.geofence import BoxFence
from groundstation.interfaces.service import unit_file
from groundstation.interfaces.service.flights import Notify, line_of, longest_landing_s
from groundstation.settings import Config
from tests.conftest import LEFT_OUT

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "loopback.toml"


@pytest.mark.parametrize("abstract", [False, True])
def test_the_manager_is_told_on_a_path_and_on_an_abstract_name(
    tmp_path: Path, abstract: bool
) -> None:
    name = f"\0gs-notify-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with sockets.socket(sockets.AF_UNIX, sockets.SOCK_DGRAM) as manager:
        manager.bind(name)
        manager.settimeout(5.0)

        notify = Notify({"NOTIFY_SOCKET": name.replace("\0", "@"), "WATCHDOG_USEC": "3000000"})
        notify.send("READY=1")
        notify.send("STATUS=landing:\nnow")
        notify.send("WATCHDOG=1")
        notify.send("STOPPING=1")
        assert notify.feed_s == pytest.approx(1.0)
        told = [manager.recv(200) for _ in range(4)]
        assert told == [b"READY=1", b"STATUS=landing: now", b"WATCHDOG=1", b"STOPPING=1"]


def test_a_manager_that_dies_or_does_not_read_is_no_trouble(tmp_path: Path) -> None:
    path = str(tmp_path / "notify")
    notify = Notify({"NOTIFY_SOCKET": path})
    with sockets.socket(sockets.AF_UNIX, sockets.SOCK_DGRAM) as manager:
        manager.bind(path)
        for number in range(2000):
            notify.send(f"STATUS={number}")
    notify.send("WATCHDOG=1")


def test_the_unit_waits_longer_than_the_longest_landing() -> None:
    low = load(EXAMPLE, Config)
    fence = BoxFence(height_m=12.0, north_m=(-2.0, 2.0), east_m=(-2.0, 2.0))
    high = msgspec.structs.replace(low, fence=fence)
    assert longest_landing_s(high) > longest_landing_s(low) + 12.0 / low.flight.descent_m_s * 0.7
    assert longest_landing_s(low) > 8.0 + 1.0 / low.flight.descent_m_s


def test_the_unit_file_pleases_systemd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "a $b%c"
    folder.mkdir()
    (folder / "groundstation").touch(mode=0o700)
    monkeypatch.setattr(sys, "executable", str(folder / "python"))
    overrides = ["flight.duration_s=5", 'recording.folder="a b\\q\nc"']
    text = unit_file(load(EXAMPLE, Config), EXAMPLE, overrides, user="root")
    starts = [line for line in text.splitlines() if line.startswith("ExecStart")]
    assert "--arm" not in " ".join(starts).split()
    restart = ("Restart=on-failure", "RestartPreventExitStatus=2 3")
    for line in ("Type=notify", "KillMode=mixed", *restart):
        assert line in text.splitlines()
    rest = text.replace("a $b%%c", "")  # the folder
    assert "$" not in "\n".join(line for line in rest.splitlines() if not line.startswith("#"))
    program = shutil.which("systemd-analyze")
    if program is None:
        pytest.skip(LEFT_OUT + "the unit file was not looked at, for want of systemd-analyze")
    file = tmp_path / "groundstation-mqx.service"
    file.write_text(text)
    done = subprocess.run(
        [program, "verify", str(file)], capture_output=True, check=False, text=True
    )
    about = [line for line in done.stderr.splitlines() if "groundstation" in line]
    assert (done.returncode, about) == (0, []), done.stderr


@pytest.mark.parametrize("user", ["a b", "", '"root"', "%u", "lab:lab", "-x", "root\nNice=1"])
def test_a_name_that_no_user_can_have_is_refused(user: str) -> None:
    with pytest.raises(ConfigError, match=r"^--user: expected a user's name matching \[A-Za-z0-9_"):
        unit_file(load(EXAMPLE, Config), EXAMPLE, [], user=user)


def test_json_log_lines_are_json() -> None:
    line = line_of(logging.INFO, 'x "y" \x1b', as_json=True, journal=False)
    assert json.loads(line)["msg"] == 'x "y" \x1b'
    event = Notice(12.5, "landing", "asked to", "state")
    told = json.loads(line_of(logging.INFO, event.line, event, as_json=True, journal=False))[
        "event"
    ]
    assert msgspec.convert(told, Notice) == event
