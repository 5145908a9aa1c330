"""tests/orphans.py: pacers of a test that was killed end, those of a session that runs stay."""

import os
import subprocess
import sys
import time

from tests.orphans import MARK, end_orphans, pacers, session_of

KILLED = """
import asyncio, os, pty
from links.rf.module_codec import DsmLinkConfig
from links.rf.pacer_process import open_process

async def main():
    port = os.ttyname(pty.openpty()[1])
    await open_process(DsmLinkConfig(port=port, fifo_priority=0), 2.0, lambda report: None)
    os.kill(os.getpid(), 9)

asyncio.run(main())
"""


def of_session(session: str) -> list[int]:
    """The pacer and the stand-by that a process of ``session`` leaves behind when it is killed."""
    done = subprocess.run([sys.executable, "-c", KILLED], env=os.environ | {MARK: session}, timeout=60, check=False)
    assert done.returncode == -9
    return [process for process, its in pacers().items() if its == session]


def are_gone(*processes: int) -> None:
    limit = time.monotonic() + 60.0
    while any(process in pacers() for process in processes):
        assert time.monotonic() < limit, "one outlives its session"
        time.sleep(0.02)


def test_pacers_of_sessions_that_are_dead_or_over_are_ended_and_those_of_one_that_runs_are_not() -> None:
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as other:
        runs = session_of(other.pid)
        dead, alive = of_session(f"{other.pid}:1"), of_session(runs)
        assert len(dead) == len(alive) == 2
        try:
            end_orphans("")  # ours goes on, with other tests beside this one
            are_gone(*dead)
            assert [pacers()[each] for each in alive] == [runs, runs]
            end_orphans(runs)
            are_gone(*alive)
        finally:
            other.kill()
