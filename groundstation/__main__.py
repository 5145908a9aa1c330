"""``groundstation``: real flying. Imports are lazy, so that ``--help`` is instant."""

import argparse
import math
import sys
import time
from pathlib import Path


def parser() -> argparse.ArgumentParser:
    """All commands and their arguments."""
    program = argparse.ArgumentParser(
        prog="groundstation",
        description="Fly a quadrotor from outside it. To try things without one: groundstation-sim.",
    )
    commands = program.add_subparsers(dest="command", required=True, metavar="COMMAND")

    fly = commands.add_parser("fly", help="connect, arm after asking, follow the trajectory, land")
    daemon = commands.add_parser("daemon", help="flights without a terminal, each armed by request; SIGTERM lands")
    for command in (fly, daemon):
        _config_arguments(command)
        command.add_argument(
            "--arm",
            metavar="VEHICLE_NAME",
            help="arm this vehicle without asking; it must be the name in the config. THIS MOVES THE VEHICLE",
        )

    daemon.add_argument("--once", action="store_true", help="end with the first flight")
    daemon.add_argument("--log-format", choices=["text", "logfmt", "json"], default="text", help="default: text")

    service = commands.add_parser("service", help="print a systemd unit for the daemon of a configuration")
    _config_arguments(service)
    service.add_argument("--user", default="groundstation", metavar="NAME", help="as whom it runs (groundstation)")

    health = commands.add_parser("health", help="how a running daemon is: exit code 0 for well")
    health.add_argument("--vehicle", metavar="NAME", help="not needed where only one is served here")
    health.add_argument("--socket", type=Path, metavar="PATH", help="its status socket, if not the usual one")
    health.add_argument("--json", action="store_true", help="print one JSON object instead of a line")

    fleet = commands.add_parser("fleet", help="fly several vehicles at once, a process each, by one fleet file")
    fleet.add_argument("fleet", type=Path, metavar="FLEET.toml")
    fleet.add_argument(
        "--arm",
        action="append",
        default=[],
        metavar="NAME",
        help="arm this vehicle without asking; may be repeated. The others wait for `groundstation request arm`. "
        "THIS MOVES THE VEHICLE",
    )
    fleet.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="for all")
    fleet.add_argument("--show", metavar="NAME", help="print the configuration of this vehicle's core, and end")

    relay = commands.add_parser("relay", help="receive a stream of poses once, and hand it on to several cores")
    relay.add_argument("listen", metavar="HOST:PORT", help="where the tracker sends to")
    relay.add_argument("--to", action="append", required=True, metavar="HOST:PORT", help="a core; may be repeated")
    relay.add_argument("--group", metavar="ADDRESS", help="multicast group to join")
    relay.add_argument("--interface", metavar="ADDRESS", help="this machine's own address in the group's network")
    relay.add_argument("--until-eof", action="store_true", help="end when standard input does")

    doctor = commands.add_parser("doctor", help="look at the autopilot's parameters; set one on request, disarmed only")
    _config_arguments(doctor)
    doctor.add_argument(
        "--fix",
        action="append",
        default=[],
        metavar="NAME[=VALUE]",
        help="set one parameter, to the recommended value without VALUE; may be repeated",
    )
    doctor.add_argument("--restore", type=Path, metavar="FILE", help="put back the old value that --fix has kept")
    doctor.add_argument("--yes", action="store_true", help="do not ask before setting it")
    doctor.add_argument("--json", action="store_true", help="print one JSON object instead of the table")

    props_off = commands.add_parser(
        "props-off", help="the required test with the propellers off, step by step. THIS STARTS THE MOTORS"
    )
    _config_arguments(props_off)
    props_off.set_defaults(now_s=time.time())

    radio = commands.add_parser("radio", help="bind an RF module, check its range, or just show it disarmed frames")
    radio.add_argument("what", choices=["bind", "range-check", "idle"])
    _config_arguments(radio)
    radio.add_argument("--seconds", type=float, default=10.0, metavar="S", help="for how long (default 10)")

    bridge = commands.add_parser("rf-bridge", help="pace another computer's commands out by an RF module here")
    _config_arguments(bridge, optional=True)
    bridge.add_argument("--make-key", type=Path, metavar="FILE", help="write a new key for both computers, and end")

    fly.add_argument("--tui", action="store_true", help="fly in a process of its own, and steer it from the dashboard")

    tui = commands.add_parser("tui", help="the dashboard of a running flight, or of a recorded one")
    tui.add_argument("log", type=Path, nargs="?", metavar="LOG.mcap", help="play this recording")
    tui.add_argument(
        "--vehicle", metavar="NAME", help="name of the vehicle in its config; without it, the one that runs"
    )
    tui.add_argument("--socket", type=Path, metavar="PATH", help="its status socket, if not the usual one")
    tui.add_argument("--read-only", action="store_true", help="nothing can be ordered from this screen")
    tui.add_argument(
        "--browser", type=int, nargs="?", const=8000, metavar="PORT",
        help="serve it as a page that can only look, to browsers on this machine (default port 8000)",
    )  # fmt: skip
    tui.add_argument("--screenshot", type=Path, metavar="FILE.svg", help="draw LOG.mcap into this file, and end")
    tui.add_argument("--at", type=float, metavar="S", help="begin so many seconds after the recording's start")
    tui.add_argument("--size", default="120x36", metavar="COLSxROWS", help="of the screenshot (default 120x36)")
    for command in (fly, tui):
        command.add_argument("--theme", choices=["dark", "light", "contrast"], default="dark", help="its colours")
    tui.add_argument("--fleet", metavar="URL", help="all vehicles at this broker: mqtts://[USER@]HOST[:PORT][/PREFIX]")
    _broker_arguments(tui)

    request = commands.add_parser("request", help="ask a running ground station: land, hold, kill, ...; done at once")
    request.add_argument(
        "ask",
        choices=["hold", "return", "track", "land", "descend", "abort", "kill", "arm"],
        metavar="WHAT",
        help="hold, return, track, land, descend; abort: commands stop; kill: motors off AT ONCE, also in the air; "
        "arm: THIS MOVES THE VEHICLE, and --vehicle must name it",
    )
    request.add_argument("--vehicle", metavar="NAME", help="not needed where only one is flown here, but for arm")
    request.add_argument("--socket", type=Path, metavar="PATH", help="its status socket, if not the usual one")
    request.add_argument("--why", default="", metavar="WORDS", help="why, for the others and the records")
    request.add_argument("--mqtt", metavar="URL", help="by this broker instead: mqtts://HOST[:PORT][/PREFIX]")
    request.add_argument("--client", metavar="NAME", help="with --mqtt: who asks, by its name at the station")
    request.add_argument("--key", type=Path, metavar="FILE", help="with --mqtt: the client's key")
    _broker_arguments(request)

    stop_all = commands.add_parser("stop-all", help="have every flight of this user on this machine land, at once")
    how = stop_all.add_mutually_exclusive_group()
    how.add_argument("--descend", action="store_true", help="failsafe descent instead")
    how.add_argument("--kill", action="store_true", help="motors off instead, also in the air; asks before")
    stop_all.add_argument("--yes", action="store_true", help="with --kill: do not ask")

    mqtt = commands.add_parser("mqtt", help="about MQTT: keys of clients, topics, schemas")
    verbs = mqtt.add_subparsers(dest="verb", required=True, metavar="{make-key,topics,schemas}")
    make_key = verbs.add_parser("make-key", help="write the new key of a client that may ask by MQTT")
    make_key.add_argument("file", type=Path, metavar="FILE")
    topics = verbs.add_parser("topics", help="list the topics")
    topics.add_argument("--write", type=Path, metavar="FILE.md", help="put them between the file's markers")
    schemas = verbs.add_parser("schemas", help="print the JSON Schemas of the messages")
    schemas.add_argument("--write", type=Path, metavar="DIR", help="write one file each instead")

    replay = commands.add_parser("replay", help="fly a recording again and compare to the last bit; a .tlog, in shadow")
    replay.add_argument("file", type=Path, metavar="LOG.mcap|FILE.tlog")
    replay.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    replay.add_argument("--config", type=Path, metavar="FILE.toml")
    replay.add_argument("--json", action="store_true", help="print one JSON object instead of the report")
    replay.add_argument(
        "--trust-modules", action="store_true", help="import the controller's module that LOG names: its code runs here"
    )

    logs = commands.add_parser("logs", help="list the recorded flights with their headline numbers")
    _config_arguments(logs, optional=True, metavar="CONFIG.toml|DIR")
    logs.add_argument("--folder", type=Path, metavar="DIR", help="list these instead of recording.folder; as DIR alone")
    logs.add_argument("--tidy", action="store_true", help="first remove what recording.keep_gb and keep_days let go")
    logs.add_argument("--json", action="store_true", help="print one JSON object instead of the table")
    logs.set_defaults(now_s=time.time())

    export = commands.add_parser(
        "export", help="channels of a recording as CSV, or a recording that was cut off made whole"
    )
    export.add_argument("file", type=Path, metavar="LOG.mcap")
    export.add_argument("--format", choices=["csv", "mcap", "poses"], default="csv", help="default: csv")
    export.add_argument(
        "--channel", action="append", default=[], metavar="/NAME", help="only this one; may be repeated. Default: all"
    )
    export.add_argument(
        "--out", type=Path, metavar="PATH", help="folder of the CSVs (default: beside the recording), or the new .mcap"
    )

    check = commands.add_parser("check", help="run the pre-flight checks on the vehicle as it stands; arms nothing")
    _config_arguments(check)
    check.add_argument("--json", action="store_true", help="print one JSON object instead of the list")
    check.add_argument("--watch", action="store_true", help="show the pose source live; opens no command link")
    check.add_argument("--seconds", type=_seconds, metavar="S", help="for how long (with --watch)")

    carry = commands.add_parser("carry", help="find the tracker's axes and latency by carrying the vehicle, props off")
    _config_arguments(carry)
    carry.add_argument("--json", action="store_true", help="print one JSON object; what to do goes to stderr")
    carry.add_argument("--dry-run", action="store_true", help="write nothing into the configuration")
    report = commands.add_parser(
        "report", help="one page about a recorded flight, with figures; or about two, compared"
    )
    report.add_argument("files", type=Path, nargs="+", metavar="LOG.mcap", help="a recording, or two to compare")
    report.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of page and figures (default: beside the first)"
    )
    report.add_argument("--json", action="store_true", help="print the numbers; the page only where --out is given")

    identify = commands.add_parser(
        "identify", help="thrust, lags, delay, drag and noise of the vehicle, from a recorded flight"
    )
    identify.add_argument("file", type=Path, metavar="LOG.mcap", help="best of trajectory.kind = 'excitation'")
    identify.add_argument("--out", type=Path, metavar="FILE.toml", help="write a vehicle file, for vehicle.file")
    identify.add_argument("--page", type=Path, metavar="DIR", help="write a page with the fits, and its figures")
    identify.add_argument("--json", action="store_true", help="print one JSON object instead of the table")

    trajectory = commands.add_parser("trajectory", help="what the trajectory asks of the vehicle: PASS or FAIL")
    _config_arguments(trajectory, optional=True)
    trajectory.add_argument("--json", action="store_true", help="print one JSON object instead of the table")

    states = commands.add_parser("states", help="the states of a flight, and what leads from one to another")
    states.add_argument("--write", type=Path, metavar="FILE.md", help="put the diagram between the file's markers")

    vehicles = commands.add_parser("vehicles", help="list the vehicles that come along, for vehicle.preset")
    vehicles.add_argument("name", nargs="?", metavar="NAME", help="print this one's file, to start your own from")

    config = commands.add_parser("config", help="about configurations")
    verbs = config.add_subparsers(dest="verb", required=True, metavar="show")
    show = verbs.add_parser("show", help="print what is in force, defaults and overrides included")
    _config_arguments(show, optional=True)
    return program


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan  # is within no bounds
    if not 0.0 < value <= 86400.0:
        raise argparse.ArgumentTypeError(f"expected seconds, more than 0 and at most 86400, got {text}")
    return value


def _config_arguments(parser: argparse.ArgumentParser, *, optional: bool = False, metavar: str = "CONFIG.toml") -> None:
    parser.add_argument("config", type=Path, nargs="?" if optional else None, metavar=metavar)
    parser.add_argument(
        "--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="override one key"
    )


def _broker_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--ca", type=Path, metavar="FILE", help="the authority that the broker's certificate is from")
    parser.add_argument("--user", default="", metavar="NAME", help="name to log in with at the broker")
    parser.add_argument("--password-file", type=Path, metavar="FILE", help="its first line is the password; mode 0600")


def main() -> int:
    """Entry point; for the exit codes see exits.py and docs/reference/exit-codes.md."""
    from groundstation.runtime.entry import run

    return run(parser, "groundstation.interfaces.cli.commands")


if __name__ == "__main__":
    sys.exit(main())
