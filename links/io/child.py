"""Child: a process that runs one of our own modules, and how it is started."""

import signal
import subprocess
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    import asyncio
    from typing import Any


def make_child_command(module: str, *words: str) -> list[str]:
    """Run ``module`` (``links.rf.pacer_child``) of this very installation, by this very Python,
    with ``words`` for it.

    A file or a folder `links`, `groundstation` or `sim` where the operator happens to stand is not
    ours, nor is one on PYTHONPATH.
    """
    return [sys.executable, "-P", "-m", "groundstation.runtime.launch", module, *words]


def start_child(
    module: str, *words: str, apart: bool = True, **wires: "Any"
) -> "subprocess.Popen[bytes]":
    """Start ``module`` with ``words``.

    It takes a millisecond, so an event loop may do it on the ground.

    ``apart`` gives it a session of its own: what a terminal sends does not reach it. ``wires`` are
    what else :class:`subprocess.Popen` takes; with nothing of it there is no standard input, and
    output is that of its parent.
    """
    wires = {"stdin": subprocess.DEVNULL, **wires}
    return subprocess.Popen(make_child_command(module, *words), start_new_session=apart, **wires)  # noqa: S603  # ours


async def open_child(
    module: str, *words: str, apart: bool = True, **wires: "Any"
) -> "asyncio.subprocess.Process":
    """Start a child for an event loop.

    Standard output is a pipe, unless ``wires`` say otherwise.
    """
    import asyncio  # a pacer, which starts a child too, has no event loop

    wires = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, **wires}
    return await asyncio.create_subprocess_exec(
        *make_child_command(module, *words), start_new_session=apart, **wires
    )


def describe_exit(code: int) -> str:
    """Describe how a process ended, by its ``code`` as :class:`subprocess.Popen` has it."""
    if code >= 0:
        return f"exit code {code}"
    named = {number.value: number.name for number in signal.Signals}
    return named.get(-code, f"signal {-code}")  # real-time signals have no name
