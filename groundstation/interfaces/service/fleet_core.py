"""Fleet core: one vehicle's process. Where the supervisor dies it gets SIGHUP, as from a closed terminal, and lands."""

import ctypes
import os
import runpy
import signal
import sys

PR_SET_PDEATHSIG = 1
"""Number of Linux: the signal that comes when the parent dies (prctl(2))."""


def main() -> int:
    """``SUPERVISOR_PID COMMAND …``: the command as ``groundstation`` runs it."""
    supervisor = int(sys.argv.pop(1))
    prctl = getattr(ctypes.CDLL(None), "prctl", None)  # Linux has it; elsewhere a core outlives its supervisor
    if prctl is not None:
        prctl(PR_SET_PDEATHSIG, int(signal.SIGHUP))
    if os.getppid() != supervisor:  # it died before
        return 1
    runpy.run_module("groundstation", run_name="__main__", alter_sys=True)  # which exits by itself
    return 0


if __name__ == "__main__":
    sys.exit(main())
