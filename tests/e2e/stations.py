"""Real processes on real loopback sockets: a simulated vehicle served by one, flown by another."""

import io
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.known import known

EXAMPLE = Path(__file__).parents[2] / "examples" / "loopback.toml"
QUICK_LANDING = ["--set=flight.descent_m_s=1.0", "--set=trajectory.altitude_m=-0.3"]


def run_here(main: Callable[[], int], *words: str | Path) -> "subprocess.CompletedProcess[str]":
    """Exit code and output of a program that is run in this process, without a terminal."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(out), redirect_stderr(err):
        patched.setattr("sys.argv", ["program", *map(str, words)])
        patched.setattr("sys.stdin", io.StringIO())
        try:
            code = main()
        except SystemExit as end:  # of a parser
            code = int(end.code or 0)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def program(*words: str | Path) -> list[str]:
    """The command line of ``python -m WORDS``."""
    return [sys.executable, "-m", *map(str, words)]


def run_command(command: Sequence[str | Path], **more: Any) -> "subprocess.CompletedProcess[str]":
    """Run a process to its end, a minute at most, with an empty standard input."""
    usual = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.run(command, **usual | more, text=True, timeout=60, check=False)


@contextmanager
def beside(command: Sequence[str | Path], **more: Any) -> Iterator["subprocess.Popen[str]"]:
    """A process whose output is to be read; whatever has become of it, it ends with this."""
    with subprocess.Popen(command, **{"stdout": subprocess.PIPE, "text": True} | more) as process:
        try:
            yield process
        finally:
            process.terminate()


def line_of(process: "subprocess.Popen[str]") -> str:
    """The next line that it says."""
    return known(process.stdout).readline()


@contextmanager
def serving(*words: str | Path, **more: Any) -> Iterator[str]:
    """``groundstation-sim serve WORDS``; its first line, which says what it serves."""
    with beside(program("sim", "serve", *words), **more) as server:
        yield line_of(server)


def wait_until(true: Callable[[], object], says: Callable[[], object] = str) -> None:
    """Wait until it is true; after a minute the test fails with what it ``says``."""
    limit_s = time.monotonic() + 60.0
    while not true():
        assert time.monotonic() < limit_s, says()
        time.sleep(0.02)


def free_udp_port() -> int:
    """A UDP port that nobody uses at this moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def children_of(process: int) -> list[int]:
    """The processes that it has started."""
    children = Path(f"/proc/{process}/task/{process}/children").read_text("utf-8")
    return [int(child) for child in children.split()]


@dataclass
class Room:
    """Where one vehicle, its cameras and its ground station meet."""

    folder: Path
    mavlink: int = field(default_factory=free_udp_port)
    vicon: int = field(default_factory=free_udp_port)

    @property
    def status_socket(self) -> Path:
        """Where the ground station publishes its status."""
        return self.folder / "status.sock"

    @property
    def recordings(self) -> Path:
        """Where the ground station records its flights."""
        return self.folder / "flights"

    @property
    def wires(self) -> list[str]:
        """The overrides that make both ends meet."""
        ends = (f"link.listen=127.0.0.1:{self.mavlink}", f"pose.listen=127.0.0.1:{self.vicon}")
        return [f"--set={end}" for end in ends]

    def station(self, command: str, *arguments: str) -> list[str]:
        """The command line of ``groundstation fly`` or ``daemon`` in this room."""
        folders = (f"status.path={self.status_socket}", f"recording.folder={self.recordings}")
        sets = [*self.wires, *QUICK_LANDING, *(f"--set={to}" for to in folders)]
        return program("groundstation", command, EXAMPLE, *sets, *arguments)


@contextmanager
def served() -> Iterator[Room]:
    """A room with a simulated vehicle in it."""
    with tempfile.TemporaryDirectory(prefix="gs-") as folder:
        room = Room(Path(folder))
        with serving("paper", *room.wires, "--duration", "100") as says:
            assert "serving" in says
            yield room
