"""The application as a user has it: own processes, real UDP sockets, real signals, real time."""

import asyncio
import contextlib
import os
import signal
import socket as sockets
import subprocess
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from groundstation.__main__ import main
from groundstation.core.messages import Snapshot
from groundstation.interfaces.api import snapshots
from tests.e2e.stations import EXAMPLE, Room, beside, program, run_command, run_here, served


async def seen(socket: Path, until: Callable[[Snapshot], bool], within_s: float = 60.0) -> Snapshot:
    """The first snapshot on the status socket that satisfies ``until``."""
    last = ""
    async with asyncio.timeout(within_s):
        while not os.path.exists(socket):  # noqa: ASYNC240, PTH110  # a look at a local socket blocks nobody
            await asyncio.sleep(0.05)
        while True:
            # It is there a moment before somebody listens.
            with contextlib.suppress(ConnectionRefusedError):
                async for snapshot in snapshots(socket):
                    if until(snapshot):
                        return snapshot
                    last = f"{snapshot.state}, {snapshot.reason}"
                raise AssertionError(f"the status socket went away first; last seen: {last}")
            await asyncio.sleep(0.05)


def flying(room: Room, *arguments: str) -> AbstractContextManager["subprocess.Popen[str]"]:
    """A flight that half a second of a busy machine does not end: other tests look at that."""
    command = room.station("fly", "--arm", "mqx", "--set", "flight.coast_s=0.7", *arguments)
    return beside(command, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL)


def test_a_terminal_that_closes_in_flight_lands_the_vehicle() -> None:
    # So slowly that a landing is seen on a machine that keeps everybody waiting.
    with served() as room, flying(room, "--set", "flight.descent_m_s=0.3") as station:
        closed_s: list[float] = []

        def is_landing(snapshot: Snapshot) -> bool:
            """Close the terminal on the way: a listener that begins at the landing may be late."""
            assert station.stdout is not None
            if not closed_s and snapshot.state == "tracking" and snapshot.flight_time_s > 1.0:
                closed_s.append(snapshot.flight_time_s)
                station.stdout.close()  # whatever it says from now on fails
                station.send_signal(signal.SIGINT)
            return snapshot.state == "landing"

        asyncio.run(seen(room.status_socket, is_landing))
        assert closed_s, "it landed by itself"
        station.send_signal(signal.SIGHUP)
        assert station.wait(60) == 0


@pytest.mark.tried(2)  # SIGUSR2 is taken as SIGUSR1 is
@pytest.mark.parametrize("number", [signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM])
def test_ctrl_z_does_not_freeze_what_flies_and_signals_that_end_programs_land_it(
    number: signal.Signals,
) -> None:
    with served() as room, flying(room) as station:
        frozen_s: list[float] = []

        def flies_on(snapshot: Snapshot) -> bool:
            if not frozen_s and snapshot.state == "tracking":
                frozen_s.append(snapshot.flight_time_s)
                station.send_signal(signal.SIGTSTP)
            return bool(frozen_s) and snapshot.flight_time_s > frozen_s[0] + 0.5

        asyncio.run(seen(room.status_socket, flies_on))
        station.send_signal(number)
        told, _ = station.communicate(timeout=60)
        assert "Ctrl-Z is ignored" in told
        assert f"{number.name}: asked to land" in told
        assert station.returncode == 0


def test_fly_does_not_arm_without_a_terminal_or_under_a_wrong_name() -> None:
    for arguments, expected in (([], "needs --arm mqx"), (["--arm", "other"], "expected 'mqx'")):
        run = run_here(main, "fly", EXAMPLE, *arguments)
        assert run.returncode == 2
        assert expected in run.stderr


def test_a_pose_source_that_cant_be_started_is_told_in_words(tmp_path: Path) -> None:
    with sockets.socket(sockets.AF_INET, sockets.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        config = tmp_path / "lab.toml"
        config.write_text(f'[pose]\nkind = "json"\nlisten = "127.0.0.1:{taken.getsockname()[1]}"\n')
        words = ("fly", config, "--arm", "mqx", "--set", f"status.path={tmp_path}/mqx.sock")
        run = run_command(program("groundstation", *words))
    assert run.returncode == 1
    assert "cannot listen for JSON poses on 127.0.0.1:" in run.stdout
    assert "Traceback" not in run.stderr
