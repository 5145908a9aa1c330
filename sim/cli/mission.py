"""What ``groundstation-sim mission`` does: from the floor to the figure and back, with one vehicle or several."""

import argparse
import json

import msgspec

from groundstation.flight.preflight import ensure_flyable
from groundstation.settings.settings import Config
from sim.scenarios.prepare import prepare, scenario_of
from sim.world.world import World

FIGURE_S = 60.0
"""Time on the figure if nobody says."""


def mission(args: argparse.Namespace) -> int:
    """Fly one scenario from the floor to its figure and back, in virtual time."""
    from sim.cli.mission_text import facts, summary
    from sim.runs.mission import fly_mission, from_floor

    scenario = scenario_of(args.scenario)
    world, config = prepare(scenario, args.overrides, controller=args.controller, source=args.source, link=args.link)
    world, config = from_floor(world, config, args.duration or FIGURE_S)
    ensure_flyable(config)
    if args.vehicles > 1 or args.real_time:
        return _missions(args, scenario.name, world, config)
    flown = fly_mission(world, config, seed=args.seed, autopilot=args.autopilot)
    asked = {
        "scenario": scenario.name,
        "seed": args.seed,
        "controller": config.controller.kind,
        "source": args.source,
        "link": args.link,
        "autopilot": args.autopilot,
    }
    title = f"{scenario.name}, controller {config.controller.kind}, poses by {args.source}, seed {args.seed}"
    print(json.dumps(facts(asked, flown)) if args.json else summary(title, flown))
    return 0 if flown.landed else 1


def _missions(args: argparse.Namespace, name: str, world: World, config: Config) -> int:
    """Several missions side by side."""
    from sim.cli.mission_text import fleet_facts, fleet_summary

    if args.real_time:
        from sim.runs.fleet_real import fly_fleet_real

        config = _paced_by_poses(config)
        say = None if args.json else print
        flown = fly_fleet_real(world, config, args.vehicles, seed=args.seed, autopilot=args.autopilot, say=say)
    else:
        from sim.runs.fleet_mission import fly_fleet

        flown = fly_fleet(world, config, args.vehicles, seed=args.seed, autopilot=args.autopilot)
    asked = {"scenario": name, "seed": args.seed, "source": args.source, "real_time": args.real_time}
    title = f"{name}, {args.vehicles} vehicles, poses by {args.source}, seed {args.seed}"
    print(json.dumps(fleet_facts(asked, flown)) if args.json else fleet_summary(title, flown))
    return 0 if flown.landed else 1


def _paced_by_poses(config: Config) -> Config:
    """``config`` with a link that sends as poses come, as a MAVLink link does where nobody says otherwise."""
    from links.mavlink.link import MavlinkLinkConfig

    if not isinstance(config.link, MavlinkLinkConfig):
        return config
    return msgspec.structs.replace(config, link=msgspec.structs.replace(config.link, pace="poses"))
