"""``groundstation``: real flying. What a command needs is imported when it is run."""

import argparse
import sys

from groundstation.runtime import (
    COMPLETION,
    Arguments,
    Groups,
    Program,
    add_arguments,
    build_parser,
    json_argument,
    path,
    seconds,
)

TYPE_CHECKING = False  # typing's own would have to be imported, also for --help
if TYPE_CHECKING:
    from groundstation import ErrorBudget
    from groundstation.analysis.report import FlightColumns


RECORDING_HELP = "a file, or a name that `logs` lists (default: the newest)"

CONFIG: Arguments = {
    "config": {"type": path, "metavar": "CONFIG.toml"},
    "--set": {
        "action": "append", "default": [], "dest": "overrides", "metavar": "KEY=VALUE",
        "help": "override one key",
    },
}  # fmt: skip
OPTIONAL_CONFIG: Arguments = {
    **CONFIG,
    "config": {"type": path, "nargs": "?", "metavar": "CONFIG.toml"},
}
REHEARSE: Arguments = {
    "--rehearse": {
        "action": "store_true",
        "help": "nothing real: every address is turned to what `groundstation-sim serve --config` "
        "of the same file plays",
    }
}
ARM: Arguments = {
    "--arm": {
        "metavar": "VEHICLE_NAME",
        "help": "arm this vehicle without asking; it must be the name in the config. THIS MOVES "
        "THE VEHICLE",
    }
}
THEME: Arguments = {
    "--theme": {"choices": ["dark", "light", "contrast"], "default": "dark", "help": "its colours"}
}
SOCKET: Arguments = {
    "--socket": {"type": path, "metavar": "PATH", "help": "its status socket, if not the usual one"}
}
BROKER: Arguments = {
    "--ca": {"type": path, "metavar": "FILE", "help": "the authority that the broker's "
    "certificate is from"},
    "--user": {"default": "", "metavar": "NAME", "help": "name to log in with at the broker"},
    "--password-file": {
        "type": path, "metavar": "FILE", "help": "its first line is the password; mode 0600",
    },
}  # fmt: skip
RADIO: Arguments = {
    **CONFIG,
    "--seconds": {
        "type": seconds,
        "default": 10.0,
        "metavar": "S",
        "help": "for how long (default 10)",
    },
}


def _vehicle(words: str) -> Arguments:
    return {"--vehicle": {"metavar": "NAME", "help": words}}


def _recording(
    name: str = "file", metavar: str = "LOG.mcap", words: str = RECORDING_HELP, nargs: str = "?"
) -> Arguments:
    return {name: {"type": path, "nargs": nargs, "metavar": metavar, "help": words}}


FLY: Arguments = {
    **CONFIG,
    **REHEARSE,
    **ARM,
    "--tui": {"action": "store_true", "help": "fly in a process of its own, and steer it from "
    "the dashboard"},
    **THEME,
}  # fmt: skip
DAEMON: Arguments = {
    **CONFIG,
    **REHEARSE,
    **ARM,
    "--once": {"action": "store_true", "help": "end with the first flight"},
    "--log-format": {
        "choices": ["text", "json"],
        "default": "text",
        "help": "default: text",
    },
}
DAEMON_UNIT: Arguments = {
    **CONFIG,
    "--user": {
        "default": "groundstation",
        "metavar": "NAME",
        "help": "as whom it runs (groundstation)",
    },
}
DAEMON_HEALTH: Arguments = {
    **_vehicle("not needed where only one is served here"),
    **SOCKET,
    **json_argument("a line"),
}
FLEET: Arguments = {
    "fleet": {"type": path, "metavar": "FLEET.toml"},
    "--arm": {
        "action": "append",
        "default": [],
        "metavar": "NAME",
        "help": "arm this vehicle without asking; may be repeated. The others wait for "
        "`groundstation request arm`. THIS MOVES THE VEHICLE",
    },
    "--set": {
        "action": "append",
        "default": [],
        "dest": "overrides",
        "metavar": "KEY=VALUE",
        "help": "for all",
    },
    "--show": {
        "metavar": "NAME",
        "help": "print the configuration of this vehicle's core, and end",
    },
    **REHEARSE,
}
FLEET_RELAY: Arguments = {
    "listen": {"metavar": "HOST:PORT", "help": "where the tracker sends to"},
    "--to": {
        "action": "append",
        "required": True,
        "metavar": "HOST:PORT",
        "help": "a core; may be repeated",
    },
    "--group": {"metavar": "ADDRESS", "help": "multicast group to join"},
    "--interface": {
        "metavar": "ADDRESS",
        "help": "this machine's own address in the group's network",
    },
    "--until-eof": {"action": "store_true", "help": "end when standard input does"},
}
DOCTOR: Arguments = {
    **CONFIG,
    **REHEARSE,
    "--fix": {
        "action": "append",
        "default": [],
        "metavar": "NAME[=VALUE]",
        "help": "set one parameter, to the recommended value without VALUE; may be repeated",
    },
    "--restore": {"type": path, "metavar": "FILE", "help": "put back the old value that --fix "
    "has kept"},
    "--board": {
        "metavar": "PORT", "help": "own port of a Betaflight behind a receiver: a serial port, or "
        "HOST:PORT",
    },
    "--yes": {"action": "store_true", "help": "do not ask before setting it"},
    **json_argument("the table"),
}  # fmt: skip
TUI: Arguments = {
    **_recording("log", words="play this recording"),
    **_vehicle("name of the vehicle in its config; without it, the one that runs"),
    **SOCKET,
    "--read-only": {"action": "store_true", "help": "nothing can be ordered from this screen"},
    **THEME,
    "--fleet": {"metavar": "URL", "help": "all vehicles at this broker: "
    "mqtts://[USER@]HOST[:PORT][/PREFIX]"},
    **BROKER,
}  # fmt: skip
REQUEST: Arguments = {
    "ask": {
        "choices": ["hold", "return", "track", "goto", "follow", "land", "descend", "abort",
            "kill", "arm"],
        "metavar": "WHAT",
        "help":
            "hold, return, track, land, descend; abort: commands stop; kill: motors off AT ONCE, "
            "also in the air; arm: THIS MOVES THE VEHICLE, and --vehicle must name it; goto, "
            "follow: while it holds, to the points in WHERE",
    },
    "where": {
        "nargs": "*", "default": [], "metavar": "WHERE",
        "help":
            "of goto: NORTH EAST DOWN [m] and perhaps YAW [deg]; of follow: FILE.csv with a point "
            "a line",
    },
    **_vehicle("not needed where only one is flown here, but for arm"),
    **SOCKET,
    "--why": {"default": "", "metavar": "WORDS", "help": "why, for the others and the records"},
    "--mqtt": {"metavar": "URL", "help": "by this broker instead: mqtts://HOST[:PORT][/PREFIX]"},
    "--client": {"metavar": "NAME", "help": "with --mqtt: who asks, by its name at the station"},
    "--key": {"type": path, "metavar": "FILE", "help": "with --mqtt: the client's key"},
    **BROKER,
}  # fmt: skip
REPLAY: Arguments = {
    **_recording(metavar="LOG.mcap|FILE.tlog"),
    "--set": {"action": "append", "default": [], "dest": "overrides", "metavar": "KEY=VALUE"},
    "--config": {"type": path, "metavar": "FILE.toml"},
    **json_argument("the report"),
    "--trust-modules": {
        "action": "store_true", "help": "import the controller's module that LOG names: its code "
        "runs here",
    },
}  # fmt: skip
LOGS: Arguments = {
    **OPTIONAL_CONFIG,
    "config": {"type": path, "nargs": "?", "metavar": "CONFIG.toml|DIR"},
    **json_argument("the table"),
}
EXPORT: Arguments = {
    **_recording(),
    "--format": {
        "choices": ["csv", "npz", "mat", "mcap"],
        "default": "csv",
        "help": "default: csv",
    },
    "--channel": {
        "action": "append", "default": [], "metavar": "/NAME", "help": "only this one; may be "
        "repeated. Default: all",
    },
    "--out": {"type": path, "metavar": "PATH", "help": "folder or file to write (default: beside "
    "the recording)"},
}  # fmt: skip
VIEW: Arguments = {
    **_recording("log", words=f"also one that is being recorded now; {RECORDING_HELP}"),
    "--listen": {
        "metavar": "HOST:PORT",
        "help": "where Foxglove finds it (default: this machine alone, 127.0.0.1:8765)",
    },
}
CHECK: Arguments = {
    **CONFIG,
    **REHEARSE,
    **json_argument("the list"),
    "--limits": {
        "action": "store_true",
        "help": "list the limits in flight, too, and what follows each",
    },
    "--watch": {"action": "store_true", "help": "show the pose source live; opens no command link"},
    "--seconds": {"type": seconds, "metavar": "S", "help": "for how long (with --watch)"},
}
CARRY: Arguments = {
    **CONFIG,
    **REHEARSE,
    "--json": {"action": "store_true", "help": "print one JSON object; what to do goes to stderr"},
    "--dry-run": {"action": "store_true", "help": "write nothing into the configuration"},
}
REPORT: Arguments = {
    **_recording("files", words=f"one, or several to overlay; {RECORDING_HELP}", nargs="*"),
    "--out": {"type": path, "metavar": "DIR", "help": "folder of page and figures (default: "
    "beside the first)"},
    "--format": {
        "default": "html", "metavar": "LIST",
        "help": "some of html (default), pdf, svg (figures a column wide, for print), csv (the "
        "table)",
    },
    "--json": {"action": "store_true", "help": "print the numbers; the page only where --out is "
    "given"},
}  # fmt: skip
IDENTIFY: Arguments = {
    **_recording(words=f"best of trajectory.kind = 'excitation'; {RECORDING_HELP}"),
    "--out": {
        "type": path,
        "metavar": "FILE.toml",
        "help": "write a vehicle file, for vehicle.file",
    },
    "--page": {
        "type": path,
        "metavar": "DIR",
        "help": "write a page with the fits, and its figures",
    },
    **json_argument("the table"),
}
LOGS_IMPORT: Arguments = {
    "files": {"type": path, "nargs": "+", "metavar": "FILE"},
    "--map": {
        "required": True,
        "metavar": "MAP",
        "help": "a mapping that comes along, or a file: the how-to",
    },
    "--out": {
        "type": path,
        "required": True,
        "metavar": "FLIGHT.mcap",
        "help": "the recording to write",
    },
    "--body": {
        "default": "",
        "metavar": "NAME",
        "help": "the vehicle, where a tracker's file has several bodies",
    },
}
REPLAY_EVIDENCE: Arguments = {
    **_recording("files", "FLIGHT.mcap", f"imported, or our own; {RECORDING_HELP}", "*"),
    **json_argument("the table"),
}
CONFIG_KEY: Arguments = {"file": {"type": path, "metavar": "FILE"}}
TRAJECTORY: Arguments = {**OPTIONAL_CONFIG, **json_argument("the table")}
CONFIG_VEHICLES: Arguments = {
    "name": {
        "nargs": "?",
        "metavar": "NAME",
        "help": "print this one's file, to start your own from",
    }
}
CONFIG_NEW: Arguments = {
    "name": {
        "nargs": "?",
        "metavar": "NAME",
        "help": "the one to print; without it they are listed",
    },
    "--all": {
        "type": path,
        "metavar": "DIR",
        "help": "write all, and the files they name, into a new folder",
    },
}


def _stop_all(parser: argparse.ArgumentParser) -> None:
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--descend", action="store_true", help="failsafe descent instead")
    how.add_argument(
        "--kill", action="store_true", help="motors off instead, also in the air; asks before"
    )
    parser.add_argument("--yes", action="store_true", help="with --kill: do not ask")


def _error_budget(flown: "FlightColumns") -> "ErrorBudget":
    from groundstation import error_budget  # the one thing here that simulates

    return error_budget(flown)


def _report(parser: argparse.ArgumentParser) -> None:
    add_arguments(parser, REPORT)
    parser.set_defaults(error_budget=_error_budget)


COMMANDS: Groups = {
    "prepare": {
        "config": (
            "print, start or complete a configuration; list vehicles; write a key",
            None,
        ),
        "config show": (
            "print the configuration in force, defaults and overrides included",
            OPTIONAL_CONFIG,
        ),
        "config new": (
            "print a commented configuration to start from; without NAME list them",
            CONFIG_NEW,
        ),
        "config vehicles": (
            "list the vehicles that come along, for vehicle.preset",
            CONFIG_VEHICLES,
        ),
        "config key": (
            "write a new key: of an MQTT client, of a radio bridge, of MAVLink's signing",
            CONFIG_KEY,
        ),
        "config completion": (
            "print the script by which a shell completes command lines",
            COMPLETION,
        ),
        "trajectory": (
            "compare what the trajectory needs with what the vehicle can do: PASS or FAIL",
            TRAJECTORY,
        ),
        "doctor": ("check the autopilot's parameters; set one on request, disarmed only", DOCTOR),
        "check": ("run the pre-flight checks on the vehicle; arms nothing", CHECK),
        "carry": (
            "measure the tracker's axes and latency by carrying the vehicle, propellers off",
            CARRY,
        ),
        "props-off": (
            "the required test with the propellers off, step by step. THIS STARTS THE MOTORS",
            CONFIG,
        ),
    },
    "fly": {
        "fly": ("connect, ask, arm, fly the trajectory, land", FLY),
        "tui": ("show the dashboard of a running or a recorded flight", TUI),
        "request": ("send a request to a running ground station: land, hold, kill, ...", REQUEST),
        "stop-all": ("land every flight of this user on this machine, at once", _stop_all),
        "daemon": ("fly without a terminal, each flight armed by request; SIGTERM lands", DAEMON),
        "daemon health": ("ask a running daemon how it is: exit code 0 for well", DAEMON_HEALTH),
        "daemon unit": ("print a systemd unit for the daemon of a configuration", DAEMON_UNIT),
        "fleet": ("fly several vehicles of one fleet file, a process each", FLEET),
        "fleet relay": (
            "receive a stream of poses once, and send copies to the core of each vehicle",
            FLEET_RELAY,
        ),
    },
    "after the flight": {
        "logs": ("list the recorded flights with their headline numbers", LOGS),
        "logs import": (
            "convert a flight that others recorded (CSV, ULog, .bin, .tlog)",
            LOGS_IMPORT,
        ),
        "report": (
            "write a page with figures about a recorded flight, or overlay several",
            _report,
        ),
        "view": ("show a recorded or a running flight in Foxglove", VIEW),
        "export": (
            "write a recording as CSV or for other programs, or repair one that was cut off",
            EXPORT,
        ),
        "identify": (
            "measure thrust, lags, delay and drag of the vehicle from a recording",
            IDENTIFY,
        ),
        "replay": (
            "compute a recorded flight again, compare to the last bit; examine a .tlog",
            REPLAY,
        ),
        "replay evidence": (
            "measure how well our estimator predicts recorded flights",
            REPLAY_EVIDENCE,
        ),
    },
    "lab": {
        "radio": ("bind an RF module, check its range, or drive one for another computer", None),
        "radio bind": ("have the RF module bind a receiver", RADIO),
        "radio range-check": ("have the RF module send at low power", RADIO),
        "radio idle": ("send disarmed frames", RADIO),
        "radio bridge": (
            "send the commands of another computer by an RF module here",
            CONFIG,
        ),
    },
}

MOVED = {
    "service": "daemon unit",
    "health": "daemon health",
    "relay": "fleet relay",
    "rf-bridge": "radio bridge",
    "import": "logs import",
    "evidence": "replay evidence",
    "vehicles": "config vehicles",
    "completion": "config completion",
}
"""Old spelling of a command → its name today."""

GONE = {
    "fly --view": "`groundstation view` shows the newest flight, also while it is flown",
    "tui --screenshot": "play the recording, and take the picture with the terminal's own means",
    "tui --rehearse": "`groundstation fly --rehearse --tui CONFIG.toml` flies it, `groundstation "
    "tui` shows what runs",
    "tui --browser": "from another computer `ssh -t HOST groundstation tui` shows the dashboard",
    "export --format poses": "`--channel /measured` has the poses",
    "export --format rrd": "`groundstation view` shows a recording in Foxglove",
    "export --format foxglove": "`groundstation view` shows a recording in Foxglove, with its "
    "trails",
    "export --format parquet": 'in Python `flight["errors"].to_pandas().to_parquet(…)` writes it',
    "logs --folder": "`logs DIR` lists that folder",
    "logs --tidy": "recording.keep_gb and keep_days are applied as each flight begins",
    "report --budget": "a report of one flight has it, and `--json` has its figures",
    "tui --at": "the arrow keys wind by 5 s, and + plays faster",
    "view --in": "`groundstation view` shows it in Foxglove, the only viewer",
    "report --format tex": "`--format csv` has the table",
    "report --format png": "`--format pdf` and `svg` are for print; the figures of a page are PNGs",
    "daemon --log-format logfmt": "`json` tells more, and the journal gets plain lines; "
    "`groundstation daemon unit` writes the unit again",
    "mqtt make-key": "`groundstation config key FILE` writes a key",
    "radio bridge --make-key": "`groundstation config key FILE` writes a key",
    "mqtt topics": "docs/reference/mqtt.md lists them",
    "mqtt schemas": "they are in docs/reference/mqtt-schemas",
    "replay evidence --write": "`--json` has the figures",
    "replay evidence --part": "`--json` has the figures",
}
"""Words that a command line no longer has → what to do instead."""


def parser() -> Program:
    """Make the parser of all commands and their arguments."""
    description = "Fly a quadrotor from outside it. To try things without one: groundstation-sim."
    return build_parser("groundstation", description, COMMANDS)


def main() -> int:
    """Entry point; for the exit codes see groundstation/runtime/entry.py and
    docs/reference/exit-codes.md.
    """
    from groundstation.runtime import run

    return run(parser, "groundstation.interfaces.cli.commands", MOVED, GONE)


if __name__ == "__main__":
    sys.exit(main())
