"""``groundstation``: real flying. What a command needs is imported when it is run."""

import argparse
import sys
import time

from groundstation.runtime import VIEWERS, Groups, Program, add_completion, build_parser, path, viewer

TYPE_CHECKING = False  # typing's own would have to be imported, also for --help
if TYPE_CHECKING:
    from pathlib import Path

    from groundstation import ErrorBudget
    from groundstation.analysis.report import FlightColumns


def _fly(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    _rehearse_argument(parser)
    _arm_argument(parser)
    parser.add_argument(
        "--tui", action="store_true", help="fly in a process of its own, and steer it from the dashboard"
    )
    parser.add_argument(
        "--view", nargs="?", type=viewer, choices=VIEWERS, const=VIEWERS[0],
        help="show it in space as it is recorded, in a process of its own (default: rerun)",
    )  # fmt: skip
    _theme_argument(parser)


def _daemon(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    _rehearse_argument(parser)
    _arm_argument(parser)
    parser.add_argument("--once", action="store_true", help="end with the first flight")
    parser.add_argument("--log-format", choices=["text", "logfmt", "json"], default="text", help="default: text")


def _daemon_unit(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    parser.add_argument("--user", default="groundstation", metavar="NAME", help="as whom it runs (groundstation)")


def _daemon_health(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--vehicle", metavar="NAME", help="not needed where only one is served here")
    parser.add_argument("--socket", type=path, metavar="PATH", help="its status socket, if not the usual one")
    _json_argument(parser, "a line")


def _fleet(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("fleet", type=path, metavar="FLEET.toml")
    parser.add_argument(
        "--arm",
        action="append",
        default=[],
        metavar="NAME",
        help="arm this vehicle without asking; may be repeated. The others wait for `groundstation request arm`. "
        "THIS MOVES THE VEHICLE",
    )
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="for all")
    parser.add_argument("--show", metavar="NAME", help="print the configuration of this vehicle's core, and end")
    _rehearse_argument(parser)


def _fleet_relay(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("listen", metavar="HOST:PORT", help="where the tracker sends to")
    parser.add_argument("--to", action="append", required=True, metavar="HOST:PORT", help="a core; may be repeated")
    parser.add_argument("--group", metavar="ADDRESS", help="multicast group to join")
    parser.add_argument("--interface", metavar="ADDRESS", help="this machine's own address in the group's network")
    parser.add_argument("--until-eof", action="store_true", help="end when standard input does")


def _doctor(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    _rehearse_argument(parser)
    parser.add_argument(
        "--fix",
        action="append",
        default=[],
        metavar="NAME[=VALUE]",
        help="set one parameter, to the recommended value without VALUE; may be repeated",
    )
    parser.add_argument("--restore", type=path, metavar="FILE", help="put back the old value that --fix has kept")
    parser.add_argument(
        "--board", metavar="PORT", help="own port of a Betaflight behind a receiver: a serial port, or HOST:PORT"
    )
    parser.add_argument("--yes", action="store_true", help="do not ask before setting it")
    _json_argument(parser, "the table")


def _props_off(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    parser.set_defaults(now_s=time.time())


def _radio(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    parser.add_argument("--seconds", type=float, default=10.0, metavar="S", help="for how long (default 10)")


def _radio_bridge(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser, optional=True)
    parser.add_argument("--make-key", type=path, metavar="FILE", help="write a new key for both computers, and end")


def _port_or_log(text: str) -> "int | Path":
    """Read the value of --browser: a port, or else the recording, where no port is named."""
    return int(text) if text.removeprefix("-").isdecimal() else path(text)


def _tui(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "log", type=path, nargs="?", metavar="LOG.mcap", help="play this recording; with --rehearse, CONFIG.toml to fly"
    )
    _rehearse_argument(parser)
    parser.add_argument(
        "--vehicle", metavar="NAME", help="name of the vehicle in its config; without it, the one that runs"
    )
    parser.add_argument("--socket", type=path, metavar="PATH", help="its status socket, if not the usual one")
    parser.add_argument("--read-only", action="store_true", help="nothing can be ordered from this screen")
    parser.add_argument(
        "--browser", type=_port_or_log, nargs="?", const=True, metavar="PORT",
        help="serve it as a page that can only look, to browsers on this machine (default port 8000)",
    )  # fmt: skip
    parser.add_argument("--screenshot", type=path, metavar="FILE.svg", help="draw LOG.mcap into this file, and end")
    parser.add_argument("--at", type=float, metavar="S", help="begin so many seconds after the recording's start")
    parser.add_argument("--size", default="120x36", metavar="COLSxROWS", help="of the screenshot (default 120x36)")
    _theme_argument(parser)
    parser.add_argument(
        "--fleet", metavar="URL", help="all vehicles at this broker: mqtts://[USER@]HOST[:PORT][/PREFIX]"
    )
    _broker_arguments(parser)


def _request(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "ask",
        choices=["hold", "return", "track", "goto", "follow", "land", "descend", "abort", "kill", "arm"],
        metavar="WHAT",
        help="hold, return, track, land, descend; abort: commands stop; kill: motors off AT ONCE, also in the air; "
        "arm: THIS MOVES THE VEHICLE, and --vehicle must name it; goto, follow: while it holds, to the points in WHERE",
    )
    parser.add_argument(
        "where", nargs="*", default=[], metavar="WHERE",
        help="of goto: NORTH EAST DOWN [m] and perhaps YAW [deg]; of follow: FILE.csv with a point a line",
    )  # fmt: skip
    parser.add_argument("--vehicle", metavar="NAME", help="not needed where only one is flown here, but for arm")
    parser.add_argument("--socket", type=path, metavar="PATH", help="its status socket, if not the usual one")
    parser.add_argument("--why", default="", metavar="WORDS", help="why, for the others and the records")
    parser.add_argument("--mqtt", metavar="URL", help="by this broker instead: mqtts://HOST[:PORT][/PREFIX]")
    parser.add_argument("--client", metavar="NAME", help="with --mqtt: who asks, by its name at the station")
    parser.add_argument("--key", type=path, metavar="FILE", help="with --mqtt: the client's key")
    _broker_arguments(parser)


def _stop_all(parser: argparse.ArgumentParser) -> None:
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--descend", action="store_true", help="failsafe descent instead")
    how.add_argument("--kill", action="store_true", help="motors off instead, also in the air; asks before")
    parser.add_argument("--yes", action="store_true", help="with --kill: do not ask")


def _mqtt(parser: argparse.ArgumentParser) -> None:
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="{make-key,topics,schemas}")
    make_key = verbs.add_parser("make-key", help="write the new key of a client that may ask by MQTT")
    make_key.add_argument("file", type=path, metavar="FILE")
    topics = verbs.add_parser("topics", help="list the topics")
    topics.add_argument("--write", type=path, metavar="FILE.md", help="put them between the file's markers")
    schemas = verbs.add_parser("schemas", help="print the JSON Schemas of the messages")
    schemas.add_argument("--write", type=path, metavar="DIR", help="write one file each instead")


RECORDING_HELP = "a file, or a name that `logs` lists (default: the newest)"


def _replay(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=path, nargs="?", metavar="LOG.mcap|FILE.tlog", help=RECORDING_HELP)
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    parser.add_argument("--config", type=path, metavar="FILE.toml")
    _json_argument(parser, "the report")
    parser.add_argument(
        "--trust-modules", action="store_true", help="import the controller's module that LOG names: its code runs here"
    )


def _logs(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser, optional=True, metavar="CONFIG.toml|DIR")
    parser.add_argument(
        "--folder", type=path, metavar="DIR", help="list these instead of recording.folder; as DIR alone"
    )
    parser.add_argument("--tidy", action="store_true", help="first remove what recording.keep_gb and keep_days let go")
    _json_argument(parser, "the table")
    parser.set_defaults(now_s=time.time())


def _export(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=path, nargs="?", metavar="LOG.mcap", help=RECORDING_HELP)
    parser.add_argument(
        "--format",
        choices=["csv", "npz", "mat", "parquet", "rrd", "foxglove", "mcap", "poses"],
        default="csv",
        help="default: csv",
    )
    parser.add_argument(
        "--channel", action="append", default=[], metavar="/NAME", help="only this one; may be repeated. Default: all"
    )
    parser.add_argument(
        "--out", type=path, metavar="PATH", help="folder or file to write (default: beside the recording)"
    )


def _view(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "log", type=path, nargs="?", metavar="LOG.mcap", help=f"also one that is being recorded now; {RECORDING_HELP}"
    )
    parser.add_argument("--in", dest="viewer", choices=VIEWERS, default=VIEWERS[0], help="default: rerun")
    parser.add_argument(
        "--listen", metavar="HOST:PORT",
        help="where the viewer or its server listens (default: this machine alone, 127.0.0.1:9876, of Foxglove 8765)",
    )  # fmt: skip


def _check(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    _rehearse_argument(parser)
    _json_argument(parser, "the list")
    parser.add_argument("--limits", action="store_true", help="list the limits in flight, too, and what follows each")
    parser.add_argument("--watch", action="store_true", help="show the pose source live; opens no command link")
    parser.add_argument("--seconds", type=_seconds, metavar="S", help="for how long (with --watch)")


def _carry(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser)
    _rehearse_argument(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object; what to do goes to stderr")
    parser.add_argument("--dry-run", action="store_true", help="write nothing into the configuration")


def _error_budget(flown: "FlightColumns") -> "ErrorBudget":
    from groundstation import error_budget  # the one thing here that simulates

    return error_budget(flown)


def _report(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(error_budget=_error_budget)
    parser.add_argument(
        "files", type=path, nargs="*", metavar="LOG.mcap", help=f"one or more to compare; {RECORDING_HELP}"
    )
    parser.add_argument(
        "--out", type=path, metavar="DIR", help="folder of page and figures (default: beside the first)"
    )
    parser.add_argument(
        "--format", default="html", metavar="LIST",
        help="some of html (default), pdf, svg, png (figures a column wide, for print), csv, tex (the table)",
    )  # fmt: skip
    parser.add_argument("--budget", action="store_true", help="print the error budget alone: what has how much of RMS²")
    parser.add_argument("--json", action="store_true", help="print the numbers; the page only where --out is given")


def _identify(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", type=path, nargs="?", metavar="LOG.mcap",
        help=f"best of trajectory.kind = 'excitation'; {RECORDING_HELP}",
    )  # fmt: skip
    parser.add_argument("--out", type=path, metavar="FILE.toml", help="write a vehicle file, for vehicle.file")
    parser.add_argument("--page", type=path, metavar="DIR", help="write a page with the fits, and its figures")
    _json_argument(parser, "the table")


def _logs_import(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("files", type=path, nargs="+", metavar="FILE")
    parser.add_argument("--map", required=True, metavar="MAP", help="a mapping that comes along, or a file: the how-to")
    parser.add_argument("--out", type=path, required=True, metavar="FLIGHT.mcap", help="the recording to write")
    parser.add_argument(
        "--body", default="", metavar="NAME", help="the vehicle, where a tracker's file has several bodies"
    )


def _replay_evidence(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files", type=path, nargs="*", metavar="FLIGHT.mcap", help=f"imported, or our own; {RECORDING_HELP}"
    )
    parser.add_argument("--write", type=path, metavar="FILE.md", help="put tables between the file's markers")
    parser.add_argument("--part", default="flights", metavar="NAME", help="the markers' name (default flights)")
    _json_argument(parser, "the table")


def _trajectory(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser, optional=True)
    _json_argument(parser, "the table")


def _config_vehicles(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="NAME", help="print this one's file, to start your own from")


def _config_show(parser: argparse.ArgumentParser) -> None:
    _config_arguments(parser, optional=True)


def _config_new(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("name", nargs="?", metavar="NAME", help="the one to print; without it they are listed")
    parser.add_argument("--all", type=path, metavar="DIR", help="write all, and the files they name, into a new folder")


COMMANDS: Groups = {
    "prepare": {
        "config": ("print, start or complete a configuration; list the vehicles that come along", None),
        "config show": ("print the configuration in force, defaults and overrides included", _config_show),
        "config new": ("print a commented configuration to start from; without NAME list them", _config_new),
        "config vehicles": ("list the vehicles that come along, for vehicle.preset", _config_vehicles),
        "config completion": ("print the script by which a shell completes command lines", add_completion),
        "trajectory": ("compare what the trajectory needs with what the vehicle can do: PASS or FAIL", _trajectory),
        "doctor": ("check the autopilot's parameters; set one on request, disarmed only", _doctor),
        "check": ("run the pre-flight checks on the vehicle; arms nothing", _check),
        "carry": ("measure the tracker's axes and latency by carrying the vehicle, propellers off", _carry),
        "props-off": ("the required test with the propellers off, step by step. THIS STARTS THE MOTORS", _props_off),
    },
    "fly": {
        "fly": ("connect, ask, arm, fly the trajectory, land", _fly),
        "tui": ("show the dashboard of a running or a recorded flight", _tui),
        "request": ("send a request to a running ground station: land, hold, kill, ...", _request),
        "stop-all": ("land every flight of this user on this machine, at once", _stop_all),
        "daemon": ("fly without a terminal, each flight armed by request; SIGTERM lands", _daemon),
        "daemon health": ("ask a running daemon how it is: exit code 0 for well", _daemon_health),
        "daemon unit": ("print a systemd unit for the daemon of a configuration", _daemon_unit),
        "fleet": ("fly several vehicles of one fleet file, a process each", _fleet),
        "fleet relay": ("receive a stream of poses once, and send copies to the core of each vehicle", _fleet_relay),
    },
    "after the flight": {
        "logs": ("list the recorded flights with their headline numbers", _logs),
        "logs import": ("convert a flight that others recorded (CSV, ULog, .bin, .tlog)", _logs_import),
        "report": ("write a page with figures about one recorded flight, or compare several", _report),
        "view": ("show a recorded or a running flight in Rerun or Foxglove", _view),
        "export": ("write a recording as CSV or for other programs, or repair one that was cut off", _export),
        "identify": ("measure thrust, lags, delay, drag and noise of the vehicle from a recording", _identify),
        "replay": ("compute a recorded flight again and compare to the last bit; a .tlog in shadow", _replay),
        "replay evidence": ("measure how well our estimator predicts recorded flights", _replay_evidence),
    },
    "lab": {
        "radio": ("bind an RF module, check its range, or drive one for another computer", None),
        "radio bind": ("have the RF module bind a receiver", _radio),
        "radio range-check": ("have the RF module send at low power", _radio),
        "radio idle": ("send disarmed frames", _radio),
        "radio bridge": ("send the commands of another computer by an RF module here", _radio_bridge),
        "mqtt": ("make keys of clients; list topics and schemas", _mqtt),
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


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")  # is within no bounds
    if not 0.0 < value <= 86400.0:
        raise argparse.ArgumentTypeError(f"expected seconds, more than 0 and at most 86400, got {text}")
    return value


def _config_arguments(parser: argparse.ArgumentParser, *, optional: bool = False, metavar: str = "CONFIG.toml") -> None:
    parser.add_argument("config", type=path, nargs="?" if optional else None, metavar=metavar)
    parser.add_argument(
        "--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="override one key"
    )


def _rehearse_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--rehearse",
        action="store_true",
        help="nothing real: every address is turned to what `groundstation-sim serve --config` of the same file plays",
    )


def _arm_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--arm",
        metavar="VEHICLE_NAME",
        help="arm this vehicle without asking; it must be the name in the config. THIS MOVES THE VEHICLE",
    )


def _json_argument(parser: argparse.ArgumentParser, other: str) -> None:
    parser.add_argument("--json", action="store_true", help=f"print one JSON object instead of {other}")


def _theme_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--theme", choices=["dark", "light", "contrast"], default="dark", help="its colours")


def _broker_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ca", type=path, metavar="FILE", help="the authority that the broker's certificate is from")
    parser.add_argument("--user", default="", metavar="NAME", help="name to log in with at the broker")
    parser.add_argument("--password-file", type=path, metavar="FILE", help="its first line is the password; mode 0600")


def parser() -> Program:
    """All commands and their arguments."""
    description = "Fly a quadrotor from outside it. To try things without one: groundstation-sim."
    return build_parser("groundstation", description, COMMANDS)


def main() -> int:
    """Entry point; for the exit codes see groundstation/runtime/entry.py and docs/reference/exit-codes.md."""
    from groundstation.runtime import run

    return run(parser, "groundstation.interfaces.cli.commands", MOVED)


if __name__ == "__main__":
    sys.exit(main())
