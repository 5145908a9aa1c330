"""A file that survives a full disk: what can't be written yet waits in memory, up to a limit."""

import fcntl
import os
from collections.abc import Callable
from pathlib import Path

PATIENCE_BYTES = 16 << 20
"""So much may wait for room; at more, writing ends for good. About a minute and a half of flight."""


class PatientFile:
    """Binary, only to be written from its beginning to its end. Never raises once it is open."""

    def __init__(self, path: Path, tell: Callable[[str], None]) -> None:
        """Make the file, which must not exist; ``tell`` takes warnings for the operator.

        Raises:
            OSError: it can't be made.
        """
        self._path = path
        self._tell = tell
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        fcntl.flock(self._fd, fcntl.LOCK_EX)  # while it lasts, nobody tidies this file away
        self._waiting = bytearray()
        self._size = 0
        self._trouble = ""
        self._torn = False

    @property
    def alive(self) -> bool:
        """False once writing has ended."""
        return self._fd >= 0

    def write(self, data: bytes) -> int:
        """Take ``data``; it reaches the disk with :meth:`flush`."""
        self._size += len(data)
        if self.alive:
            self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Bytes taken so far."""
        return self._size

    def flush(self) -> None:
        """Hand all that waits to the operating system, as far as there is room."""
        while self._waiting and self.alive:
            try:
                written = os.write(self._fd, self._waiting)
            except OSError as error:
                self._fail(error.strerror or str(error))
                return
            del self._waiting[:written]
        if self._trouble and self.alive:
            self._trouble = ""
            self._tell(f"recording to {self._path} goes on, nothing is lost")

    def sync(self) -> None:
        """Have all that was written reach the disk itself, and tell where it did not.

        What writing takes, the operating system only keeps for the disk: that it has no room after all (a thin volume,
        a network's), or is broken, it finds out some ten seconds later, and tells whoever asks.
        """
        if not self.alive or self._torn:
            return
        try:
            os.fdatasync(self._fd)
        except OSError as error:
            self._torn = True
            why = error.strerror or str(error)
            self._tell(f"WARNING: parts of {self._path} are lost from here on, the flight goes on: {why}")

    def _fail(self, why: str) -> None:
        if not self._trouble:
            self._tell(f"WARNING: recording waits, the flight goes on: {self._path}: {why}")
        self._trouble = why
        if len(self._waiting) > PATIENCE_BYTES:
            self._tell(f"WARNING: recording has ended, the flight goes on: {self._path}: {why}")
            self._close()

    def close(self) -> None:
        """Flush, and close."""
        self.flush()
        if self._waiting:
            self._tell(f"WARNING: the end of {self._path} is missing: {self._trouble}")
        if self.alive:
            self._close()

    def _close(self) -> None:
        os.close(self._fd)
        self._fd = -1
        self._waiting.clear()
