"""The recorder stands behind the flight, and asks for long slices of the processor where the system knows them."""

import ctypes
import os
import platform
import struct
import subprocess
import sys

import pytest

from groundstation.recording.__main__ import NICE, SLICE_NS
from tests.conftest import LEFT_OUT

CHILD = """
import sys
from groundstation.recording.__main__ import stand_back
stand_back()
print(flush=True)
sys.stdin.read()
"""
SCHED_GETATTR = {"x86_64": 315, "aarch64": 275, "riscv64": 275, "armv7l": 381}


def knows_slices() -> bool:
    """Linux 6.12 and later."""
    major, minor = (int(part) for part in platform.release().split(".")[:2])
    return (major, minor) >= (6, 12) and platform.machine() in SCHED_GETATTR


def test_the_recorder_stands_behind_the_flight_by_every_means_of_the_system() -> None:
    with subprocess.Popen([sys.executable, "-c", CHILD], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        assert os.sched_getscheduler(child.pid) == os.SCHED_BATCH
        assert os.getpriority(os.PRIO_PROCESS, child.pid) == min(os.getpriority(os.PRIO_PROCESS, 0) + NICE, 19)
        if not knows_slices():
            child.kill()
            pytest.skip(LEFT_OUT + "this kernel has no slices that could be asked for")
        found = ctypes.create_string_buffer(48)
        assert ctypes.CDLL(None).syscall(SCHED_GETATTR[platform.machine()], child.pid, found, 48, 0) == 0
        assert struct.unpack("=IIQiIQQQ", found.raw)[5] == SLICE_NS
        child.kill()
