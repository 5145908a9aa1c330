"""Bytes that leave on a pseudo-terminal, stamped by a process that no test keeps busy."""

import asyncio
import os
import struct
import sys
from typing import Self

_PROGRAM = """
import os, struct, sys, time
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))
except OSError:
    pass
while True:
    try:
        data = os.read(int(sys.argv[1]), 4096)
    except OSError:
        break
    os.write(1, struct.pack("=dI", time.monotonic(), len(data)) + data)
"""
_HEAD = struct.Struct("=dI")


class StampedReader:
    """The far end of a pseudo-terminal, read by a process that was started for it."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def start(cls, far: int) -> Self:
        """Read from the descriptor ``far`` from now on."""
        os.set_blocking(far, True)
        return cls(
            await asyncio.create_subprocess_exec(
                *(sys.executable, "-S", "-c", _PROGRAM, str(far)),
                stdout=asyncio.subprocess.PIPE,
                pass_fds=[far],
            )
        )

    async def read(self) -> tuple[float, bytes]:
        """When something was read, on the monotonic clock [s], and what.

        Raises:
            EOFError: the last process has closed the near end.
        """
        stream = self._process.stdout
        assert stream is not None
        time_s, size = _HEAD.unpack(await stream.readexactly(_HEAD.size))
        return time_s, await stream.readexactly(size)

    async def close(self) -> None:
        """End the process."""
        if self._process.returncode is None:
            self._process.kill()
        await self._process.wait()
