"""The daemon for a service manager and an operator: its process, sockets and signals; its parts."""

import asyncio
import json
import logging
import os
import re
import shutil
import signal
import socket as sockets
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
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
from tests.e2e.stations import EXAMPLE, Room, program, run_command, served, wait_until
from tests.e2e.test_real_time import seen


class Manager:
    """The service manager's end of ``$NOTIFY_SOCKET``, read all the time as a manager does."""

    def __init__(self, name: str) -> None:
        self._socket = sockets.socket(sockets.AF_UNIX, sockets.SOCK_DGRAM)
        self._socket.bind(name)
        self.told: list[str] = []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        while datagram := self._socket.recv(4096):
            self.told.append(datagram.decode())

    def close(self) -> None:
        with sockets.socket(sockets.AF_UNIX, sockets.SOCK_DGRAM) as last:
            last.sendto(b"", self._socket.getsockname())
        self._thread.join()
        self._socket.close()


class Running:
    """A daemon, and what it has logged."""

    def __init__(self, room: Room, log: Path, *arguments: str, environment: dict[str, str]) -> None:
        self._room = room
        self._log = log
        with log.open("w") as file:
            words = room.station("daemon", *arguments)
            null = subprocess.DEVNULL
            self.process = subprocess.Popen(
                words, stderr=file, stdin=null, env=os.environ | environment
            )

    @property
    def log(self) -> str:
        return self._log.read_text("utf-8")

    def says(self, pattern: str, times: int = 1) -> None:
        wait_until(lambda: len(re.findall(pattern, self.log)) >= times, lambda: self.log)

    def command(self, *words: str) -> "subprocess.CompletedProcess[str]":
        return run_command(program("groundstation", *words, "--socket", self._room.status_socket))


@contextmanager
def running(room: Room, log: Path, *arguments: str, **environment: str) -> Iterator[Running]:
    daemon = Running(room, log, *arguments, environment=environment)
    try:
        yield daemon
    finally:
        daemon.process.kill()
        daemon.process.wait()


def test_a_service_comes_up_idle_flies_on_request_gets_ready_again_and_ends_on_sigterm(
    tmp_path: Path,
) -> None:
    name = f"\0groundstation-test-{os.getpid()}"
    manager = Manager(name)
    environment = {"NOTIFY_SOCKET": "@" + name[1:], "WATCHDOG_USEC": "600000"}
    try:
        with (
            served() as room,
            running(room, tmp_path / "log", "--log-format", "json", **environment) as daemon,
        ):
            daemon.says("ready: link and poses are available")
            assert "READY=1" in manager.told
            time.sleep(0.5)
            assert " arming: " not in daemon.log

            second = run_command(room.station("daemon", "--once"))
            assert second.returncode == 3
            told = f"flown by another ground station already (process {daemon.process.pid}"
            assert told in second.stderr

            assert daemon.command("request", "track").returncode == 1
            unnamed = daemon.command("request", "arm")
            assert unnamed.returncode == 2 and "must name it: --vehicle mqx" in unnamed.stderr
            assert daemon.command("request", "arm", "--vehicle", "other").returncode == 2
            assert " arming: " not in daemon.log
            armed = daemon.command("request", "arm", "--vehicle", "mqx")
            assert (armed.returncode, armed.stdout) == (0, "arming\n"), armed.stderr
            asyncio.run(
                seen(room.status_socket, lambda s: s.flight_time_s > 1.5 and s.error_m < 0.1)
            )

            health = json.loads(daemon.command("daemon", "health", "--json").stdout)
            assert (health["well"], health["state"]) == (True, "tracking")
            assert health["pid"] == daemon.process.pid
            landing = daemon.command("request", "land", "--why", "enough")
            assert (landing.returncode, landing.stdout[:8]) == (0, "landing:")
            daemon.says("landed: landed and disarmed")
            daemon.says("ready: link and poses are available", times=2)
            assert daemon.log.count(" arming: ") == 1

            daemon.process.terminate()
            assert daemon.process.wait(60) == 0, daemon.log
            assert daemon.command("daemon", "health").returncode == 2
            assert daemon.command("request", "land").returncode == 2
            assert manager.told.count("WATCHDOG=1") > 20
            assert any(one.startswith("STATUS=tracking") for one in manager.told)
            assert "STOPPING=1" in manager.told
            assert all(json.loads(line)["level"] for line in daemon.log.splitlines()), daemon.log
            assert len(list(room.recordings.glob("*.mcap"))) == 1, (
                "of what was never armed no recording is kept"
            )
    finally:
        manager.close()


def test_a_daemon_that_is_started_again_after_its_death_in_flight_stays_on_the_ground(
    tmp_path: Path,
) -> None:
    with served() as room:
        with running(room, tmp_path / "first", "--arm", "mqx") as first:
            first.says("tracking: ")
            first.process.kill()
            first.process.wait()
        assert first.command("daemon", "health").returncode == 2
        with running(room, tmp_path / "second") as second:
            second.says("ready: link and poses are available|pre-flight checks failed")
            time.sleep(0.5)
            assert " arming: " not in second.log
            assert second.process.poll() is None
            assert second.command("daemon", "health").returncode == 0
            second.process.send_signal(signal.SIGSTOP)
            hangs = second.command("daemon", "health")
            second.process.send_signal(signal.SIGCONT)
            assert hangs.returncode == 1 and "no greeting within" in hangs.stdout, hangs
            second.process.terminate()
            assert second.process.wait(60) == 0


def test_a_service_is_never_armed_from_its_command_line(tmp_path: Path) -> None:
    with running(
        Room(tmp_path), tmp_path / "log", "--arm", "mqx", NOTIFY_SOCKET="/nowhere"
    ) as daemon:
        assert daemon.process.wait(60) == 2
    assert "a service never arms by itself" in daemon.log


def test_a_daemon_without_poses_goes_on_trying_and_ends_on_sigterm(tmp_path: Path) -> None:
    sets = ("--set=flight.pose_wait_s=0.2", "--set=link.connect_timeout_s=0.3")
    with running(Room(tmp_path), tmp_path / "log", *sets) as daemon:
        daemon.says("aborted: ", times=2)
        daemon.process.terminate()
        assert daemon.process.wait(60) == 0
    assert not list((tmp_path / "flights").glob("*.mcap"))


# ---- parts of the daemon: notifications, log lines and the unit file


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
