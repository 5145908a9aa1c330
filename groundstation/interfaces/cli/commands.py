"""What each ``groundstation`` command does."""

import argparse
import asyncio
import os
import shlex
import sys
from collections.abc import Callable

from groundstation.config import ConfigError, dump, load
from groundstation.core.messages import Ask
from groundstation.flight import confirmation, ensure_named, line_from_terminal
from groundstation.interfaces.service import flyable
from groundstation.settings import Config

EXIT_DONE, EXIT_ABORTED = 0, 1


def fly(args: argparse.Namespace) -> int:
    """Fly in the foreground: ask before arming, say what happens, land on Ctrl-C."""
    config = flyable(load(args.config, Config, args.overrides))
    ensure_named(args.arm, config)
    if args.tui:
        from groundstation.interfaces.tui import fly_with_screen

        return fly_with_screen(args, config)
    if args.arm is None and not sys.stdin.isatty():
        raise ConfigError("--arm", f"without a terminal, arming needs --arm {config.vehicle.name}")
    from groundstation.interfaces.service import fly_command

    return fly_command(config, confirmation(config, args.arm), _unwaited())


def daemon(args: argparse.Namespace) -> int:
    """Fly headless, whenever somebody arms: log lines to stderr, land and end on SIGTERM."""
    config = flyable(load(args.config, Config, args.overrides))
    ensure_named(args.arm, config)
    from groundstation.interfaces.service import Format, daemon_command

    return daemon_command(config, arm=args.arm is not None, once=args.once, style=Format(args.log_format))


def health(args: argparse.Namespace) -> int:
    """How a running daemon is."""
    from groundstation.interfaces.service import health_command

    return health_command(args.vehicle, args.socket, as_json=args.json)


def service(args: argparse.Namespace) -> int:
    """Print a systemd unit for a configuration."""
    from groundstation.interfaces.service import unit

    config = flyable(load(args.config, Config, args.overrides))
    print(unit(config, args.config, args.overrides, user=args.user), end="")
    return EXIT_DONE


def fleet(args: argparse.Namespace) -> int:
    """Fly several vehicles, a core process each; signals reach every one."""
    from groundstation.interfaces.service import fleet_command

    return fleet_command(args, _unwaited())


def relay(args: argparse.Namespace) -> int:
    """Hand datagrams on until told to end."""
    from groundstation.interfaces.service import relay_command

    return relay_command(args, _unwaited())


def radio(args: argparse.Namespace) -> int:
    """Have an RF module bind or check its range, or show it disarmed frames."""
    from groundstation.interfaces.cli.radio import serve

    return EXIT_DONE if serve(args, _unwaited()) else EXIT_ABORTED


def rf_bridge(args: argparse.Namespace) -> int:
    """Pace the commands of another computer out by an RF module; or make the key that both share."""
    from groundstation.interfaces.cli.radio import bridge

    return EXIT_DONE if bridge(args, _unwaited()) else EXIT_ABORTED


def tui(args: argparse.Namespace) -> int:
    """Watch and steer a running flight, watch a recorded one, or all vehicles at a broker."""
    if args.fleet is not None:
        from groundstation.interfaces.mqtt import from_url
        from groundstation.interfaces.tui import run_fleet

        return run_fleet(from_url(args.fleet, ca=args.ca, user=args.user, password_file=args.password_file))
    from groundstation.interfaces.tui import tui_command

    return tui_command(args)


def request(args: argparse.Namespace) -> int:
    """One request to a running ground station."""
    if args.mqtt is not None:
        from groundstation.interfaces.mqtt import ask_command

        return ask_command(args)
    from groundstation.interfaces.api import request_command

    return request_command(Ask(args.ask), args.vehicle, args.socket, args.why)


def stop_all(args: argparse.Namespace) -> int:
    """Have every flight of this user on this machine come down."""
    from groundstation.interfaces.api import stop_all_command

    return stop_all_command(args, input if sys.stdin.isatty() else None)


def mqtt(args: argparse.Namespace) -> int:
    """Keys, topics and schemas of MQTT."""
    from groundstation.interfaces.mqtt import mqtt_command

    return mqtt_command(args)


def replay(args: argparse.Namespace) -> int:
    """Run estimator and controller over a recording: exactly as in flight over our own, in shadow over a .tlog."""
    if args.file.suffix == ".mcap":
        from groundstation.analysis.replay import command as replay

        if args.config is not None:
            raise ConfigError("--config", "a recording has its own configuration: change it with --set")
        return replay.replay_command(args.file, args.overrides, as_json=args.json, trust_modules=args.trust_modules)
    from groundstation.analysis.shadow import replay_command

    return replay_command(args.file, args.config, args.overrides, as_json=args.json)


def doctor(args: argparse.Namespace) -> int:
    """Look at the autopilot's parameters, and set some on request."""
    from groundstation.lab.doctor import Orders, doctor
    from groundstation.runtime import folder_of

    config = load(args.config, Config, args.overrides)
    overrides = [word for override in args.overrides for word in ("--set", override)]
    command = shlex.join(["groundstation", "doctor", str(args.config), *overrides])
    orders = Orders(command, tuple(args.fix), args.restore, args.yes, args.json, folder_of(config.recording))
    return asyncio.run(doctor(config, orders, line_from_terminal if sys.stdin.isatty() else None, _say))


def props_off(args: argparse.Namespace) -> int:
    """The required test with the propellers off, step by step."""
    from groundstation.lab.props_off import props_off_command

    return props_off_command(flyable(load(args.config, Config, args.overrides)), args.now_s)


def logs(args: argparse.Namespace) -> int:
    """List the recorded flights."""
    from groundstation.analysis import logs_command

    if args.config is not None and args.config.is_dir():
        args.config, args.folder = None, args.folder or args.config
    return logs_command(load(args.config, Config, args.overrides).recording, args)


def export(args: argparse.Namespace) -> int:
    """Channels of a recording as CSV, or a whole file from one that was cut off."""
    from groundstation.analysis import export_command

    return export_command(args.file, args.format, args.channel, args.out)


def report(args: argparse.Namespace) -> int:
    """A page with figures about one recorded flight, or two."""
    from groundstation.analysis.report import report_command

    return report_command(args.files, args.out, as_json=args.json)


def identify(args: argparse.Namespace) -> int:
    """What a recorded flight tells of its vehicle."""
    from groundstation.analysis.identify import identify_command

    return identify_command(args.file, args.out, args.page, as_json=args.json)


def config(args: argparse.Namespace) -> int:
    """Print the configuration in force, or one to start from."""
    if args.verb == "show":
        print(dump(load(args.config, Config, args.overrides)), end="")
        return EXIT_DONE
    from groundstation.config import copy_examples, example_text, list_examples

    if args.all is not None:
        if args.name is not None:
            raise ConfigError("--all", f"writes all of them, and {args.name!r} with them: leave one out")
        copy_examples(args.all)
        print(f"{args.all} written")
    else:
        print(list_examples() if args.name is None else example_text(args.name).rstrip())
    return EXIT_DONE


def completion(args: argparse.Namespace) -> int:
    """Print the script by which a shell completes our command lines."""
    from groundstation.interfaces.cli.completion import completion_script, words_of_flying

    print(completion_script(args.program, args.shell, words_of_flying))
    return EXIT_DONE


def carry(args: argparse.Namespace) -> int:
    """Have the vehicle carried along shown moves, and find its tracker's axes."""
    from groundstation.lab.axes import carry

    config = load(args.config, Config, args.overrides)
    return carry(config, args.config, args.overrides, as_json=args.json, keep=args.dry_run)


def trajectory(args: argparse.Namespace) -> int:
    """Say what the trajectory asks of the vehicle, and whether it may fly."""
    from groundstation.interfaces.cli.preflight_commands import trajectory_command

    return trajectory_command(args)


def check(args: argparse.Namespace) -> int:
    """Connect, run the pre-flight checks, and disconnect; or show the pose source live. Nothing is armed."""
    from groundstation.interfaces.cli.preflight_commands import check_command

    return check_command(args)


def states(args: argparse.Namespace) -> int:
    """Draw the states of a flight."""
    from groundstation.interfaces.cli.mission_diagram import markdown, write

    if args.write is not None:
        write(args.write)
    print(markdown())
    return EXIT_DONE


def vehicles(args: argparse.Namespace) -> int:
    """List the vehicles that come along, or print the file of one."""
    from groundstation.config import from_dict, presets
    from groundstation.core.vehicle import Vehicle

    known = presets(Vehicle)
    if args.name is not None:
        if args.name not in known:
            raise ConfigError("NAME", f"expected one of {list(known)}, got {args.name!r}")
        print(known[args.name], end="")
        return EXIT_DONE
    for name, text in known.items():
        vehicle = from_dict({"vehicle": {"preset": name}}, Config).vehicle
        figures = f"{vehicle.mass_kg:.4g} kg, {vehicle.thrust_max_n:.4g} N"
        summary = text.splitlines()[0].lstrip("# ")
        print(f"{name:12}{figures:20}{summary}")
    return EXIT_DONE


def _say(line: str) -> None:
    """Tell the operator; a terminal that is gone must not spoil the exit code."""
    try:
        print(line, flush=True)
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _unwaited() -> Callable[[str], None]:
    """Tell the operator in flight: a terminal that stands still (Ctrl-S) or is gone must not hold up a command."""
    from groundstation.runtime import Outlet

    return Outlet(1).say
