"""A pseudo-terminal in the place of a serial port, for whoever opens ports by their path."""

import asyncio
import contextlib
import os
import tty
from collections.abc import Callable


class PtyWire:
    """The far end of a port; the near end's path is ``path``."""

    def __init__(self) -> None:
        self._far, self._near = os.openpty()
        tty.setraw(self._near)
        os.set_blocking(self._far, False)
        self.path = os.ttyname(self._near)

    def listen(self, take: Callable[[bytes], None]) -> None:
        """Call ``take`` with whatever is written to the port, until closed."""

        def readable() -> None:
            try:
                data = os.read(self._far, 4096)
            except OSError:
                return
            take(data)

        asyncio.get_running_loop().add_reader(self._far, readable)

    def say(self, data: bytes) -> None:
        """Let the module say something; what does not fit is lost."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._far, data)

    def close(self) -> None:
        """Pull the plug; the path goes away."""
        if self._far >= 0:
            asyncio.get_running_loop().remove_reader(self._far)
            os.close(self._near)
            os.close(self._far)
            self._far = self._near = -1
