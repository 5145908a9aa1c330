"""Output that nobody reads: a full pipe, a full disk, a held terminal, a reader that has gone."""

import json
import os
import pty
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import pairwise
from pathlib import Path
from unittest.mock import Mock

import pytest

from groundstation import __main__ as groundstation, load
from groundstation.machine import NonBlockingWriter
from groundstation.recording import NoRecording, Recording
from tests.e2e.stations import EXAMPLE, Room, beside, program, run_command, run_here, served
from tests.known import known
from tests.recordings import recorded


def test_a_full_pipe_loses_lines_and_tells_how_many_once_it_is_read() -> None:
    reading, writing = os.pipe()
    outlet = NonBlockingWriter(writing)
    for number in range(100):
        outlet.say(f"{number} " + "x" * 2000)
    assert outlet.lost > 50
    held = os.read(reading, 1 << 20).decode().splitlines()
    assert [line.split()[0] for line in held] == [str(number) for number in range(len(held))]
    outlet.say("after")
    said = f"{100 - len(held)} lines were lost: nobody read them\nafter\n"
    assert os.read(reading, 1 << 20).decode() == said


def test_a_terminal_that_is_held_by_control_s_is_not_waited_for() -> None:
    ours, theirs = pty.openpty()
    outlet = NonBlockingWriter(theirs)
    outlet.say("before")
    os.write(ours, b"\x13")  # Ctrl-S
    begun = time.monotonic()
    for number in range(2000):
        outlet.say(f"{number} while it stands still")
    assert time.monotonic() - begun < 5.0
    assert outlet.lost > 0
    os.write(ours, b"\x11")  # Ctrl-Q
    os.set_blocking(ours, False)
    shown, until = "", time.monotonic() + 60.0
    while "after" not in shown and time.monotonic() < until:
        try:
            shown += os.read(ours, 1 << 16).decode().replace("\r\n", "\n")
        except BlockingIOError:
            outlet.say("after")
    assert shown.startswith("before\n")
    assert "lines were lost" in shown
    for line in shown.splitlines():
        sentences = ("stands still", "nobody read them")
        assert line in ("before", "after", "^S", "^Q") or line.endswith(sentences)
    assert os.get_blocking(theirs)  # whoever shares it waits as before


QUERIES = ("groundstation config show", "groundstation config vehicles", "sim scenarios --json")


@pytest.mark.tried(2)  # commands
@pytest.mark.parametrize("line", [*QUERIES, "sim fly --duration 1"])
def test_a_reader_that_has_gone_ends_a_command_without_a_traceback(line: str) -> None:
    with beside(program(*line.split()), stderr=subprocess.PIPE) as process:
        known(process.stdout).close()
        _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (1, "")


def test_a_full_disk_is_told_of_in_one_line() -> None:
    with open("/dev/full", "w") as full:  # noqa: PTH123  # a device
        done = run_command(program("groundstation", "config", "show"), stdout=full)
    assert done.returncode == 1
    assert done.stderr == "the output cannot be written: No space left on device\n"


def test_a_log_that_can_not_be_written_is_told_before_anything_flies(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("no folder", "utf-8")
    folder = tmp_path / "taken" / "flights"
    main, side = pty.openpty()
    words = program("groundstation", "fly", EXAMPLE, "--tui", "--set", f"recording.folder={folder}")
    done = run_command(words, stdin=side, stdout=side, stderr=side)
    said = os.read(main, 10_000).decode()
    os.close(side)
    os.close(main)
    assert done.returncode == 2
    assert said.startswith(f"groundstation: recording.folder: cannot write {folder / 'mqx.log'}")
    assert said.endswith("Not a directory\r\n")


FULL = {
    "export {log} --out {out}": "--out: cannot write {out}",
    "export {log} --format npz --out {out}.npz": "--out: cannot write {out}.npz",
    "export {log} --format mcap --out {out}.mcap": "--out: cannot write {out}.mcap",
    "logs import {poses} --map tum --out {out}.mcap": "--out: cannot write {out}.mcap",
    "config key {out}.key": "config key: cannot write {out}.key",
}


@pytest.mark.parametrize("words", FULL)
def test_what_a_full_disk_does_not_hold_is_not_begun(words: str, tmp_path: Path) -> None:
    """As on a full disk, no file may grow beyond 16 bytes."""
    poses = tmp_path / "poses.txt"
    poses.write_text("".join(f"{0.01 * n} {0.001 * n} 0 1 0 0 0 1\n" for n in range(200)), "utf-8")
    names = {"log": recorded()[0], "poses": poses, "out": tmp_path / "made"}
    limit = "import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (16, 16)); "
    command = ["groundstation", *words.format(**names).split()]
    begin = "runpy.run_module('groundstation', run_name='__main__')"
    done = run_command([sys.executable, "-B", "-c", f"{limit}sys.argv = {command!r}; {begin}"])
    says = f"groundstation: {FULL[words].format(**names)}: File too large"
    assert done.stderr.startswith(says)
    assert done.returncode == 2
    assert [file.name for file in tmp_path.iterdir()] == ["poses.txt"]


def test_a_simulated_flight_whose_recording_is_cut_off_has_failed(tmp_path: Path) -> None:
    limit = "import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (99999, 99999))"
    command = ["groundstation-sim", "fly", "--duration", "5", "--out", str(tmp_path / "run")]
    begin = "runpy.run_module('sim', run_name='__main__')"
    done = run_command([sys.executable, "-B", "-c", f"{limit}; sys.argv = {command!r}; {begin}"])
    assert "recording has ended, the flight goes on" in done.stderr
    assert done.returncode == 1


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&- <&-"])
def test_a_program_that_is_started_without_standard_streams_flies_and_records(
    closed: str, tmp_path: Path
) -> None:
    flight = shlex.join(program("sim", "fly", "--duration", "1", "--out", tmp_path))
    done = run_command(["sh", "-c", f"{flight} {closed}"], stdin=None)
    assert done.returncode == 0
    assert json.loads((tmp_path / "summary.json").read_text())["completed"]
    assert load(tmp_path / "flight.mcap").time.size > 0


def the_recording(room: Room) -> Recording:
    [path] = room.recordings.glob("*.mcap")
    return Recording(path)


def await_armed(room: Room, process: "subprocess.Popen[bytes]") -> None:
    """Wait until commands leave, by the recording: the terminal says nothing any more."""
    until = time.monotonic() + 60.0
    while time.monotonic() < until and process.poll() is None:
        if list(room.recordings.glob("*.mcap")):
            try:
                topics = [entry.topic for entry in the_recording(room).entries(("/command",))]
            except (OSError, ValueError, NoRecording):  # not yet written to
                topics = []
            if len(topics) > 20:
                return
        time.sleep(0.1)
    pytest.fail(f"no commands left; exit code {process.poll()}")


@contextmanager
def frozen(room: Room, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    """A flight at a terminal that Ctrl-S holds from the beginning."""
    ours, theirs = pty.openpty()
    os.write(ours, b"\x13")
    with unread(room, theirs, *words) as process:
        yield process
    os.close(ours)


@contextmanager
def piped(room: Room) -> Iterator["subprocess.Popen[bytes]"]:
    """A flight whose output goes into a pipe that is full from the beginning."""
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    with pytest.raises(BlockingIOError):
        while True:
            os.write(writing, b"x" * 4096)
    os.set_blocking(writing, True)
    with unread(room, writing) as process:
        yield process
    os.close(reading)


@contextmanager
def unread(room: Room, output: int, *words: str) -> Iterator["subprocess.Popen[bytes]"]:
    command, null = room.station("fly", "--arm", "mqx", *words), subprocess.DEVNULL
    with subprocess.Popen(command, stdin=null, stdout=output, stderr=output) as process:
        try:
            yield process
        finally:
            process.kill()
    os.close(output)


def test_commands_go_on_and_the_flight_lands_while_the_terminal_stands_still() -> None:
    with served() as room:
        with frozen(room, "--set", "flight.duration_s=2.0") as process:
            assert process.wait(60) == 0
        times = [entry.value()["time_s"] for entry in the_recording(room).entries(("/command",))]
    assert len(times) > 80
    # Where it waited, it would be for ever.
    assert max(after - before for before, after in pairwise(times)) < 0.3


@pytest.mark.tried(1)  # a pipe, and not a terminal as well
@pytest.mark.parametrize("at", [piped, frozen])
def test_motors_stop_though_nobody_reads(
    at: "Callable[[Room], AbstractContextManager[subprocess.Popen[bytes]]]",
) -> None:
    with served() as room:
        with at(room) as process:
            await_armed(room, process)
            process.send_signal(signal.SIGQUIT)
            assert process.wait(60) == 1
        requests = [entry.value()["what"] for entry in the_recording(room).entries(("/request",))]
    assert requests == ["kill"]


@pytest.mark.parametrize("words", ["replay {}", "report {}", "export {log} --out {}"])
def test_a_path_that_the_system_refuses_is_told_of_in_one_line(words: str) -> None:
    name = 300 * "a"
    done = run_here(groundstation.main, *words.format(name, log=recorded()[0]).split())
    said = f"groundstation: cannot use {name}: File name too long\n"
    assert (done.returncode, done.stderr) == (2, said)


def test_a_folder_that_may_not_be_read_is_not_shown_as_empty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = PermissionError(13, "Permission denied", str(tmp_path))
    monkeypatch.setattr(Path, "iterdir", Mock(side_effect=refused))
    done = run_here(groundstation.main, "logs", tmp_path)
    assert "logs: cannot read" in done.stderr
    assert done.returncode == 2
