"""``groundstation-sim``: everything simulated. What a command needs is imported when it is run."""

import argparse
import os
import sys

from groundstation.runtime import (
    COMPLETION,
    Arguments,
    Groups,
    Program,
    build_parser,
    json_argument,
    path,
    seconds,
)
from sim.cli import count, names, whole


class _ScenarioOption(argparse.Action):
    """The retired option ``--scenario NAME``."""

    def __call__(
        self, parser: object, namespace: argparse.Namespace, name: object, option: object = None
    ) -> None:
        from sim.text import notice

        print(notice("command.scenario_option", name=name), file=sys.stderr)
        namespace.scenario = name


def _scenario(default: str | None, words: str) -> Arguments:
    """The scenario; its old option ``--scenario`` works for one more release, with advice."""
    return {
        "scenario": {"nargs": "?", "default": argparse.SUPPRESS, "metavar": "SCENARIO",
            "help": words},
        "--scenario": {
            "dest": "scenario", "default": default, "action": _ScenarioOption, "metavar": "NAME",
            "help": argparse.SUPPRESS,
        },
    }  # fmt: skip


def _overrides(words: str = "as in fly") -> Arguments:
    return {
        "--set": {
            "action": "append",
            "default": [],
            "dest": "overrides",
            "metavar": "KEY=VALUE",
            "help": words,
        }
    }


def _write(words: str = "put the table between the file's markers") -> Arguments:
    return {"--write": {"type": path, "metavar": "FILE.md", "help": words}}


def _scenarios(words: str, default: list[str] | None = None) -> Arguments:
    return {"--scenarios": {"metavar": "A,B", "type": names, "default": default, "help": words}}


def _seeds(words: str) -> Arguments:
    return {"--seeds": {"type": count, "default": 3, "metavar": "N", "help": words}}


def _duration(words: str, default_s: float | None = None) -> Arguments:
    return {"--duration": {"type": seconds, "default": default_s, "metavar": "S", "help": words}}


SCENARIO = _scenario("paper", "what is flown (default paper): see `groundstation-sim scenarios`")
SEED: Arguments = {
    "--seed": {"type": whole, "default": 0, "help": "every random draw comes from it (default 0)"}
}
FIRST_SEED: Arguments = {
    "--seed": {
        "type": whole,
        "default": 0,
        "metavar": "FIRST",
        "help": "the others follow it (default 0)",
    }
}
CONTROLLER: Arguments = {
    "--controller": {
        "metavar": "NAME",
        "help": "adaptive (default), uncompensated, geometric, l1, pid, indi, or your own: "
        "package.module:factory",
    }
}
SOURCES = ["vicon", "natnet", "qualisys", "odometry", "vision", "json"]
SOURCE: Arguments = {
    "--source": {"choices": SOURCES, "default": "vicon", "help": "where poses come from"}
}
LINKS = ["mavlink", "dsm", "crsf", "rf_bridge"]
LINK: Arguments = {
    "--link": {"choices": LINKS, "help": "how commands leave; default mavlink, to Betaflight crsf"}
}
AUTOPILOT: Arguments = {
    "--autopilot": {
        "choices": ["px4", "ardupilot", "betaflight"], "default": "px4",
        "help": "what it is like (default "
        "px4)",
    },
}  # fmt: skip
WORKERS: Arguments = {
    "--workers": {
        "type": count, "metavar": "N", "default": os.cpu_count() or 1,
        "help": "processes at once (default: one a core)",
    },
}  # fmt: skip

FLY: Arguments = {
    **SCENARIO,
    "--config": {"type": path, "metavar": "FILE.toml", "help": "fly its vehicle and trajectory "
    "in the scenario's air"},
    **SEED,
    **_duration("seconds (default 60, or as --config has it)"),
    **CONTROLLER,
    **SOURCE,
    **AUTOPILOT,
    **LINK,
    **_overrides(
        "sim.KEY changes the truth, controller.KEY (vehicle., pose., …) what the controller is "
        "told"),
    "--out": {"type": path, "metavar": "DIR", "help": "write the run's folder"},
    **json_argument("the summary"),
}  # fmt: skip
MISSION: Arguments = {
    **SCENARIO,
    **SEED,
    **_duration("time on the figure (default 60 s)"),
    **CONTROLLER,
    **SOURCE,
    **LINK,
    **AUTOPILOT,
    **_overrides(),
    "--vehicles": {"type": count, "default": 1, "metavar": "N", "help": "so many side by side "
    "(default 1)"},
    **json_argument("the summary"),
}  # fmt: skip
SERVE: Arguments = {
    **_scenario("paper", "whose air and vehicle (default paper)"),
    **SEED,
    **_overrides(),
    **SOURCE,
    **AUTOPILOT,
    "--link": {
        "choices": LINKS[:-1], "help": "dsm and crsf: a receiver on a pty; default mavlink, to "
        "Betaflight crsf",
    },
    "--floor": {"action": "store_true", "help": "it stands on the floor, instead of being held "
    "in the air"},
    "--config": {
        "type": path, "metavar": "FILE.toml",
        "help":
            "play tracker and autopilot or receiver of this file, or fleet file, for "
            "`groundstation … --rehearse`",
    },
    "--carried": {
        "action": "store_true", "help": "with --config: for each Enter here a hand makes the "
        "moves of `carry`",
    },
    **_duration("stop after so many seconds"),
}  # fmt: skip
COMPARE: Arguments = {
    **_scenarios("default: all"),
    "--controllers": {"metavar": "A,B", "type": names, "help": "default: every one that comes "
    "along"},
    **_seeds("fly each with seeds 0 to N-1 (default 3)"),
    **_duration("of each flight (default 60 s)", 60.0),
    **_overrides("for all"),
    "--equal-margins": {
        "action": "store_true", "help": "tune each by the same search under the same floors, then "
        "fly them",
    },
    "--trials": {"type": count, "metavar": "N", "help": "with it: sets of gains each (default 24)"},
    **WORKERS,
    **json_argument("the table"),
    **_write(),
}  # fmt: skip
CAMPAIGN: Arguments = {
    **_scenario("adverse", "what is flown (default adverse)"),
    "--flights": {
        "type": count, "default": 1000, "metavar": "N",
        "help": "how many (default 1000: a minute of processor time, half a minute on two)",
    },
    "--first-seed": {"type": whole, "default": 0, "metavar": "N", "help": "the others follow it "
    "(default 0)"},
    **_duration("of each (default 60)", 60.0),
    **_overrides(),
    "--draw": {
        "metavar": "A,B", "type": names,
        "help":
            "what differs from flight to flight: mass,lags,gain,wind (default), and latency, "
            "noise, losses",
    },
    "--out": {"type": path, "metavar": "DIR", "help": "one CSV row a flight; resumes what is "
    "there"},
    **WORKERS,
    "--cluster": {"metavar": "ADDRESS", "help": "fly on the workers of this Dask scheduler, "
    "host:port"},
    "--batch": {"type": count, "metavar": "N", "help": "flights at once (default: shared out, up "
    "to 500)"},
    "--kernel": {"choices": ["auto", "numpy", "c"], "help": "has no effect: numpy flies"},
    **json_argument("the summary"),
}  # fmt: skip
TUNE: Arguments = {
    "--config": {"type": path, "metavar": "FILE.toml", "help": "for its vehicle (default: the "
    "scenarios' own)"},
    "--report": {
        "action": "store_true",
        "help": "search nothing: print the margins of these gains; about 220 flights a scenario, "
        "3 minutes on two processors",
    },
    **_scenarios("default: paper,adverse; with --report: paper"),
    **_seeds("flights a scenario (default 3)"),
    **_duration("of each flight (default 25 s)", 25.0),
    **_overrides(),
    **WORKERS,
    **json_argument("text"),
    **_write("margins as a table between the file's markers"),
    "--out": {"type": path, "metavar": "FILE.toml", "help": "the tuned configuration; resumes "
    "its own search"},
    "--keys": {"type": names, "metavar": "K,K=LOW:HIGH", "help": "gains to search (default: the "
    "usual ones)"},
    "--trials": {"type": count, "default": 60, "metavar": "N", "help": "sets of gains to try "
    "(default 60)"},
    "--seed": {"type": whole, "default": 0, "metavar": "N", "help": "of the search itself "
    "(default 0)"},
    "--verify": {"type": count, "default": 10, "metavar": "N", "help": "flights a scenario at the "
    "end (default 10)"},
    "--delay-margin": {
        "type": whole, "default": 20, "metavar": "MS", "help": "extra delay it must tolerate "
        "(default 20 ms)",
    },
    "--gain-margin": {
        "type": whole, "default": 25, "metavar": "PERCENT", "help": "wrong thrust it must "
        "tolerate (default 25)",
    },
}  # fmt: skip
BENCH: Arguments = {
    "what": {
        "nargs": "?", "choices": ("links",), "metavar": "WHAT", "help": "links: how commands keep "
        "time (default)",
    },
    "--seconds": {"type": seconds, "default": 30.0, "metavar": "S",
        "help": "links: length (default 30)"},
    **json_argument("the table"),
}  # fmt: skip
SHOW_SCENARIOS: Arguments = {
    "name": {"nargs": "?", "metavar": "NAME", "help": "every value of this one"},
    **json_argument("text"),
}
FAULTS: Arguments = {
    "--seeds": {"type": count, "default": 1, "help": "fly each cell with so many seeds and tell "
    "the worst"},
    "--fault": {"metavar": "NAME", "help": "this one only, or one of its cases, in every state"},
    "--state": {"metavar": "NAME", "help": "in this state only"},
    "--link": {"choices": LINKS, "help": "on this link only"},
    "--kind": {
        "type": names, "metavar": "NAMES",
        "help": 'rows of these kinds only: required, "known limit", honest, other',
    },
    **_scenario("paper", "what is flown (default paper)"),
    **SEED,
    "--forced": {
        "default": "", "metavar": "DOUBT",
        "help": "with --kind honest, force a doubt at a drawn moment: suspect, or failed:REASON "
        "(failed:pose.position_no_answer)",
    },
    **_overrides(),
    **WORKERS,
    **json_argument("the table"),
    "--write": {
        "type": path, "nargs": "?", "const": path("docs/reference/fault-table.md"),
        "metavar": "FILE.md",
        "help": "write a summary as a page (default docs/reference/fault-table.md)",
    },
}  # fmt: skip
ALARMS: Arguments = {
    **_scenario(None, "what is flown (default adverse)"),
    "--flights": {"type": count, "default": 50, "metavar": "N", "help": "how many (default 50)"},
    **FIRST_SEED,
    **_duration("time on the figure (default 15 s)", 15.0),
    **SOURCE,
    "--link": {"choices": LINKS, "default": "mavlink", "help": "how commands leave; default "
    "mavlink"},
    **_overrides(),
    **WORKERS,
    "--floors": {
        "action": "store_true", "help": "paper and adverse with delay, thrust, lag or noise that "
        "is told wrong",
    },
    **json_argument("text"),
}  # fmt: skip
INTERVALS: Arguments = {
    **_scenarios(
        "default adverse,rotors_mqx,rotors_mqx_radio", ["adverse", "rotors_mqx", "rotors_mqx_radio"]
    ),
    "--flights": {"type": count, "default": 16, "metavar": "N", "help": "in each (default 16)"},
    **_write(),
}
UPSETS: Arguments = {
    **_scenarios("default: paper, quad1kg"),
    **_seeds("of each push, 0 to N-1 (default 3)"),
    "--states": {
        "type": count,
        "default": 1000,
        "metavar": "N",
        "help": "drawn starts (default 1000)",
    },
    **_write(),
}
CHECK_VECTORS: Arguments = {"file": {"type": path, "metavar": "FILE.json"}}
FIRMWARE: Arguments = {
    **json_argument("the tables"),
    **_write("put the tables between the file's markers"),
}
AUTOPILOTS: Arguments = {
    "--px4": {"type": path, "metavar": "FOLDER", "help": "PX4-Autopilot, after `make px4_sitl`"},
    "--ardupilot": {
        "type": path,
        "metavar": "FOLDER",
        "help": "ardupilot, after `./waf copter` for sitl",
    },
    "--take-offs": {"type": whole, "default": 20, "metavar": "N", "help": "of each (default 20)"},
    "--lockstep": {"action": "store_true", "help": "has no effect: it is the only way"},
    **FIRMWARE,
}
REFERENCE: Arguments = {
    "--write": {"type": path, "metavar": "DIR", "help": "write them there instead of printing them"}
}


COMMANDS: Groups = {
    "commands": {
        "fly": ("fly a scenario in virtual time, through real wire bytes", FLY),
        "mission": ("fly a scenario from the floor to its figure, and back to the floor", MISSION),
        "serve": ("serve a simulated vehicle and cameras in real time, on loopback UDP", SERVE),
        "scenarios": ("list the scenarios, or print every value of one", SHOW_SCENARIOS),
        "compare": ("fly several controllers through the same scenarios, on all cores", COMPARE),
        "campaign": ("fly a scenario many times, vehicle and wind drawn by each seed", CAMPAIGN),
        "tune": ("search for better gains, or report the margins of these", TUNE),
        "bench": ("measure the program's timing on this machine, in about two minutes", BENCH),
        "completion": ("print the script by which a shell completes command lines", COMPLETION),
        "dev": ("commands that prove the project itself", None),
        "dev faults": (
            "break one thing in every state of a mission, and judge the outcome",
            FAULTS,
        ),
        "dev alarms": (
            "measure the monitor's margins to a false alarm, in flights without faults",
            ALARMS,
        ),
        "dev intervals": (
            "count how often the truth lies within the intervals of identify",
            INTERVALS,
        ),
        "dev upsets": (
            "fly every law through large pushes of the wind, and from far starts",
            UPSETS,
        ),
        "dev check-vectors": ("evaluate the control law on a file of test vectors", CHECK_VECTORS),
        "dev firmware": ("fly Betaflight's own firmware: flights, strikes, rates", FIRMWARE),
        "dev autopilots": (
            "fly PX4's and ArduCopter's own firmware on our rotors, where it is built",
            AUTOPILOTS,
        ),
        "dev reference": ("make the reference pages of the documents from the code", REFERENCE),
    }
}

MOVED = {
    name.removeprefix("dev "): name for name in COMMANDS["commands"] if name.startswith("dev ")
} | {
    "honest": "dev faults --kind honest",
    "bring-down": "dev faults --fault dropout --set link.bring_down=rates",
    "states": "dev reference",
}
"""Spelling of a command without ``dev``, or of one that has gone → its name today."""

_BENCH = "`bench` measures links alone"
GONE = {
    "fly --view": "`groundstation view DIR/flight.mcap` shows the flight that `--out DIR` wrote",
    "serve --fleet": "`serve --config FLEET.toml` plays the fleet that `groundstation fleet "
    "--rehearse FLEET.toml` flies",
    "mission --real-time": "`groundstation-sim serve --config FLEET.toml` and `groundstation fleet "
    "--rehearse FLEET.toml` fly in real time; `groundstation report` shows how late each vehicle's "
    "commands were",
    "serve --wrong": "`--set sim.tracker_yaw_deg=5` turns the tracker's north; sim.pose_latency_s, "
    "sim.mass_kg and sim.thrust_gain are told alike",
    "serve --param": "`groundstation doctor --fix NAME=VALUE` sets a parameter of what is served",
    "serve --gcs": "put a MAVLink router, such as mavlink-routerd, between autopilot and ground "
    "stations",
    "compare --plot": "groundstation.compare(...).plot().savefig(FILE) draws it, as in "
    "examples/notebook.ipynb",
    "compare --table": "`--write FILE.md` puts the table into a document",
    "campaign --plot": "plot flights.csv, which `--out` writes",
    "campaign --verify": "leave it out: the project's tests compare campaigns with flights "
    "through wire bytes",
    "tune --timeout": "after Ctrl-C the same command goes on, and `--trials N` ends the search "
    "there",
    "bench tick": _BENCH,
    "bench flight": _BENCH,
    "bench command": _BENCH,
    "bench batch": _BENCH,
    "bench --peers": _BENCH,
    "dev faults --csv": "`--json` has every row",
    "dev honest": "`dev faults SCENARIO --kind honest` flies the same rows",
    "dev states": "`dev reference` draws its diagram with the other pages",
    "dev bring-down": "`dev faults SCENARIO --fault dropout --set link.bring_down=rates` flies it "
    "in every state",
}
"""Words that a command line no longer has → what to do instead."""


def parser() -> Program:
    """All commands and their arguments."""
    description = "Fly, check and serve simulated vehicles. Nothing real can move."
    return build_parser("groundstation-sim", description, COMMANDS)


def main() -> int:
    """Entry point; the exit code is 0 for done, 1 for a flight that failed, 2 for bad usage or
    config.
    """
    from groundstation.runtime import run

    return run(parser, "sim.cli.commands", MOVED, GONE)


if __name__ == "__main__":
    sys.exit(main())
