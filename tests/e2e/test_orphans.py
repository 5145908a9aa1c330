"""tests/orphans.py: pacers of a test that was killed end, those of a session that runs stay."""

import os
import subprocess
import sys
import time
from pathlib import Path

from tests.orphans import MARK, end_orphans, pacers, session_of

KILLED = """
import asyncio, os, pathlib, sys
from links.rf import DsmLinkConfig
from links.rf.pacer_process import open_process
from sim.radio import PtyWire

async def main():
    wire = PtyWire(pathlib.Path(sys.argv[1]))
    await open_process(DsmLinkConfig(port=wire.path, fifo_priority=0), 2.0, lambda report: None)
    os.kill(os.getpid(), 9)

asyncio.run(main())
"""


def of_session(session: str, port: Path) -> list[int]:
    """The pacer and the stand-by that a process of ``session`` leaves behind when it is killed."""
    command = [sys.executable, "-c", KILLED, str(port)]
    done = subprocess.run(command, env=os.environ | {MARK: session}, timeout=60, check=False)
    assert done.returncode == -9
    return [process for process, its in pacers().items() if its == session]


def are_gone(*processes: int) -> None:
    limit = time.monotonic() + 60.0
    while any(process in pacers() for process in processes):
        assert time.monotonic() < limit, "one outlives its session"
        time.sleep(0.02)


def test_pacers_of_sessions_that_are_dead_or_over_are_ended_and_those_of_one_that_runs_are_not(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as other:
        runs = session_of(other.pid)
        dead, alive = of_session(f"{other.pid}:1", tmp_path / "dead"), of_session(runs, tmp_path / "alive")
        assert len(dead) == len(alive) == 2
        try:
            end_orphans("")  # ours goes on, with other tests beside this one
            are_gone(*dead)
            assert [pacers()[each] for each in alive] == [runs, runs]
            end_orphans(runs)
            are_gone(*alive)
        finally:
            other.kill()
