"""What is typed in a terminal, whatever bytes come: no key, paste or line noise may take the kill key away."""

import codecs
from functools import partial
from typing import Any

from textual import constants
from textual.driver import Driver
from textual.drivers import linux_driver


def _replacing(encoding: str) -> Any:
    """As codecs.getincrementaldecoder; bytes that mean nothing become U+FFFD, a key that nothing is bound to."""
    return partial(codecs.getincrementaldecoder(encoding), errors="replace")


# Textual's input thread makes a strict decoder by this name and has no other way to be given one.
setattr(linux_driver, "getincrementaldecoder", _replacing)  # noqa: B010  # not exported


class TolerantDriver(linux_driver.LinuxDriver):
    """Textual's own, whose input outlives what it can't make sense of."""

    def run_input_thread(self) -> None:
        """Wait for input until told to end; where Textual fails at what came, begin again with what comes next."""
        while not self.exit_event.is_set():
            try:
                super().run_input_thread()
            except (ValueError, OverflowError):  # for example a key of a number that no character has
                continue
            return  # an OSError is a terminal that is gone


def driver_class() -> type[Driver] | None:
    """What an App shall read its terminal with; None where Textual was told another one (as for a browser)."""
    return None if constants.DRIVER else TolerantDriver
