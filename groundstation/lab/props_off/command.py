"""What ``groundstation props-off`` does: ask, test with the vehicle's lock held, and keep what was proven."""

import asyncio
import contextlib
import signal
import sys
from datetime import UTC, datetime

from groundstation.config import ConfigError
from groundstation.flight import Proof, digest, line_from_terminal, place, save
from groundstation.lab.props_off.process import open_hand
from groundstation.lab.props_off.steps import Guide, NotProven, Trouble
from groundstation.runtime import ApiError, Exit, Taken, lock_path, only_one, precise_loop, socket_path
from groundstation.settings import Config

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)

BEFORE = """\
THE MOTORS OF {name} WILL START, several times. Its propellers must be OFF: take them off now.
Hold the vehicle down, keep fingers, hair and cables away, and have its battery plug and the remote control at hand.
Thrust is never more than idling. Ctrl-C at any time orders the motors off and ends the test.
"""


def props_off_command(config: Config, now_s: float) -> int:
    """The test of the vehicle of ``config``; ``now_s`` is the wall time at its beginning [s since 1970].

    Raises:
        ConfigError: nobody sits at a terminal, or what was proven can't be kept.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise ConfigError("props-off", "motors will turn: it needs somebody at a terminal, and can't be scripted")
    try:
        with (
            only_one(lock_path(socket_path(config.status, config.vehicle.name)), config.vehicle.name),
            asyncio.Runner(loop_factory=precise_loop) as runner,
        ):
            return runner.run(_guided(config, now_s))
    except Taken as error:
        print(f"groundstation: {error}", file=sys.stderr)
        return Exit.TAKEN
    except ApiError as error:
        raise ConfigError("status.path", str(error)) from None


async def _guided(config: Config, now_s: float) -> int:
    loop, guided = asyncio.get_running_loop(), asyncio.current_task()
    assert guided is not None, "this is a task"
    for number in SIGNALS:  # the motors are ordered off first, whatever wants this to end
        loop.add_signal_handler(number, guided.cancel)
    began_s, name = loop.time(), config.vehicle.name
    guide = Guide(config, open_hand, line_from_terminal, _say)
    try:
        _say(BEFORE.format(name=name))
        if (await line_from_terminal(f"Propellers off? Type the vehicle's name, {name}, to begin: ")).strip() != name:
            _say("Nothing was begun.")
            return Exit.FAULT
        steps = await guide.run()
    except NotProven as error:
        _say(f"\nNOT PROVEN: {error}. Do not fly before this test is passed.")
        return Exit.FAULT
    except Trouble as error:
        _say(f"\nThe test can't go on: {error}. Nothing was kept.")
        return Exit.FAULT
    except asyncio.CancelledError:
        _say("\nInterrupted. Nothing was kept.")
        return Exit.FAULT
    date = datetime.fromtimestamp(now_s + loop.time() - began_s, tz=UTC).isoformat(timespec="seconds")
    path = place(config)
    try:
        save(Proof(vehicle=name, digest=digest(config), firmware=guide.firmware, date=date, steps=steps), path)
    except OSError as error:
        raise ConfigError("props-off", f"passed, but {path} can't be written: {error.strerror}") from None
    _say(f"\nPassed. Kept in {path}, for this vehicle, configuration and firmware ({guide.firmware or 'not told'}).")
    return Exit.DONE


def _say(line: str) -> None:
    with contextlib.suppress(OSError):  # a terminal that is gone: its hang-up ends the test
        print(line, flush=True)
