"""``groundstation-sim``: everything simulated. What a command needs is imported when it is run."""

import argparse
import sys

from groundstation.runtime import COMPLETION, VIEWERS, Groups, Program, build_parser, path, viewer
from sim.cli import count, names, seconds, whole

_CONTROLLERS = "adaptive (default), uncompensated, geometric, l1, pid, indi, or your own: package.module:factory"
_LINKS = ["mavlink", "dsm", "crsf", "rf_bridge"]
_SOURCES = ["vicon", "natnet", "qualisys", "odometry", "vision", "json"]

_DRAWS = "what differs from flight to flight: mass,lags,gain,wind (default), and latency, noise, losses"
_AUTOPILOTS = ("px4", "ardupilot", "betaflight")


class _ScenarioOption(argparse.Action):
    """The retired option ``--scenario NAME``."""

    def __call__(self, parser: object, namespace: argparse.Namespace, name: object, option: object = None) -> None:
        from groundstation.core.messages import notice

        print(notice("command.scenario_option", name=name), file=sys.stderr)
        namespace.scenario = name


def _add_scenario(parser: argparse.ArgumentParser, default: str | None, says: str) -> None:
    """The scenario; its old option ``--scenario`` works for one more release, with advice."""
    parser.set_defaults(scenario=default)
    either = parser.add_mutually_exclusive_group()
    either.add_argument("scenario", nargs="?", default=argparse.SUPPRESS, metavar="SCENARIO", help=says)
    either.add_argument(
        "--scenario", default=argparse.SUPPRESS, action=_ScenarioOption, metavar="NAME", help=argparse.SUPPRESS
    )


def _fly(parser: argparse.ArgumentParser) -> None:
    _add_scenario(parser, "paper", "what is flown (default paper): see `groundstation-sim scenarios`")
    parser.add_argument(
        "--config", type=path, metavar="FILE.toml", help="fly its vehicle and trajectory in the scenario's air"
    )
    parser.add_argument("--seed", type=whole, default=0, help="every random draw comes from it (default 0)")
    parser.add_argument("--duration", type=seconds, metavar="S", help="seconds (default 60, or as --config has it)")
    parser.add_argument("--controller", metavar="NAME", help=_CONTROLLERS)
    parser.add_argument("--source", choices=_SOURCES, default="vicon", help="where poses come from")
    parser.add_argument("--autopilot", choices=_AUTOPILOTS, default="px4", help="what it is like (default px4)")
    parser.add_argument("--link", choices=_LINKS, help="how commands leave; default mavlink, to Betaflight crsf")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        dest="overrides",
        metavar="KEY=VALUE",
        help="sim.KEY changes the truth, controller.KEY (vehicle., pose., …) what the controller is told",
    )
    parser.add_argument("--out", type=path, metavar="DIR", help="write the run's folder")
    parser.add_argument(
        "--view",
        nargs="?",
        type=viewer,
        const=VIEWERS[0],
        choices=VIEWERS,
        help="with --out: then show it (default rerun)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the summary")


def _mission(parser: argparse.ArgumentParser) -> None:
    _add_scenario(parser, "paper", "what is flown (default paper): see `groundstation-sim scenarios`")
    parser.add_argument("--seed", type=whole, default=0, help="every random draw comes from it (default 0)")
    parser.add_argument("--duration", type=seconds, metavar="S", help="time on the figure (default 60 s)")
    parser.add_argument("--controller", metavar="NAME", help=_CONTROLLERS)
    parser.add_argument("--source", choices=_SOURCES, default="vicon", help="where poses come from")
    parser.add_argument("--link", choices=_LINKS, help="how commands leave; default mavlink, to Betaflight crsf")
    parser.add_argument("--autopilot", choices=_AUTOPILOTS, default="px4", help="what it is like (default px4)")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    parser.add_argument("--vehicles", type=count, default=1, metavar="N", help="so many side by side (default 1)")
    parser.add_argument(
        "--real-time", action="store_true", help="by `groundstation fleet`: a process each, on real sockets, timed"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the summary")


def _dev_faults(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seeds", type=int, default=1, help="fly each cell with so many seeds and tell the worst")
    parser.add_argument("--fault", metavar="NAME", help="this one only, or one of its cases, in every state")
    parser.add_argument("--state", metavar="NAME", help="in this state only")
    parser.add_argument("--link", choices=_LINKS, help="on this link only")
    parser.add_argument(
        "--kind", type=names, metavar="NAMES", help='rows of these kinds only: required, "known limit", honest, other'
    )
    _add_scenario(parser, "paper", "what is flown (default paper)")
    parser.add_argument("--seed", type=whole, default=0, help="every random draw comes from it (default 0)")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    parser.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    parser.add_argument("--csv", type=path, metavar="FILE.csv", help="write every flight, a line each")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the table")
    parser.add_argument(
        "--write", type=path, nargs="?", const=path("docs/reference/fault-table.md"), metavar="FILE.md",
        help="write a summary as a page (default docs/reference/fault-table.md)",
    )  # fmt: skip


def _dev_honest(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scenarios", type=names, default=["paper", "quad1kg", "rotors_mqx"], metavar="NAMES",
        help="default paper,quad1kg,rotors_mqx",
    )  # fmt: skip
    parser.add_argument("--links", type=names, default=["mavlink", "dsm"], metavar="NAMES", help="default mavlink,dsm")
    parser.add_argument(
        "--states", type=names, default=["take-off", "hold", "tracking", "landing"], metavar="NAMES",
        help="default take-off,hold,tracking,landing",
    )  # fmt: skip
    parser.add_argument("--seeds", type=count, default=3, metavar="N", help="how many (default 3)")
    parser.add_argument("--seed", type=whole, default=0, metavar="FIRST", help="the others follow it (default 0)")
    parser.add_argument(
        "--only", type=names, default=[], metavar="NAMES", help='these disturbances: push, "wind step: 5"'
    )
    parser.add_argument(
        "--forced", default="", metavar="DOUBT",
        help="force a doubt at a drawn moment: suspect, or failed:REASON (failed:pose.position_no_answer)",
    )  # fmt: skip
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    parser.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    parser.add_argument("--csv", type=path, metavar="FILE.csv", help="write every flight, a line each")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the table")


def _dev_alarms(parser: argparse.ArgumentParser) -> None:
    _add_scenario(parser, None, "what is flown (default adverse)")
    parser.add_argument("--flights", type=count, default=50, metavar="N", help="how many (default 50)")
    parser.add_argument("--seed", type=whole, default=0, metavar="FIRST", help="the others follow it (default 0)")
    parser.add_argument("--duration", type=seconds, default=15.0, metavar="S", help="time on the figure (default 15 s)")
    parser.add_argument("--source", choices=_SOURCES, default="vicon", help="where poses come from")
    parser.add_argument("--link", choices=_LINKS, default="mavlink", help="how commands leave; default mavlink")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    parser.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    parser.add_argument(
        "--floors", action="store_true", help="paper and adverse with delay, thrust, lag or noise that is told wrong"
    )
    parser.add_argument("--capture", type=path, metavar="FILE.tlog", help="of a recorded flight on rates and thrust")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")


def _compare(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenarios", metavar="A,B", type=names, help="default: all")
    parser.add_argument("--controllers", metavar="A,B", type=names, help="default: every one that comes along")
    parser.add_argument("--seeds", type=count, default=3, metavar="N", help="fly each with seeds 0 to N-1 (default 3)")
    parser.add_argument("--duration", type=seconds, default=60.0, metavar="S", help="of each flight (default 60 s)")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="for all")
    parser.add_argument(
        "--equal-margins", action="store_true", help="tune each by the same search under the same floors, then fly them"
    )
    parser.add_argument("--trials", type=count, metavar="N", help="with it: sets of gains each (default 24)")
    parser.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the table")
    parser.add_argument("--plot", type=path, metavar="FILE.png", help="draw it too; needs matplotlib")
    parser.add_argument("--write", type=path, metavar="FILE.md", help="put the table between the file's markers")


def _campaign(parser: argparse.ArgumentParser) -> None:
    _add_scenario(parser, "adverse", "what is flown (default adverse)")
    parser.add_argument(
        "--flights",
        type=count,
        default=1000,
        metavar="N",
        help="how many (default 1000: a minute of processor time, half a minute on two)",
    )
    parser.add_argument("--first-seed", type=whole, default=0, metavar="N", help="the others follow it (default 0)")
    parser.add_argument("--duration", type=seconds, default=60.0, metavar="S", help="of each (default 60)")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    parser.add_argument("--draw", metavar="A,B", type=names, help=_DRAWS)
    parser.add_argument("--out", type=path, metavar="DIR", help="one CSV row a flight; resumes what is there")
    parser.add_argument("--workers", type=count, metavar="N", help="processes (default: one a core)")
    parser.add_argument("--cluster", metavar="ADDRESS", help="fly on the workers of this Dask scheduler, host:port")
    parser.add_argument("--batch", type=count, metavar="N", help="flights at once (default: shared out, up to 500)")
    parser.add_argument("--kernel", choices=["auto", "numpy", "c"], help="has no effect: numpy flies")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the summary")


def _bench(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "tick: law, observer and predictor a command. links: how commands keep time, in about two minutes. The JSON is "
        "described in docs/reference/bench.md."
    )
    parser.add_argument(
        "what", nargs="*", choices=("tick", "links"), metavar="WHAT", help="tick, links, or both (default)"
    )
    parser.add_argument("--seconds", type=seconds, default=30.0, metavar="S", help="links: length (default 30)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the table")


def _tune(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config", type=path, metavar="FILE.toml", help="for its vehicle (default: the scenarios' own)"
    )
    parser.add_argument(
        "--report",
        action="store_true",
        help="search nothing: print the margins of these gains; about 220 flights a scenario, "
        "3 minutes on two processors",
    )
    parser.add_argument(
        "--scenarios", "--scenario", metavar="A,B", type=names, help="default: paper,adverse; with --report: paper"
    )
    parser.add_argument("--seeds", type=count, default=3, metavar="N", help="flights a scenario (default 3)")
    parser.add_argument("--duration", type=seconds, default=25.0, metavar="S", help="of each flight (default 25 s)")
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="as in fly")
    parser.add_argument("--workers", type=count, metavar="N", help="processes at once (default: one a core)")
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    parser.add_argument("--write", type=path, metavar="FILE.md", help="margins as a table between the file's markers")
    parser.add_argument("--out", type=path, metavar="FILE.toml", help="the tuned configuration; resumes its own search")
    parser.add_argument("--keys", type=names, metavar="K,K=LOW:HIGH", help="gains to search (default: the usual ones)")
    parser.add_argument("--trials", type=count, default=60, metavar="N", help="sets of gains to try (default 60)")
    parser.add_argument("--seed", type=whole, default=0, metavar="N", help="of the search itself (default 0)")
    parser.add_argument(
        "--verify", type=count, default=10, metavar="N", help="flights a scenario at the end (default 10)"
    )
    parser.add_argument(
        "--delay-margin", type=whole, default=20, metavar="MS", help="extra delay it must tolerate (default 20 ms)"
    )
    parser.add_argument(
        "--gain-margin", type=whole, default=25, metavar="PERCENT", help="wrong thrust it must tolerate (default 25)"
    )


def _scenarios(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="NAME", help="every value of this one")
    parser.add_argument("--json", action="store_true")


def _dev_check_vectors(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=path, metavar="FILE.json")


def _dev_firmware(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object instead of the tables")
    parser.add_argument("--write", type=path, metavar="FILE.md", help="put the tables between the file's markers")


def _dev_autopilots(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--px4", type=path, metavar="FOLDER", help="PX4-Autopilot, after `make px4_sitl`")
    parser.add_argument("--ardupilot", type=path, metavar="FOLDER", help="ardupilot, after `./waf copter` for sitl")
    parser.add_argument("--take-offs", type=whole, default=20, metavar="N", help="of each (default 20)")
    parser.add_argument("--lockstep", action="store_true", help="has no effect: it is the only way")
    _dev_firmware(parser)


def _serve(parser: argparse.ArgumentParser) -> None:
    _add_scenario(parser, "paper", "whose air and vehicle (default paper)")
    parser.add_argument("--seed", type=whole, default=0)
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    parser.add_argument("--source", choices=_SOURCES, default="vicon")
    parser.add_argument("--autopilot", choices=_AUTOPILOTS, default="px4", help="what it is like (default px4)")
    parser.add_argument(
        "--param",
        action="append",
        default=[],
        dest="parameters",
        metavar="NAME=VALUE",
        help="one of the autopilot's parameters, to see what `groundstation doctor` says",
    )
    parser.add_argument(
        "--link", choices=_LINKS[:-1], help="dsm and crsf: a receiver on a pty; default mavlink, to Betaflight crsf"
    )
    parser.add_argument("--floor", action="store_true", help="it stands on the floor, instead of being held in the air")
    parser.add_argument("--fleet", type=path, metavar="FLEET.toml", help="a vehicle for each of this fleet file")
    parser.add_argument(
        "--config",
        type=path,
        metavar="FILE.toml",
        help="play tracker and autopilot or receiver of this file, or fleet file, for `groundstation … --rehearse`",
    )
    parser.add_argument(
        "--wrong", default="", metavar="WHAT", help="with --config, mistakes to rehearse: yaw=5,latency=+20ms,mass=1.1"
    )
    parser.add_argument(
        "--carried", action="store_true", help="with --config: for each Enter here a hand makes the moves of `carry`"
    )
    parser.add_argument(
        "--gcs",
        nargs="?",
        const="127.0.0.1:14550",
        metavar="HOST:PORT",
        help="a second ground station here, such as QGroundControl, hears the autopilot (default 127.0.0.1:14550)",
    )
    parser.add_argument("--duration", type=seconds, metavar="S", help="stop after so many seconds")


def _dev_bring_down(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenarios", metavar="A,B", type=names, default=["paper", "adverse", "quad1kg"])
    parser.add_argument("--flights", type=count, default=10, metavar="N", help="of each kind (default 10)")
    parser.add_argument("--write", type=path, metavar="FILE.md", help="put the table between the file's markers")


def _dev_intervals(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenarios", metavar="A,B", type=names, default=["adverse", "rotors_mqx", "rotors_mqx_radio"])
    parser.add_argument("--flights", type=count, default=16, metavar="N", help="in each (default 16)")
    parser.add_argument("--write", type=path, metavar="FILE.md", help="put the table between the file's markers")


def _dev_upsets(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scenarios", metavar="A,B", type=names, help="default: paper, quad1kg")
    parser.add_argument("--seeds", type=count, default=3, metavar="N", help="of each push, 0 to N-1 (default 3)")
    parser.add_argument("--states", type=count, default=1000, metavar="N", help="drawn starts (default 1000)")
    parser.add_argument("--write", type=path, metavar="FILE.md", help="put the table between the file's markers")


def _dev_states(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--write", type=path, metavar="FILE.md", help="put the diagram between the file's markers")


def _dev_reference(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--write", type=path, metavar="DIR", help="write them there instead of printing them")


COMMANDS: Groups = {
    "commands": {
        "fly": ("fly a scenario in virtual time, through real wire bytes", _fly),
        "mission": ("fly a scenario from the floor to its figure, and back to the floor", _mission),
        "serve": ("serve a simulated vehicle and cameras in real time, on loopback UDP", _serve),
        "scenarios": ("list the scenarios, or print every value of one", _scenarios),
        "compare": ("fly several controllers through the same scenarios, on all cores", _compare),
        "campaign": ("fly a scenario many times, vehicle and wind drawn by each seed", _campaign),
        "tune": ("search for better gains, or report the margins of these", _tune),
        "bench": ("measure the program's timing on this machine", _bench),
        "completion": ("print the script by which a shell completes command lines", COMPLETION),
        "dev": ("commands that prove the project itself", None),
        "dev faults": ("break one thing in every state of a mission, and judge the outcome", _dev_faults),
        "dev honest": ("disturb flights whose poses are true, and judge monitor and guards", _dev_honest),
        "dev alarms": ("measure the monitor's margins to a false alarm, in flights without faults", _dev_alarms),
        "dev bring-down": ("cut flights short in the air, and measure how they come down", _dev_bring_down),
        "dev intervals": ("count how often the truth lies within the intervals of identify", _dev_intervals),
        "dev upsets": ("fly every law through large pushes of the wind, and from far starts", _dev_upsets),
        "dev check-vectors": ("evaluate the control law on a file of test vectors", _dev_check_vectors),
        "dev firmware": ("fly Betaflight's own firmware: flights, strikes, rates", _dev_firmware),
        "dev autopilots": ("fly PX4's and ArduCopter's own firmware on our rotors, where it is built", _dev_autopilots),
        "dev reference": ("make the reference pages of the documents from the code", _dev_reference),
        "dev states": ("draw the states of a flight and the transitions between them", _dev_states),
    }
}

NEW = ("dev states", "dev upsets")
"""Commands that never had another spelling."""
MOVED = {
    name.removeprefix("dev "): name for name in COMMANDS["commands"] if name.startswith("dev ") and name not in NEW
}
"""Old spelling of a command → its name today."""


def parser() -> Program:
    """All commands and their arguments."""
    description = "Fly, check and serve simulated vehicles. Nothing real can move."
    return build_parser("groundstation-sim", description, COMMANDS)


def main() -> int:
    """Entry point; the exit code is 0 for done, 1 for a flight that failed, 2 for bad usage or config."""
    from groundstation.runtime import run

    return run(parser, "sim.cli.commands", MOVED)


if __name__ == "__main__":
    sys.exit(main())
