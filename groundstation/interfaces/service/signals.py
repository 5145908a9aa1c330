"""Signals as requests: the first Ctrl-C or SIGTERM lands, more of them do more, SIGQUIT kills."""

import asyncio
import signal
from collections.abc import Callable

from groundstation.core.messages.requests import Ask, Reply, Request
from groundstation.core.mission.interrupts import Interrupts


def obey(
    ask: Callable[[Request], Reply], say: Callable[[str], None], on_stop: Callable[[], None] = lambda: None
) -> None:
    """Have ``ask`` do what signals mean from now on; ``on_stop`` hears of each."""
    loop = asyncio.get_running_loop()
    interrupts = Interrupts()

    def interrupted(name: str) -> None:
        on_stop()
        request, words = interrupts.press(name, loop.time())
        if request is not None:
            ask(request)
        say(words)

    def kill() -> None:
        on_stop()
        ask(Request(Ask.KILL, "told by SIGQUIT"))
        say("SIGQUIT: motors off, now")

    def hung_up() -> None:
        # A terminal that closes is no second opinion: it lands, and never more than that.
        on_stop()
        ask(Request(Ask.LAND, "the terminal closed"))

    loop.add_signal_handler(signal.SIGINT, interrupted, "SIGINT")
    loop.add_signal_handler(signal.SIGTERM, interrupted, "SIGTERM")
    loop.add_signal_handler(signal.SIGQUIT, kill)
    loop.add_signal_handler(signal.SIGHUP, hung_up)
