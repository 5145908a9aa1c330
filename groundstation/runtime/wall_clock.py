"""What the wall clock of this machine shows; the only file of telemetry that reads it.

The event loop's clock means nothing to another machine, and whether a request has expired is agreed between two.
"""

import time


def wall_ms() -> int:
    """Time since 1970 [ms]."""
    return time.time_ns() // 1_000_000
