"""The daemon for a service manager and an operator: its own process, sockets and signals."""

import asyncio
import json
import os
import re
import signal
import socket as sockets
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.e2e.stations import Room, program, run_command, served, wait_until
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
