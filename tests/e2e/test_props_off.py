"""`groundstation props-off` at a terminal, against a simulated vehicle in a process of its own."""

import contextlib
import os
import pty
import select
import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from links.mavlink.protocol import ARMED, MavlinkCodec
from tests.e2e.stations import Room, run_command, served, wait_until


class Terminal:
    """An operator's terminal with the command in it."""

    def __init__(self, room: Room, state: Path) -> None:
        self._ours, theirs = pty.openpty()
        self.process = subprocess.Popen(
            room.station("props-off", "--set=link.connect_timeout_s=5"),
            stdin=theirs, stdout=theirs, stderr=theirs,
            start_new_session=True,
            env=os.environ | {"XDG_STATE_HOME": str(state)},
        )  # fmt: skip
        os.close(theirs)
        self.seen = ""
        self._read = 0

    def wait_for(self, words: str) -> None:
        wait_until(
            lambda: words in self.listen()[self._read :],
            lambda: f"no {words!r} in: {self.seen}",
        )
        self._read = self.seen.index(words, self._read) + len(words)

    def listen(self) -> str:
        """All that it has said until a tenth of a second from now."""
        if select.select([self._ours], [], [], 0.1)[0]:
            with contextlib.suppress(OSError):  # its end
                self.seen += os.read(self._ours, 4096).decode()
        return self.seen

    def types(self, line: str) -> None:
        os.write(self._ours, f"{line}\n".encode())

    def exit_code(self) -> int:
        wait_until(lambda: self.listen() and self.process.poll() is not None, lambda: self.seen)
        self.listen()
        return self.process.returncode

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        os.close(self._ours)


@contextlib.contextmanager
def at_terminal(room: Room, state: Path) -> Iterator[Terminal]:
    terminal = Terminal(room, state)
    try:
        yield terminal
    finally:
        terminal.close()


@pytest.mark.tried(1)  # ends
@pytest.mark.parametrize("how", ["Ctrl-C", "killed"])
def test_however_it_ends_the_vehicle_is_disarmed_and_nothing_is_kept(
    tmp_path: Path, how: str
) -> None:
    with served() as room, at_terminal(room, tmp_path) as terminal:
        terminal.wait_for("to begin")
        terminal.types("mqx")
        terminal.wait_for("[y/n]")
        terminal.process.send_signal(signal.SIGINT if how == "Ctrl-C" else signal.SIGKILL)
        assert terminal.exit_code() == (-signal.SIGKILL if how == "killed" else 1)
        assert not (tmp_path / "groundstation" / "props-off").exists()
        assert not armed(room)


def armed(room: Room) -> bool:
    """What the vehicle's next heartbeat says, once whoever held it has let go of the port."""
    until = time.monotonic() + 60.0
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            try:
                end.bind(("127.0.0.1", room.mavlink))
            except OSError:
                assert time.monotonic() < until, "the hand holds the port for ever"
                time.sleep(0.2)
                continue
            end.settimeout(10.0)
            codec = MavlinkCodec(9, 1)
            while True:
                for message in codec.feed(end.recv(2048)):
                    if message.get_type() == "HEARTBEAT":
                        return bool(message.base_mode & ARMED)


def test_another_name_begins_nothing_and_without_a_terminal_it_is_refused(tmp_path: Path) -> None:
    with served() as room:
        with at_terminal(room, tmp_path) as terminal:
            terminal.wait_for("to begin")
            terminal.types("yes")
            assert terminal.exit_code() == 1
            assert "Arming" not in terminal.seen
        refused = run_command(room.station("props-off"))
    assert refused.returncode == 2
    assert "needs somebody at a terminal" in refused.stderr
