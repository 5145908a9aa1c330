"""Flights in real time: alone in a terminal, or as a daemon.

Signals are requests: the first Ctrl-C or SIGTERM lands, more of them do more, SIGQUIT kills.
"""

import asyncio
import gc
import logging
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Coroutine

from groundstation.config import ConfigError
from groundstation.core.messages import Ask, Reply, Request, SourceError
from groundstation.core.mission import Interrupts, State
from groundstation.flight import entry_of, make_ends
from groundstation.interfaces.service.crew import watched
from groundstation.interfaces.service.daemon import Daemon
from groundstation.interfaces.service.logs import Format, Lines, is_journal, level_of
from groundstation.interfaces.service.notify import Notify
from groundstation.recording import make_flight, recorder
from groundstation.runtime import (
    ApiError,
    Exit,
    Quiet,
    Taken,
    lock_path,
    only_one,
    precise_loop,
    registered,
    running,
    socket_path,
)
from groundstation.settings import Config
from links.core import LinkError


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


Say = Callable[[str], None]


def fly_command(config: Config, confirm: Callable[[], Awaitable[bool]], say: Say) -> Exit:
    """One flight, with the lock of its vehicle held."""
    try:
        with only_one(lock_path(socket_path(config.status, config.vehicle.name)), config.vehicle.name):
            logging.getLogger().addHandler(Lines(2, Format.TEXT, journal=False))
            with registered(entry_of(config, "fly", os.getpid())):
                return _run(_fly(config, confirm, say))
    except Taken as error:
        print(f"groundstation: {error}", file=sys.stderr)
        return Exit.TAKEN
    except ApiError as error:
        raise ConfigError("status.path", str(error)) from None


async def _fly(config: Config, confirm: Callable[[], Awaitable[bool]], say: Say) -> Exit:
    """Fly until landed or aborted, and land on the first signal."""
    quiet = Quiet()
    async with recorder(config, say, quiet) as give:
        flight = make_flight(config, confirm=confirm, on_event=say, give=give, quiet=quiet, running=running)
        obey(flight.ask, say)
        calm_memory()
        try:
            outcome = await watched(flight, config, say, quiet)
        except SourceError:  # ``say`` has told
            return Exit.FAULT
        return Exit.DONE if outcome.state is State.LANDED and not outcome.fault else Exit.FAULT


def daemon_command(config: Config, *, arm: bool, once: bool, style: Format) -> Exit:
    """Flights until a signal comes, with the lock of the vehicle held; log lines to stderr.

    Raises:
        ConfigError: ``arm`` under a service manager, which might start it again and again.
    """
    if arm and "NOTIFY_SOCKET" in os.environ:
        raise ConfigError(
            "--arm",
            "a service never arms by itself, as it may be started again at any time: start it without, then "
            f"`groundstation request arm --vehicle {config.vehicle.name}`",
        )
    make_ends(config)  # what it names must go together, before anything is opened
    log = logging.getLogger("groundstation")
    log.setLevel(logging.INFO)
    number = sys.stderr.fileno()
    logging.getLogger().addHandler(Lines(number, style, journal=is_journal(number)))
    try:
        with (
            only_one(lock_path(socket_path(config.status, config.vehicle.name)), config.vehicle.name),
            registered(entry_of(config, "daemon", os.getpid())),
        ):
            return _run(_serve(config, lambda line: log.log(level_of(line), "%s", line), arm=arm, once=once))
    except (Taken, ApiError) as error:
        log.error("%s", error)
        return Exit.TAKEN
    except (SourceError, LinkError, OSError) as error:
        log.error("%s", error)
        return Exit.FAULT


async def _serve(config: Config, say: Say, *, arm: bool, once: bool) -> Exit:
    daemon = Daemon(config, say, Notify(), arm=arm, once=once)
    obey(daemon.ask, say, daemon.stop)
    calm_memory()
    return await daemon.run()


def _run(work: Coroutine[None, None, Exit]) -> Exit:
    with asyncio.Runner(loop_factory=precise_loop) as runner:
        return runner.run(work)


def calm_memory() -> None:
    """No long garbage collection in flight: what start-up made is never looked at again, whole sweeps are rare."""
    gc.collect()
    gc.freeze()
    young, middle, _ = gc.get_threshold()
    gc.set_threshold(young, middle, 1000)
