"""The commands for several vehicles: their cores together, and the relay of poses between them."""

import argparse
import asyncio
import os
import sys
from collections.abc import Callable

from groundstation.config import ConfigError
from groundstation.core.messages import SourceError
from groundstation.interfaces.service.fleet_supervisor import Supervisor, by_hand
from groundstation.interfaces.service.readiness import flyable
from groundstation.lab.fleet import Relay, read_fleet, run_relay

EXIT_DONE, EXIT_ABORTED = 0, 1


def fleet_command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Fly the vehicles of a fleet file; or show the configuration of one.

    Raises:
        ConfigError: one of them must not fly.
    """
    found = read_fleet(args.fleet, args.overrides)
    names = [member.name for member in found.members]
    for option, asked in (("--arm", args.arm), ("--show", [args.show] if args.show else [])):
        for name in asked:
            if name not in names:
                raise ConfigError(option, f"expected one of {names}, got {name!r}")
    if args.arm and "NOTIFY_SOCKET" in os.environ:
        raise ConfigError("--arm", "a service never arms by itself, as it may be started again at any time")
    if args.show:
        print(by_hand(found, found.members[names.index(args.show)]))
        return EXIT_DONE
    for member in found.members:
        try:
            flyable(member.lab)
        except ConfigError as error:
            raise ConfigError(error.key, error.problem, f"{args.fleet}: vehicle {member.name}") from None
    return asyncio.run(Supervisor(found, list(dict.fromkeys(args.arm)), say).run())


def relay_command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Hand datagrams on until told to end.

    Raises:
        ConfigError: an address is none.
    """
    try:
        made = Relay(args.listen, args.to, group=args.group or "", interface=args.interface or "")
    except ValueError as error:
        raise ConfigError("relay", str(error)) from None
    try:
        asyncio.run(run_relay(made, say, until_eof=args.until_eof))
    except SourceError as error:
        print(f"groundstation: {error}", file=sys.stderr)
        return EXIT_ABORTED
    return EXIT_DONE
