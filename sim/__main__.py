"""``groundstation-sim``: everything simulated. Imports are lazy, so that ``--help`` is instant."""

import argparse
import sys
from pathlib import Path

from sim.arguments import count, hours, names, percent, seconds, whole
from sim.bench import WHAT as BENCHES

_CONTROLLERS = "adaptive (default), uncompensated, geometric, pid, indi, or your own: package.module:factory"
_LINKS = ["mavlink", "dsm", "crsf", "rf_bridge"]
_SOURCES = ["vicon", "natnet", "qualisys", "odometry", "vision", "json"]

_DRAWS = "what differs from flight to flight: mass,lags,gain,wind (default), and latency, noise, losses"
_KERNEL = "compiled by this machine's C compiler, or numpy; the figures are the same (default: c if it works)"
_AUTOPILOTS = ("px4", "ardupilot")


def parser() -> argparse.ArgumentParser:
    """All commands and their arguments."""
    program = argparse.ArgumentParser(
        prog="groundstation-sim", description="Fly, check and serve simulated vehicles. Nothing real can move."
    )
    commands = program.add_subparsers(dest="command", required=True, metavar="COMMAND")

    fly = commands.add_parser("fly", help="fly a scenario in virtual time, through real wire bytes")
    fly.add_argument("--scenario", default="paper", metavar="NAME", help="see `groundstation-sim scenarios`")
    fly.add_argument(
        "--config", type=Path, metavar="FILE.toml", help="fly its vehicle and trajectory in the scenario's air"
    )
    fly.add_argument("--seed", type=whole, default=0, help="every random draw comes from it (default 0)")
    fly.add_argument("--duration", type=seconds, metavar="S", help="seconds (default 60, or as --config has it)")
    fly.add_argument("--controller", metavar="NAME", help=_CONTROLLERS)
    fly.add_argument("--source", choices=_SOURCES, default="vicon", help="where poses come from")
    fly.add_argument("--autopilot", choices=_AUTOPILOTS, default="px4", help="what it is like (default px4)")
    fly.add_argument("--link", choices=_LINKS, default="mavlink", help="how commands leave; default mavlink")
    fly.add_argument(
        "--set",
        action="append",
        default=[],
        dest="overrides",
        metavar="KEY=VALUE",
        help="sim.KEY changes the truth, controller.KEY (vehicle., pose., …) what the controller is told",
    )
    fly.add_argument("--out", type=Path, metavar="DIR", help="write the run's folder")
    fly.add_argument("--json", action="store_true", help="print one JSON object instead of the summary")

    mission = commands.add_parser("mission", help="fly a scenario from the floor to its figure, and back to the floor")
    mission.add_argument("--scenario", default="paper", metavar="NAME", help="see `groundstation-sim scenarios`")
    mission.add_argument("--seed", type=whole, default=0, help="every random draw comes from it (default 0)")
    mission.add_argument("--duration", type=seconds, metavar="S", help="time on the figure (default 60 s)")
    mission.add_argument("--controller", metavar="NAME", help=_CONTROLLERS)
    mission.add_argument("--source", choices=_SOURCES, default="vicon", help="where poses come from")
    mission.add_argument("--link", choices=_LINKS, default="mavlink", help="how commands leave; default mavlink")
    mission.add_argument("--autopilot", choices=_AUTOPILOTS, default="px4", help="what it is like (default px4)")
    mission.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    mission.add_argument("--vehicles", type=count, default=1, metavar="N", help="so many side by side (default 1)")
    mission.add_argument(
        "--real-time", action="store_true", help="by `groundstation fleet`: a process each, on real sockets, timed"
    )
    mission.add_argument("--json", action="store_true", help="print one JSON object instead of the summary")

    faults = commands.add_parser("faults", help="break one thing in every state of a mission, and see what comes of it")
    faults.add_argument("--quick", action="store_true", help="every fault once, over all states")
    faults.add_argument("--fault", metavar="NAME", help="this one only, in every state")
    faults.add_argument("--state", metavar="NAME", help="in this state only")
    faults.add_argument("--scenario", default="paper", metavar="NAME", help="what is flown (default paper)")
    faults.add_argument("--seed", type=whole, default=0, help="every random draw comes from it (default 0)")
    faults.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    faults.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    faults.add_argument("--json", action="store_true", help="print one JSON object instead of the table")
    faults.add_argument(
        "--write", type=Path, nargs="?", const=Path("docs/reference/fault-table.md"), metavar="FILE.md",
        help="write the table as a page (default docs/reference/fault-table.md)",
    )  # fmt: skip

    alarms = commands.add_parser(
        "alarms", help="fly from the floor, and see how near the poses came to being accused, where nothing is wrong"
    )
    alarms.add_argument("--scenario", metavar="NAME", help="what is flown (default adverse)")
    alarms.add_argument("--flights", type=count, default=50, metavar="N", help="how many (default 50)")
    alarms.add_argument("--seed", type=whole, default=0, metavar="FIRST", help="the others follow it (default 0)")
    alarms.add_argument("--duration", type=seconds, default=15.0, metavar="S", help="time on the figure (default 15 s)")
    alarms.add_argument("--source", choices=_SOURCES, default="vicon", help="where poses come from")
    alarms.add_argument("--link", choices=_LINKS, default="mavlink", help="how commands leave; default mavlink")
    alarms.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    alarms.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    alarms.add_argument(
        "--curve", action="store_true", help="by threshold: how soon a picture that stands is seen, and false alarms"
    )
    alarms.add_argument("--write", type=Path, metavar="FILE.md", help="put that table between the file's markers")
    alarms.add_argument("--capture", type=Path, metavar="FILE.tlog", help="of a recorded flight on rates and thrust")
    alarms.add_argument("--json", action="store_true", help="print one JSON object instead of text")

    soak = commands.add_parser(
        "soak", help="fly mission after mission, with random faults, and see whether anything grows"
    )
    soak.add_argument("--hours", type=hours, default=24.0, metavar="H", help="of virtual time (default 24)")
    soak.add_argument("--scenario", default="adverse", metavar="NAME", help="what is flown (default adverse)")
    soak.add_argument("--seed", type=whole, default=0, help="every random draw comes from it (default 0)")
    soak.add_argument("--json", action="store_true", help="print one JSON object instead of text")

    compare = commands.add_parser("compare", help="fly several controllers through the same scenarios, on all cores")
    compare.add_argument("--scenarios", metavar="A,B", type=names, help="default: all")
    compare.add_argument("--controllers", metavar="A,B", type=names, help="default: every one that comes along")
    compare.add_argument("--seeds", type=count, default=3, metavar="N", help="fly each with seeds 0 to N-1 (default 3)")
    compare.add_argument("--duration", type=seconds, default=60.0, metavar="S", help="of each flight (default 60 s)")
    compare.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="for all")
    compare.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    compare.add_argument("--json", action="store_true", help="print one JSON object instead of the table")
    compare.add_argument("--plot", type=Path, metavar="FILE.png", help="draw it too; needs matplotlib")
    compare.add_argument("--write", type=Path, metavar="FILE.md", help="put the table between the file's markers")

    campaign = commands.add_parser("campaign", help="fly a scenario many times, vehicle and wind drawn by each seed")
    campaign.add_argument("--scenario", default="adverse", metavar="NAME")
    campaign.add_argument("--flights", type=count, default=1000, metavar="N", help="how many (default 1000)")
    campaign.add_argument("--first-seed", type=whole, default=0, metavar="N", help="the others follow it (default 0)")
    campaign.add_argument("--duration", type=seconds, default=60.0, metavar="S", help="of each (default 60)")
    campaign.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    campaign.add_argument("--draw", metavar="A,B", type=names, help=_DRAWS)
    campaign.add_argument("--out", type=Path, metavar="DIR", help="one CSV row a flight; resumes what is there")
    campaign.add_argument("--workers", type=count, metavar="N", help="processes (default: one a core)")
    campaign.add_argument("--cluster", metavar="ADDRESS", help="fly on the workers of this Dask scheduler, host:port")
    campaign.add_argument("--batch", type=count, metavar="N", help="flights at once (default: shared out, up to 500)")
    campaign.add_argument(
        "--verify", type=count, metavar="N", help="then fly N of them again through `fly`, which must agree"
    )
    campaign.add_argument("--kernel", choices=["auto", "numpy", "c"], default="auto", help=_KERNEL)
    campaign.add_argument("--plot", type=Path, metavar="FILE.png", help="draw it too; needs matplotlib")
    campaign.add_argument("--json", action="store_true", help="print one JSON object instead of the summary")

    bench = commands.add_parser(
        "bench",
        help="measure speed and memory on this machine",
        description="tick: law, observer and predictor a command. flight: how fast `fly` is. decode: a datagram of "
        "each pose source. batch: time per vehicle and step. recording: what it costs a flight. allocation: what grows "
        "in hours of flight. links: how commands keep time. mqtt: 100 stations at one "
        "broker. The JSON is described in docs/reference/bench.md.",
    )
    bench.add_argument("what", nargs="*", metavar="WHAT", help=f"some of {', '.join(BENCHES)} (default: all)")
    bench.add_argument("--peers", action="store_true", help="batch: crazyflow and rotorpy too (dependency group peers)")
    bench.add_argument("--hours", type=hours, default=1.0, metavar="H", help="allocation: length (default 1)")
    bench.add_argument("--seconds", type=seconds, default=60.0, metavar="S", help="links, mqtt: length (default 60)")
    bench.add_argument("--json", action="store_true", help="print one JSON object instead of the table")

    bring_down = commands.add_parser("bring-down", help="cut flights short in the air, and see how they come down")
    bring_down.add_argument("--scenarios", metavar="A,B", type=names, default=["paper", "adverse", "quad1kg"])
    bring_down.add_argument("--flights", type=count, default=10, metavar="N", help="of each kind (default 10)")
    bring_down.add_argument("--write", type=Path, metavar="FILE.md", help="put the table between the file's markers")

    tune = commands.add_parser("tune", help="search for better gains, or report how wrong the world may be with these")
    tune.add_argument("--config", type=Path, metavar="FILE.toml", help="for its vehicle (default: the scenarios' own)")
    tune.add_argument("--report", action="store_true", help="search nothing: print the margins of these gains")
    tune.add_argument(
        "--scenarios", "--scenario", metavar="A,B", type=names, help="default: paper,adverse; with --report: paper"
    )
    tune.add_argument("--seeds", type=count, default=3, metavar="N", help="flights a scenario (default 3)")
    tune.add_argument("--duration", type=seconds, default=25.0, metavar="S", help="of each flight (default 25 s)")
    tune.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    tune.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    tune.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    tune.add_argument("--write", type=Path, metavar="FILE.md", help="margins as a table between the file's markers")
    tune.add_argument("--out", type=Path, metavar="FILE.toml", help="the tuned configuration; resumes its own search")
    tune.add_argument("--keys", type=names, metavar="K,K=LOW:HIGH", help="gains to search (default: the usual ones)")
    tune.add_argument("--trials", type=count, default=60, metavar="N", help="sets of gains to try (default 60)")
    tune.add_argument("--timeout", type=seconds, metavar="S", help="search no longer than this")
    tune.add_argument("--seed", type=whole, default=0, metavar="N", help="of the search itself (default 0)")
    tune.add_argument(
        "--verify", type=count, default=10, metavar="N", help="flights a scenario at the end (default 10)"
    )
    tune.add_argument(
        "--delay-margin", type=whole, default=20, metavar="MS", help="extra delay it must bear (default 20 ms)"
    )
    tune.add_argument(
        "--gain-margin", type=percent, default=25.0, metavar="PERCENT", help="wrong thrust it must bear (default 25)"
    )

    scenarios = commands.add_parser("scenarios", help="list the scenarios with every value")
    scenarios.add_argument("--json", action="store_true")

    vectors = commands.add_parser("check-vectors", help="evaluate the control law on a file of test vectors")
    vectors.add_argument("file", type=Path, metavar="FILE.json")

    fuzz = commands.add_parser("fuzz", help="feed every decoder random and damaged bytes")
    fuzz.add_argument("--source", metavar="NAME", help="the decoder of this pose source only")
    fuzz.add_argument("--link", metavar="NAME", help="the decoder of this link only")
    fuzz.add_argument("--count", type=count, default=10_000, metavar="N", help="datagrams for each (default 10000)")
    fuzz.add_argument("--seed", type=whole, default=0)
    fuzz.add_argument("--json", action="store_true", help="print one JSON object instead of the table")

    serve = commands.add_parser("serve", help="a simulated vehicle and cameras in real time, on loopback UDP")
    serve.add_argument("--scenario", default="paper", metavar="NAME")
    serve.add_argument("--seed", type=whole, default=0)
    serve.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    serve.add_argument("--source", choices=_SOURCES, default="vicon")
    serve.add_argument("--autopilot", choices=_AUTOPILOTS, default="px4", help="what it is like (default px4)")
    serve.add_argument(
        "--param",
        action="append",
        default=[],
        dest="parameters",
        metavar="NAME=VALUE",
        help="one of the autopilot's parameters, to see what `groundstation doctor` says",
    )
    serve.add_argument("--link", choices=_LINKS[:-1], default="mavlink", help="dsm and crsf: a receiver on a pty")
    serve.add_argument("--floor", action="store_true", help="it stands on the floor, instead of being held in the air")
    serve.add_argument("--fleet", type=Path, metavar="FLEET.toml", help="a vehicle for each of this fleet file")
    serve.add_argument("--duration", type=seconds, metavar="S", help="stop after so many seconds")

    reference = commands.add_parser("reference", help="the reference pages of the documents, made from the code")
    reference.add_argument("--write", type=Path, metavar="DIR", help="write them there instead of printing them")
    return program


def main() -> int:
    """Entry point; the exit code is 0 for done, 1 for a flight that failed, 2 for bad usage or config."""
    from groundstation.entry import run

    return run(parser, "sim.commands")


if __name__ == "__main__":
    sys.exit(main())
