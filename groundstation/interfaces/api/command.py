"""Orders from a shell, without a broker: ``groundstation request`` to one ground station, ``stop-all`` to all."""

import argparse
import asyncio
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from groundstation.config import ConfigError
from groundstation.core.messages import Ask, Request
from groundstation.interfaces.api.client import open_client
from groundstation.interfaces.api.desk import ANYONE
from groundstation.interfaces.api.messages import OrderAnswer
from groundstation.runtime import (
    BRIDGE,
    ApiError,
    Running,
    find_socket,
    foreign_services,
    owner,
    running_processes,
    send_signal,
)
from links.core import printable

EXIT_DONE, EXIT_REFUSED, EXIT_NOBODY = 0, 1, 2


def request_command(ask: Ask, vehicle: str | None, socket: Path | None, why: str) -> int:
    """Ask, print the answer, and return 0 where it is done, 1 where it is refused, 2 where nobody is there."""
    try:
        answer = asyncio.run(ask_station(ask, vehicle, socket, why))
    except (ApiError, OSError) as error:
        says = f"{socket}: {error.strerror}" if isinstance(error, OSError) and error.filename is None else error
        print(f"groundstation: request: {says}", file=sys.stderr)
        return EXIT_NOBODY
    print(answer.says)
    return EXIT_DONE if answer.done else EXIT_REFUSED


async def ask_station(ask: Ask, vehicle: str | None, socket: Path | None, why: str) -> OrderAnswer:
    """What the ground station answers; control is taken for as long as it takes, where it is needed.

    Raises:
        ApiError: nobody flies it, or it is not clear who is meant.
        OSError: the socket can't be opened.
    """
    path = socket or await find_socket(vehicle)
    async with open_client(path, "request") as client:
        served = client.hello.vehicle
        if ask is Ask.ARM and vehicle is None:
            raise ApiError(f"arm moves the vehicle, and must name it: --vehicle {served}")
        if vehicle is not None and vehicle != served:
            raise ApiError(f"{path}: the vehicle there is {served!r}, not {vehicle!r}")
        if ask not in ANYONE:
            taken = await client.take_control()
            if not taken.done:
                return taken
        return await client.ask(Request(ask, why), vehicle=vehicle or "")


STOP_ANSWER_S = 1.0
"""Who has not answered by then gets a signal [s]."""
EXIT_UNANSWERED = 1


class StopReport(msgspec.Struct, frozen=True):
    """What became of one of them."""

    answered: bool
    says: str
    """A line for the operator, with its name."""


async def stop_all(ask: Ask, why: str = "stop-all") -> list[StopReport]:
    """Ask all that run to come down by ``ask``, each on its own: none waits for another that hangs."""
    return list(await asyncio.gather(*(_stop(one, ask, why) for one in running_processes())))


async def _stop(one: Running, ask: Ask, why: str) -> StopReport:
    who = f"{one.vehicle} (process {one.pid})"
    if one.command == BRIDGE:
        return _bridge(one, ask)
    try:
        async with asyncio.timeout(STOP_ANSWER_S), open_client(Path(one.socket), "stop-all") as client:
            answer = await client.ask(Request(ask, why))
        return StopReport(True, f"{who}: {answer.says}")
    except TimeoutError:
        trouble = f"no answer within {STOP_ANSWER_S:g} s"
    except ApiError as error:
        trouble = str(error)
    except OSError as error:
        trouble = f"its socket {one.socket}: {error.strerror or error}"
    number = signal.SIGQUIT if ask is Ask.KILL else signal.SIGTERM
    if not send_signal(one, number):
        return StopReport(True, f"{who}: {trouble}, and it has ended")
    means = "motors off" if number is signal.SIGQUIT else "lands"
    return StopReport(
        False,
        f"{who}: NOT ANSWERED: {trouble}; {number.name} sent ({means} as soon as it runs): take the remote control "
        "and see that it comes down",
    )


def _bridge(one: Running, ask: Ask) -> StopReport:
    """A bridge is not asked to land: what flies by it lands by its own station's commands."""
    who = f"{BRIDGE} at {one.vehicle} (process {one.pid})"
    if ask is Ask.KILL:
        done = send_signal(one, signal.SIGQUIT)
        return StopReport(done, f"{who}: " + ("SIGQUIT sent: motors off" if done else "it has ended"))
    return StopReport(
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
    there = running_processes()
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
    for folder in foreign_services():
        whose = owner(folder)
        print(f"{folder} is of user {whose}: sudo -u {whose} groundstation stop-all reaches what flies there")
    if not told:
        print("nothing flies here")
    return EXIT_DONE if all(one.answered for one in told) else EXIT_UNANSWERED
