"""What ``groundstation-sim serve`` does: the simulated side in real time, for one vehicle or a fleet."""

import argparse
import asyncio

from groundstation.config import ConfigError
from sim.scenarios import by_side, overridden, prepare, scenario_of


def serve(args: argparse.Namespace) -> int:
    """Run the simulated side in real time."""
    from sim.runs import serve as serve_stage
    from sim.runs import serve_fleet

    scenario = scenario_of(args.scenario)
    if args.fleet is not None:
        from groundstation.lab import read_fleet

        truth, told = by_side(args.overrides, None)
        world, fleet = overridden(scenario.world, truth), read_fleet(args.fleet, told)
        served = serve_fleet(world, fleet, seed=args.seed, duration_s=args.duration, autopilot=args.autopilot)
        return asyncio.run(served)
    world, config = prepare(scenario, args.overrides, source=args.source, link=args.link)
    if args.floor:
        from sim.runs import from_floor

        world, config = from_floor(world, config, None)
    return asyncio.run(
        serve_stage(
            scenario.name,
            world,
            config,
            seed=args.seed,
            duration_s=args.duration,
            autopilot=args.autopilot,
            parameters=_parameters(args.autopilot, args.parameters),
        )
    )


def _parameters(autopilot: str, texts: list[str]) -> dict[str, float]:
    """``NAME=VALUE`` for each of the ``autopilot``'s parameters that differs.

    Raises:
        ConfigError: it has no such parameter, or the value is none.
    """
    from sim.autopilots import AUTOPILOTS, Parameters

    made = AUTOPILOTS[autopilot]
    parameters: dict[str, float] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise ConfigError("--param", f"expected NAME=VALUE, got {text!r}")
        try:
            parameters[name] = float(value)
            Parameters(made.kind, made.table, parameters)
        except KeyError:
            raise ConfigError("--param", f"expected one of {sorted(made.table)}, got {name!r}") from None
        except ValueError as error:
            raise ConfigError("--param", f"{text}: {error}") from None
    return parameters
