"""A simulated flight begun, armed, left and landed from the dashboard, in real terminals."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from groundstation.interfaces.tui.drawing import big
from tests.e2e.stations import Room, served
from tests.e2e.test_tui import Terminal


@pytest.fixture
def terminals(needs_program: Callable[..., str], tmp_path: Path) -> Iterator[list[Terminal]]:
    made = []
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        made.append(Terminal(needs_program("tmux"), tmp_path / name))
    yield made
    for one in made:
        one.close()


def processes(words: str) -> dict[int, str]:
    """The processes whose command line holds ``words``, by their ids."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it ended meanwhile
            args = (
                (folder / "cmdline")
                .read_bytes()
                .rstrip(b"\0")
                .replace(b"\0", b" ")
                .decode("utf-8", "replace")
            )
            if words in args:
                found[int(folder.name)] = args
    return found


@contextmanager
def flown_in_a_room() -> Iterator[Room]:
    """A room; whatever still flies in it afterwards is stopped."""
    with served() as room:
        try:
            yield room
        finally:
            for pid, args in processes(str(room.status_socket)).items():
                if " daemon " in args:
                    os.kill(pid, signal.SIGKILL)


def test_a_flight_outlives_its_dashboard_and_lands_from_another_one(
    terminals: list[Terminal],
) -> None:
    first, second = terminals
    with flown_in_a_room() as room:
        first.start(*room.station("fly", "--tui"))
        first.wait_for(*big("ready"), "you hold control")
        first.type("a")
        first.wait_for("Type its name")
        first.type("mqx")
        first.type("Enter")
        first.wait_for(*big("tracking"))
        ours = processes(str(room.status_socket))
        core = next(pid for pid, args in ours.items() if " daemon " in args)
        screen = next(
            pid
            for pid, args in ours.items()
            if " --tui" in args and args.startswith(sys.executable)
        )
        os.kill(screen, signal.SIGKILL)
        second.start(sys.executable, "-m", "groundstation", "tui", "--socket", room.status_socket)
        second.wait_for(*big("tracking"), "control is free", "held control")
        second.type("?")
        second.wait_for("twice within 1 s")
        second.type("C-d")  # the second key of it: no multiplexer takes that
        second.wait_for("landing", "told by tui")
        second.type("Escape")
        second.wait_for(*big("landed"))
        second.type("q")
        second.wait_for("left with 0")
        log = (room.recordings / "mqx.log").read_text()
        assert "landed and disarmed" in log
        assert core not in processes(str(room.status_socket))


def test_a_core_that_ends_by_itself_is_told_on_the_screen_and_after_it(
    terminals: list[Terminal],
) -> None:
    with flown_in_a_room() as room:
        nobody = ("--set", "pose.object=nobody", "--set", "flight.pose_wait_s=1")
        terminals[0].start(*room.station("fly", "--tui", *nobody))
        terminals[0].wait_for(*big("aborted"), "no pose within 1 s")
        terminals[0].type("q")
        terminals[0].wait_for(
            "has ended", "mqx aborted: no pose within 1 s", "mqx.log", "left with 1"
        )


FAILING = """
from groundstation.__main__ import main
from groundstation.interfaces.tui.app import Dashboard

def fail(_):
    raise RuntimeError("of the test")

Dashboard.action_keys = fail
raise SystemExit(main())
"""
"""A program whose dashboard fails where the operator asks for its keys."""


def test_a_dashboard_that_fails_begins_anew_while_its_flight_goes_on(
    terminals: list[Terminal],
) -> None:
    with flown_in_a_room() as room:
        python, _, _, *words = room.station("fly", "--tui")
        terminals[0].start(python, "-c", FAILING, *words)
        terminals[0].wait_for(*big("ready"), "you hold control")
        core = [
            pid for pid, args in processes(str(room.status_socket)).items() if " daemon " in args
        ]
        terminals[0].type("?")
        terminals[0].wait_for(
            "has failed and begins", f"process {core[0]}", *big("ready"), "you hold control"
        )
        terminals[0].type("q")
        terminals[0].wait_for("has ended", "left with")
