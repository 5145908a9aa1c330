"""A pseudo-terminal in the place of a serial port, for whoever opens ports by their path."""

import asyncio
import contextlib
import os
import tempfile
import termios
import tty
from collections.abc import Callable
from pathlib import Path


class PtyWire:
    """The far end of a port; the near end's path is ``path``.

    The path is of its own. The system's name for the terminal belongs to somebody else's soon after this one is
    closed; a link that opens its port again and again, as all do, would write into that.
    """

    def __init__(self) -> None:
        self._far, self._near = os.openpty()
        tty.setraw(self._near, termios.TCSANOW)
        os.set_blocking(self._far, False)
        self._folder = tempfile.TemporaryDirectory(prefix="groundstation-port-")
        self.path = str(Path(self._folder.name) / "port")
        Path(self.path).symlink_to(os.ttyname(self._near))

    def listen(self, take: Callable[[bytes], None]) -> None:
        """Call ``take`` with whatever is written to the port, until closed."""

        def readable() -> None:
            try:
                data = os.read(self._far, 4096)
            except OSError:
                return
            take(data)

        asyncio.get_running_loop().add_reader(self._far, readable)

    def fileno(self) -> int:
        """The far end's file descriptor."""
        return self._far

    def say(self, data: bytes) -> None:
        """Let the module say something; what does not fit is lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._far, data)

    def close(self) -> None:
        """Pull the plug; the path goes away."""
        if self._far >= 0:
            self._folder.cleanup()
            asyncio.get_running_loop().remove_reader(self._far)
            os.close(self._near)
            os.close(self._far)
            self._far = self._near = -1
