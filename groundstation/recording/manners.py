"""How the recorder shares the processor with the flight that has started it: it gets its share, and never first."""

import contextlib
import ctypes
import os
import platform
import struct

NICE = 5
"""By so much the recorder stands behind what flies (nice(2))."""
SLICE_NS = 20_000_000
"""It asks for as long slices of the processor as this, and so for few [ns].

Whoever wakes up and asks for shorter ones, as everybody does who does not ask, then need not wait until its slice of
some milliseconds is used up (Linux 6.12 and later, sched(7) and sched_setattr(2); earlier ones pay no heed). Its share
stays the same: on a machine that is busy it writes as much as ever.
"""
_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274, "riscv64": 274, "armv7l": 380}
"""The number of the system call; the C library has had no function for it for long."""
_ATTRIBUTES = struct.Struct("=IIQiIQQQ")
"""struct sched_attr: size, policy, flags, nice, priority; slice, deadline and period [ns]."""


def stand_back() -> None:
    """Let the flight go first, as far as the system has means for it."""
    nice = os.nice(NICE)
    with contextlib.suppress(OSError):  # woken up by the flight's writing, it must not take the processor from it
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    number = _SCHED_SETATTR.get(platform.machine())
    if number is not None:
        attributes = _ATTRIBUTES.pack(_ATTRIBUTES.size, os.SCHED_BATCH, 0, nice, 0, SLICE_NS, 0, 0)
        ctypes.CDLL(None).syscall(number, 0, attributes, 0)  # where it is refused, all is as before
