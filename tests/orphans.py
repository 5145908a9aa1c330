"""Pacers that outlive whoever started them.

Each sends disarm frames for ever, as it must to a real module.

A worker or a test that is killed leaves its pacers behind, as a station would. They are known by a
mark in their environment: the session that started them, by the process that runs it.
"""

import contextlib
import os
import signal
from pathlib import Path

MARK = "GROUNDSTATION_TEST_SESSION"
PROGRAMS = {b"links.rf.pacer_child", b"links.rf.pacer_standby"}


def mark_session() -> bool:
    """Mark all that is started from now on; False under an outer session's mark."""
    if MARK in os.environ:
        return False
    os.environ[MARK] = session_of(os.getpid())
    return True


def session_of(process: int) -> str:
    """Mark of the session of ``process``: its number, and when it began, as numbers come again."""
    try:
        begun = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[19]
        return f"{process}:{begun}"
    except OSError:
        return ""


def pacers() -> dict[int, str]:
    """Every pacer, and every stand-by, that bears a mark: its process → the session."""
    found: dict[int, str] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it ended meanwhile, or is not ours
            if not PROGRAMS.isdisjoint((folder / "cmdline").read_bytes().split(b"\0")):
                environment = (folder / "environ").read_bytes().split(b"\0")
                own = (one.decode() for one in environment if one.startswith(MARK.encode() + b"="))
                marks = [one.partition("=")[2] for one in own]
                found |= {int(folder.name): session for session in marks}
    return found


def end_orphans(over: str) -> None:
    """End the pacers of the session ``over``, and of those that did not do it themselves."""
    for process, session in pacers().items():
        runs = session_of(int(session.partition(":")[0])) == session
        if session == over or not runs:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
