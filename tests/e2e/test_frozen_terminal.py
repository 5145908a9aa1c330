"""A terminal that stands still must not hold up a command, nor an order to stop."""

import os
import pty
import signal
import subprocess
import time
from itertools import pairwise
from pathlib import Path

import pytest

from groundstation.recording import NoRecording, Recording
from tests.e2e.stations import Room, served


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


def frozen(room: Room, *words: str) -> "tuple[subprocess.Popen[bytes], list[int]]":
    """A flight at a terminal that Ctrl-S holds from the beginning."""
    ours, theirs = pty.openpty()
    os.write(ours, b"\x13")
    process = subprocess.Popen(
        room.station("fly", "--arm", "mqx", *words), stdin=subprocess.DEVNULL, stdout=theirs, stderr=theirs
    )
    return process, [ours, theirs]


def test_commands_go_on_and_the_flight_lands_while_the_terminal_stands_still() -> None:
    with served() as room:
        process, ends = frozen(room, "--set", "flight.duration_s=2.0")
        try:
            assert process.wait(60) == 0
        finally:
            process.kill()
            process.wait()
            for end in ends:
                os.close(end)
        times = [entry.value()["time_s"] for entry in the_recording(room).entries(("/command",))]
    assert len(times) > 80
    assert max(after - before for before, after in pairwise(times)) < 0.3  # where it waited, it would be for ever


@pytest.mark.tried(1)  # a terminal, and not a pipe as well
@pytest.mark.parametrize("how", ["pipe", "terminal"])
def test_motors_stop_though_nobody_reads(how: str, tmp_path: Path) -> None:
    with served() as room:
        if how == "terminal":
            process, ends = frozen(room)
        else:
            reading, writing = os.pipe()
            os.set_blocking(writing, False)
            with pytest.raises(BlockingIOError):
                while True:
                    os.write(writing, b"x" * 4096)
            os.set_blocking(writing, True)
            words = room.station("fly", "--arm", "mqx")
            process, ends = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=writing), [reading, writing]
        try:
            await_armed(room, process)
            process.send_signal(signal.SIGQUIT)
            assert process.wait(60) == 1
        finally:
            process.kill()
            process.wait()
            for end in ends:
                os.close(end)
        requests = [entry.value()["what"] for entry in the_recording(room).entries(("/request",))]
    assert requests == ["kill"]
