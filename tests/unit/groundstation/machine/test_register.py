"""The register of running processes: there while they live, whole, locked, of this user only."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from groundstation.machine import (
    ApiError,
    Running,
    explain_stop,
    hold_lock,
    note_stop,
    registration,
    running_processes,
    send_signal,
)
from groundstation.machine.register import STOP, SUFFIX
from tests.known import known

ONE = Running(pid=os.getpid(), command="fly", vehicle="mqx", socket="/x/mqx.sock")
PROGRAM = """
import os, signal, sys, time
signal.signal(signal.SIGQUIT, signal.SIG_DFL)  # a shell's background jobs ignore it
from groundstation.machine.register import Running, registration
with registration(Running(pid=os.getpid(), command=sys.argv[2], vehicle=sys.argv[1])):
    print("registered", flush=True)
    time.sleep(60)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where this test's processes register."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "groundstation"


@contextmanager
def another(name: str, command: str = "daemon") -> Iterator["subprocess.Popen[str]"]:
    """A process that has registered itself."""
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, name, command], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None and process.stdout.readline() == "registered\n"
            yield process
        finally:
            process.kill()


def entries(folder: Path) -> list[Path]:
    return list(folder.glob(f"*{SUFFIX}"))


def test_a_process_is_registered_while_it_lives_and_what_a_killed_one_left_is_removed(
    folder: Path, tmp_path: Path
) -> None:
    with another("bee") as bee, another("ant") as ant:
        seen = [(one.vehicle, one.pid) for one in running_processes(tmp_path)]
        assert seen == [("ant", ant.pid), ("bee", bee.pid)]
        assert folder.stat().st_mode & 0o777 == 0o700
        assert entries(folder)[0].stat().st_mode & 0o777 == 0o600
        bee.kill()
        bee.wait()
        assert len(entries(folder)) == 2
        assert [one.vehicle for one in running_processes(tmp_path)] == ["ant"]
        assert len(entries(folder)) == 1
    assert running_processes(tmp_path) == []


def test_a_signal_reaches_only_who_is_registered(tmp_path: Path) -> None:
    with another("bee") as bee:
        [one] = running_processes(tmp_path)
        stranger = Running(pid=bee.pid, command="daemon", vehicle="not bee")
        assert not send_signal(stranger, signal.SIGTERM)
        assert send_signal(one, signal.SIGTERM)
        assert bee.wait(60) == -signal.SIGTERM
        assert not send_signal(one, signal.SIGTERM)


@pytest.mark.parametrize("text", [b"", b"{", b'{"pid": "x"}', b"\xff" * 100, b"[" * 9000])
def test_what_is_no_entry_is_passed_over(folder: Path, tmp_path: Path, text: bytes) -> None:
    with another("bee"):
        (folder / f"broken{SUFFIX}").write_bytes(text)
        (folder / f"link{SUFFIX}").symlink_to(entries(folder)[0])
        os.mkfifo(folder / f"pipe{SUFFIX}", 0o600)
        assert [one.vehicle for one in running_processes(tmp_path)] == ["bee"]


def test_a_folder_that_others_may_write_is_neither_used_nor_believed(
    folder: Path, tmp_path: Path
) -> None:
    with another("bee"):
        folder.chmod(0o777)
        assert running_processes(tmp_path) == []
        with pytest.raises(ApiError, match="nobody else may write to"), registration(ONE):
            raise AssertionError("it must not fly")


def test_flights_of_a_service_of_this_user_are_found_in_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    services = tmp_path / "services"
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(services / "bee"))
    with another("bee"):
        monkeypatch.delenv("RUNTIME_DIRECTORY")
        assert running_processes(tmp_path / "nowhere") == []
        assert [one.vehicle for one in running_processes(services)] == ["bee"]


LATE = """
import sys, time
from groundstation.machine import explain_stop
print("begun", flush=True)
sys.stdin.readline()
print(explain_stop() or "may fly", flush=True)
"""


def test_what_began_before_an_order_to_land_all_does_not_arm_and_what_begins_later_may() -> None:
    command = [sys.executable, "-c", LATE]
    note_stop()
    asyncio.run(asyncio.sleep(0.1))  # ten ticks of the system's clock of processes
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as later:  # type: ignore[call-overload]  # one table
        assert known(later.stdout).readline() == "begun\n"
        assert later.communicate("\n")[0] == "may fly\n"
    with subprocess.Popen(command, **pipes) as before:  # type: ignore[call-overload]  # as above
        assert known(before.stdout).readline() == "begun\n"
        note_stop()
        assert "all flights were ordered to land" in before.communicate("\n")[0]


@pytest.mark.parametrize("found", ["", "1e99", "an hour ago"])
def test_an_order_of_before_the_machine_started_or_of_no_time_stops_nothing(
    found: str, folder: Path
) -> None:
    note_stop()
    assert explain_stop() is not None
    (folder / STOP).write_text(found)
    assert explain_stop() is None


@pytest.mark.parametrize(
    ("socket", "says"),
    [
        ("/", "status socket /"),
        (".", r"status socket \."),
        ("/proc/mqx.sock", "/proc of the status socket must be|status socket /proc"),  # as root
    ],
)
def test_a_place_that_can_hold_no_lock_is_named(socket: str, says: str) -> None:
    with (
        pytest.raises(ApiError, match=says),
        hold_lock(Path(socket), "mqx"),
    ):
        raise AssertionError("it is held")
