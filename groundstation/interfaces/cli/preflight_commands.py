"""The commands that tell, before a flight, whether it may be: by its configuration, and by the vehicle as it stands."""

import argparse
import asyncio
import json

import msgspec

from groundstation.config import ConfigError, load
from groundstation.flight import (
    describe_checks,
    describe_failures,
    describe_trajectory,
    examine_trajectory,
    explain_refusal,
)
from groundstation.interfaces.service import flyable
from groundstation.settings import Config

EXIT_DONE, EXIT_ABORTED = 0, 1


def trajectory_command(args: argparse.Namespace) -> int:
    """Say what the trajectory asks of the vehicle, and whether it may fly."""
    config = load(args.config, Config, args.overrides)
    report = examine_trajectory(config)
    if args.json:
        facts = {
            "kind": config.trajectory.__struct_config__.tag,
            "vehicle": config.vehicle.name,
            "pass": report.ok,
            "refusal": explain_refusal(config, report),
            **msgspec.to_builtins(report),
        }
        print(json.dumps(facts))
    else:
        print(describe_trajectory(config, report))
    return EXIT_DONE if report.ok else EXIT_ABORTED


def check_command(args: argparse.Namespace) -> int:
    """Connect, run the pre-flight checks, and disconnect; or show the pose source live. Nothing is armed."""
    config = load(args.config, Config, args.overrides)
    if args.watch:
        from groundstation.lab.pose_monitor import watch

        return watch(config, seconds=args.seconds, as_json=args.json)
    if args.seconds is not None:
        raise ConfigError("--seconds", "is for --watch; without it the checks end by themselves")
    from groundstation.recording import make_flight
    from groundstation.runtime import running

    flyable(config)

    async def never() -> bool:
        return False

    found = asyncio.run(make_flight(config, confirm=never, running=running).check())
    bad = describe_failures(found)
    verdict = "NOT ready to fly: see FAIL above" if bad else "ready to fly"
    facts = json.dumps({"pass": not bad, "checks": msgspec.to_builtins(found)})
    print(facts if args.json else f"{describe_checks(found)}\n{verdict}")
    return EXIT_ABORTED if bad else EXIT_DONE
