"""``groundstation stop-all``: every flight of this user on this machine, at once and without a broker."""

import argparse
import asyncio
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from groundstation.config import ConfigError
from groundstation.core.messages import Ask, Request
from groundstation.interfaces.api.client import attached
from groundstation.runtime import BRIDGE, ApiError, Running, owner, running, send, strangers
from links.core import printable

ANSWER_S = 1.0
"""Who has not answered by then gets a signal [s]."""
EXIT_DONE, EXIT_UNANSWERED = 0, 1


class Told(msgspec.Struct, frozen=True):
    """What became of one of them."""

    answered: bool
    says: str
    """A line for the operator, with its name."""


async def stop_all(ask: Ask, why: str = "stop-all") -> list[Told]:
    """Ask all that run to come down by ``ask``, each on its own: none waits for another that hangs."""
    return list(await asyncio.gather(*(_stop(one, ask, why) for one in running())))


async def _stop(one: Running, ask: Ask, why: str) -> Told:
    who = f"{one.vehicle} (process {one.pid})"
    if one.command == BRIDGE:
        return _bridge(one, ask)
    try:
        async with asyncio.timeout(ANSWER_S), attached(Path(one.socket), "stop-all") as client:
            answer = await client.ask(Request(ask, why))
        return Told(True, f"{who}: {answer.says}")
    except TimeoutError:
        trouble = f"no answer within {ANSWER_S:g} s"
    except ApiError as error:
        trouble = str(error)
    except OSError as error:
        trouble = f"its socket {one.socket}: {error.strerror or error}"
    number = signal.SIGQUIT if ask is Ask.KILL else signal.SIGTERM
    if not send(one, number):
        return Told(True, f"{who}: {trouble}, and it has ended")
    means = "motors off" if number is signal.SIGQUIT else "lands"
    return Told(
        False,
        f"{who}: NOT ANSWERED: {trouble}; {number.name} sent ({means} as soon as it runs): take the remote control "
        "and see that it comes down",
    )


def _bridge(one: Running, ask: Ask) -> Told:
    """A bridge is not asked to land: what flies by it lands by its own station's commands."""
    who = f"{BRIDGE} at {one.vehicle} (process {one.pid})"
    if ask is Ask.KILL:
        done = send(one, signal.SIGQUIT)
        return Told(done, f"{who}: " + ("SIGQUIT sent: motors off" if done else "it has ended"))
    return Told(
        True,
        f"{who}: goes on, as what flies by it lands by its station's commands. kill {one.pid} ends it and brings down "
        f"what flies; kill -QUIT {one.pid} stops its motors",
    )


def stop_all_command(args: argparse.Namespace, ask_back: Callable[[str], str] | None) -> int:
    """Ask, print a line for each, and return 0 only where every one has answered.

    ``ask_back`` asks the operator; None where nobody is there to answer.

    Raises:
        ConfigError: motors off would need a yes that nobody can give.
    """
    ask = Ask.KILL if args.kill else Ask.DESCEND if args.descend else Ask.LAND
    there = running()
    if ask is Ask.KILL and there and not args.yes:
        names = ", ".join(one.vehicle for one in there)
        if ask_back is None:
            raise ConfigError("--kill", f"stops the motors of {names} in the air: without a terminal it needs --yes")
        if ask_back(f"Motors off, AND THEY FALL: {names}. Type yes: ").strip() != "yes":
            print("nothing was done: without --kill they land")
            return EXIT_UNANSWERED
    told = asyncio.run(stop_all(ask))
    for one in told:
        print(printable(one.says), file=sys.stdout if one.answered else sys.stderr)
    for folder in strangers():
        whose = owner(folder)
        print(f"{folder} is of user {whose}: sudo -u {whose} groundstation stop-all reaches what flies there")
    if not told:
        print("nothing flies here")
    return EXIT_DONE if all(one.answered for one in told) else EXIT_UNANSWERED
