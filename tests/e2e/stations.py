"""Real processes on real loopback sockets: a simulated vehicle served by one, flown by another."""

import io
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "loopback.toml"
QUICK_LANDING = ["--set", "flight.descent_m_s=1.0", "--set", "trajectory.altitude_m=-0.3"]


def run_here(main: Callable[[], int], *words: str | Path) -> "subprocess.CompletedProcess[str]":
    """How a program ends and what it prints without a terminal, in this process: it starts no Python of its own."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(out), redirect_stderr(err):
        patched.setattr("sys.argv", ["program", *map(str, words)])
        patched.setattr("sys.stdin", io.StringIO())
        try:
            code = main()
        except SystemExit as end:  # of a parser
            code = int(end.code or 0)
    return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())


def free_udp_port() -> int:
    """A UDP port that nobody uses at this moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def children_of(process: int) -> list[int]:
    """The processes that it has started."""
    return [int(child) for child in Path(f"/proc/{process}/task/{process}/children").read_text("utf-8").split()]


@dataclass
class Room:
    """Where one vehicle, its cameras and its ground station meet."""

    folder: Path
    mavlink: int = field(default_factory=free_udp_port)
    vicon: int = field(default_factory=free_udp_port)
    server: "subprocess.Popen[str] | None" = None
    """The simulated side, to be frozen or killed."""

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
        return [
            *("--set", f"link.listen=127.0.0.1:{self.mavlink}"),
            *("--set", f"pose.listen=127.0.0.1:{self.vicon}"),
        ]

    def station(self, command: str, *arguments: str) -> list[str]:
        """The command line of ``groundstation fly`` or ``daemon`` in this room."""
        return [
            *(sys.executable, "-m", "groundstation", command, str(EXAMPLE), *self.wires, *QUICK_LANDING),
            *("--set", f"status.path={self.status_socket}", "--set", f"recording.folder={self.recordings}", *arguments),
        ]


REFUSING = """
import sys
from sim.autopilots import SimulatedAutopilot
from sim.__main__ import main

SimulatedAutopilot.lacks = property(lambda _: {says!r}, lambda *_: None)
sys.exit(main())
"""
"""A program that serves an autopilot which refuses to arm, in these words."""


@contextmanager
def served(scenario: str = "paper", *, says: str = "") -> Iterator[Room]:
    """A room with a simulated vehicle in it; with ``says``, one that refuses to arm and says this."""
    program = ["-c", REFUSING.format(says=says)] if says else ["-m", "sim"]
    with tempfile.TemporaryDirectory(prefix="gs-") as folder:
        room = Room(Path(folder))
        server = subprocess.Popen(
            [sys.executable, *program, "serve", scenario, *room.wires, "--duration", "100"],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert server.stdout is not None
            assert "serving" in server.stdout.readline()
            room.server = server
            yield room
        finally:
            server.terminate()
            server.wait(60)
            assert server.stdout is not None
            server.stdout.close()
