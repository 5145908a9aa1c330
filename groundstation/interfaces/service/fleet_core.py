"""Fleet core: one vehicle's process.

Where the supervisor dies it gets SIGHUP, as from a closed terminal, and lands.
"""

import runpy
import signal
import sys

from groundstation.machine import follow_parent
from groundstation.runtime import Exit


def main() -> Exit:
    """``SUPERVISOR_PID COMMAND …``: the command as ``groundstation`` runs it."""
    if not follow_parent(int(sys.argv.pop(1)), signal.SIGHUP):
        return Exit.FAILED
    runpy.run_module("groundstation", run_name="__main__", alter_sys=True)  # which exits by itself
    return Exit.DONE


if __name__ == "__main__":
    sys.exit(main())
