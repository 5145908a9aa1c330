"""Commands of ``groundstation``: what each does with its command line.

And completion: scripts by which a shell completes our command lines. No key press runs any program
of ours.
"""

import argparse
import asyncio
import json
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from groundstation.config import (
    ConfigError,
    copy_examples,
    dump,
    example_text,
    from_dict,
    keys_of,
    list_examples,
    load,
    parse_number,
    presets,
    refuse_io,
    refuse_value,
    shipped_texts,
)
from groundstation.core.messages import MOST_POINTS, Ask, Request, Waypoint, notice
from groundstation.core.safety import list_limits
from groundstation.core.trajectory import parse_course
from groundstation.core.vehicle import Vehicle
from groundstation.machine import (
    BRIDGE,
    ApiError,
    NonBlockingWriter,
    RecordingConfig,
    Running,
    folder_of,
    list_flights,
    registration,
    running_processes,
    wall_ms,
)
from groundstation.runtime import Exit, Program, path
from groundstation.settings import Config, describe_rehearsal, ensure_served, rehearse
from links.bridge import BridgeConfig
from links.core import LinkError
from links.io import make_key
from links.rf import RF_CODECS, RfLinkConfig, SerialRfLink, Service

Say = Callable[[str], None]


def advise_name(program: str, old: str, today: str) -> None:
    """Tell the operator how the command ``old`` of ``program`` is spelled today."""
    print(
        f"{program}: {notice('command.moved', old=f'{program} {old}', new=f'{program} {today}')}",
        file=sys.stderr,
    )


def _load(
    args: argparse.Namespace, require: Callable[[Config], Config] = lambda config: config
) -> Config:
    """The configuration, which must have what ``require`` asks for.

    Of a rehearsal with every address turned.

    What a real flight must have is asked of the file as it stands. With ``--rehearse`` standard
    error says what it is.
    """
    config = require(load(args.config, Config, args.overrides))
    if not args.rehearse:
        return config
    turned = require(rehearse(config, args.config))
    assert turned.rehearsal is not None, "it has just become one"
    print(describe_rehearsal(turned.rehearsal), file=sys.stderr, flush=True)
    ensure_served(turned.rehearsal, args.config)
    return turned


def fly(args: argparse.Namespace) -> int:
    """Fly in the foreground: ask before arming, say what happens, land on Ctrl-C."""
    from groundstation.flight import StepTimer
    from groundstation.flight.preflight import confirm_arming, ensure_named
    from groundstation.interfaces.service import fly_command, require_flyable

    StepTimer.start()
    config = _load(args, require_flyable)
    ensure_named(args.arm, config)
    if args.tui:
        from groundstation.interfaces.tui import fly_with_screen

        return fly_with_screen(args, config)
    if args.arm is None and not sys.stdin.isatty():
        raise ConfigError("--arm", notice("arm.no_terminal", vehicle=config.vehicle.name))
    say = _terminal_writer()
    return fly_command(
        config,
        partial(confirm_arming, config, args.arm),
        _mark_lines(say) if args.rehearse else say,
    )


def _find_recording(name: Path | None) -> Path:
    """Return the recording ``name``, as ``groundstation logs`` lists it, too, or without its
    ending; else the newest.

    Raises:
        ConfigError: nothing is recorded.
    """
    folder = folder_of(RecordingConfig())
    if name is not None:
        listed = (folder / name, folder / f"{name}.mcap")
        return next((path for path in (name, *listed) if path.is_file()), name)
    newest = max(list_flights(folder), key=lambda path: path.stat().st_mtime, default=None)
    if newest is None:
        raise ConfigError("LOG", notice("recording.none", folder=folder))
    print(notice("recording.newest", path=newest), file=sys.stderr)
    return newest


def _mark_lines(say: Say) -> Say:
    return lambda line: say(f"REHEARSAL {line}")


def daemon(args: argparse.Namespace) -> Exit:
    """Fly headless, whenever somebody arms: log lines to stderr, land and end on SIGTERM."""
    from groundstation.flight import StepTimer
    from groundstation.flight.preflight import ensure_named
    from groundstation.interfaces.service import daemon_command, require_flyable

    StepTimer.start()
    config = _load(args, require_flyable)
    ensure_named(args.arm, config)
    return daemon_command(
        config, arm=args.arm is not None, once=args.once, as_json=args.log_format == "json"
    )


def daemon_health(args: argparse.Namespace) -> Exit:
    """Show a running daemon's health."""
    from groundstation.interfaces.service import health_command

    return health_command(args.vehicle, args.socket, as_json=args.json)


def daemon_unit(args: argparse.Namespace) -> Exit:
    """Print a systemd unit for a configuration."""
    from groundstation.interfaces.service import require_flyable, unit_file

    config = require_flyable(load(args.config, Config, args.overrides))
    print(unit_file(config, args.config, args.overrides, user=args.user), end="")
    return Exit.DONE


def fleet(args: argparse.Namespace) -> Exit:
    """Fly several vehicles, a core process each; signals reach every one."""
    from groundstation.interfaces.service import fleet_command

    say = _terminal_writer()
    return fleet_command(args, _mark_lines(say) if args.rehearse else say)


def fleet_relay(args: argparse.Namespace) -> Exit:
    """Hand datagrams on until told to end."""
    from groundstation.interfaces.service import relay_command

    return relay_command(args, _terminal_writer())


def _radio(what: str, args: argparse.Namespace) -> Exit:
    """Have the module of a radio link do ``what``; nothing is ever armed."""
    config = load(args.config, Config, args.overrides)
    if not isinstance(config.link, RfLinkConfig):
        raise ConfigError("link.kind", notice("radio.link_kind", choices=sorted(RF_CODECS)))
    done = asyncio.run(
        _serve(config.link, config.vehicle.thrust_max_n, what, args.seconds, _terminal_writer())
    )
    return Exit.DONE if done else Exit.FAILED


radio_bind, radio_range_check, radio_idle = (
    partial(_radio, what) for what in ("bind", "range-check", "idle")
)


def radio_bridge(args: argparse.Namespace) -> Exit:
    """Pace the commands of another computer out by an RF module."""
    from groundstation.flight.preflight import load_link_key

    say = _terminal_writer()
    config = load(args.config, BridgeConfig, args.overrides)
    shared = load_link_key(config.key_file, "key_file")
    one = Running(
        pid=os.getpid(), command=BRIDGE, vehicle=config.listen, link=config.link.destination
    )
    with refuse_value("XDG_RUNTIME_DIR", ApiError), registration(one):
        return Exit.DONE if asyncio.run(_bridge(config, shared, say)) else Exit.FAILED


def tui(args: argparse.Namespace) -> int:
    """Watch and steer a running flight, watch a recorded one, or all vehicles at a broker."""
    if args.fleet is not None:
        from groundstation.interfaces.mqtt import from_url
        from groundstation.interfaces.tui import run_fleet

        broker = from_url(args.fleet, ca=args.ca, user=args.user, password_file=args.password_file)
        return run_fleet(broker, args.theme)
    from groundstation.interfaces.tui import tui_command

    if args.log is not None:
        args.log = _find_recording(args.log)
    return tui_command(args)


def request(args: argparse.Namespace) -> Exit:
    """One request to a running ground station."""
    points = _read_points(args.ask, args.where)
    if points:
        args.ask = Ask.GOTO.value
    if args.mqtt is not None:
        from groundstation.interfaces.mqtt import ask_command

        return ask_command(args, points)
    from groundstation.interfaces.api import request_command

    return request_command(Request(Ask(args.ask), args.why, points), args.vehicle, args.socket)


def _read_points(ask: str, where: list[str]) -> tuple[Waypoint, ...]:
    """Where ``goto`` and ``follow`` lead: the points travel in the request, as files here are none
    of the station's.
    """
    rows: list[list[Any]]
    if ask == "follow":
        if len(where) != 1:
            raise ConfigError("follow", notice("follow.one_file", count=len(where)))
        with refuse_io("follow", "file.unread", where[0]):
            text = Path(where[0]).read_text("utf-8")
        try:
            course = parse_course(text, least=1)
        except ValueError as error:
            raise ConfigError(
                "follow", notice("value.refused", value=where[0], why=error)
            ) from None
        if "times_s" in course or "velocities_ned" in course:
            print(
                "its times and speeds are left out: each leg is flown from rest to rest",
                file=sys.stderr,
            )
        yaws = course.get("yaws_deg") or [None] * len(course["points_ned"])
        rows = [[*place, yaw] for place, yaw in zip(course["points_ned"], yaws, strict=True)]
    elif ask == "goto":
        if len(where) not in (3, 4):
            raise ConfigError("goto", notice("goto.numbers", count=len(where)))
        try:
            rows = [[parse_number(word) for word in where]]
        except ValueError:
            raise ConfigError("goto", notice("goto.words", found=" ".join(where))) from None
    elif where:
        raise ConfigError(ask, notice("request.no_words", found=" ".join(where)))
    else:
        return ()
    if len(rows) > MOST_POINTS:
        raise ConfigError(ask, notice("request.points", most=MOST_POINTS, count=len(rows)))
    points = []
    for number, row in enumerate(rows, start=1):
        try:
            numbers: list[Any] = [None if each is None else float(each) for each in row]
            points.append(Waypoint(*numbers))
        except ValueError as error:
            says = (
                notice("follow.point", path=where[0], number=number, why=error)
                if ask == "follow"
                else str(error)
            )
            raise ConfigError(ask, says) from None
    return tuple(points)


def stop_all(args: argparse.Namespace) -> Exit:
    """Have every flight of this user on this machine come down."""
    from groundstation.interfaces.api import stop_all_command

    return stop_all_command(args, input if sys.stdin.isatty() else None)


def replay(args: argparse.Namespace) -> Exit:
    """Compute a recording of ours again, exactly as in flight.

    Of a .tlog, how well our estimator predicts it.
    """
    args.file = _find_recording(args.file)
    if args.file.suffix == ".mcap":
        from groundstation.analysis import replay_command

        if args.config is not None:
            raise ConfigError("--config", notice("replay.own_config"))
        return replay_command(
            args.file, args.overrides, as_json=args.json, trust_modules=args.trust_modules
        )
    from groundstation.analysis.evidence import evidence_command

    config = load(args.config, Config, args.overrides) if args.config is not None else None
    return evidence_command([args.file], config=config, overrides=args.overrides, as_json=args.json)


def doctor(args: argparse.Namespace) -> Exit:
    """Look at the autopilot's parameters, and set some on request."""
    from groundstation.flight.preflight import line_from_terminal
    from groundstation.lab import DoctorOrders, run_doctor

    config = _load(args)
    words = [word for override in args.overrides for word in ("--set", override)]
    words += ["--rehearse"] if args.rehearse else []
    words += ["--board", args.board] if args.board is not None else []
    command = shlex.join(["groundstation", "doctor", str(args.config), *words])
    folder = folder_of(config.recording)
    orders = DoctorOrders(
        command, tuple(args.fix), args.restore, args.yes, args.json, folder, args.board
    )
    return asyncio.run(
        run_doctor(config, orders, line_from_terminal if sys.stdin.isatty() else None, print)
    )


def props_off(args: argparse.Namespace) -> Exit:
    """The required test with the propellers off, step by step."""
    from groundstation.interfaces.service import require_flyable
    from groundstation.lab import props_off_command

    return props_off_command(
        require_flyable(load(args.config, Config, args.overrides)), 1e-3 * wall_ms()
    )


def logs(args: argparse.Namespace) -> Exit:
    """List the recorded flights."""
    from groundstation.analysis import logs_command

    given = args.config
    if given is not None and given.suffix in (".mcap", ".tlog"):
        raise ConfigError("logs", notice("logs.recording", path=given))
    if given is None or not given.is_dir():
        given = folder_of(load(given, Config, args.overrides).recording)
    return logs_command(given, as_json=args.json)


def export(args: argparse.Namespace) -> Exit:
    """Channels of a recording as CSV, or a whole file from one that was cut off."""
    from groundstation.analysis import export_command

    return export_command(_find_recording(args.file), args.format, args.channel, args.out)


def view(args: argparse.Namespace) -> Exit:
    """A recording in Foxglove."""
    from groundstation.analysis import view_command

    return view_command(_find_recording(args.log), args.listen)


def report(args: argparse.Namespace) -> Exit:
    """A page with figures about one recorded flight, or two."""
    from groundstation.analysis.identify import find_outside
    from groundstation.analysis.report import report_command

    return report_command(
        [_find_recording(name) for name in args.files or [None]],
        args.out,
        find_outside,
        lambda flown: msgspec.to_builtins(args.error_budget(flown)),
        as_json=args.json,
        formats=args.format.split(","),
    )


def identify(args: argparse.Namespace) -> Exit:
    """Identify the vehicle from a recorded flight."""
    from groundstation.analysis.identify import identify_command

    return identify_command(_find_recording(args.file), args.out, args.page, as_json=args.json)


def logs_import(args: argparse.Namespace) -> Exit:
    """A flight that others recorded, as a recording."""
    from groundstation.analysis.evidence import import_command

    return import_command(args.files, args.map, args.out, args.body)


def replay_evidence(args: argparse.Namespace) -> Exit:
    """Replay recorded flights against our estimator."""
    from groundstation.analysis.evidence import evidence_command

    return evidence_command(
        [_find_recording(name) for name in args.files or [None]], as_json=args.json
    )


def config_show(args: argparse.Namespace) -> Exit:
    """Print the configuration in force."""
    print(dump(load(args.config, Config, args.overrides)), end="")
    return Exit.DONE


def config_new(args: argparse.Namespace) -> Exit:
    """Print a configuration to start from, list them, or write them all."""
    if args.all is not None:
        if args.name is not None:
            raise ConfigError("--all", notice("option.all_and_name", name=args.name))
        copy_examples(args.all)
        print(f"{args.all} written")
    else:
        print(list_examples() if args.name is None else example_text(args.name).rstrip())
    return Exit.DONE


def config_key(args: argparse.Namespace) -> Exit:
    """Write a new key that two computers share."""
    with refuse_value("config key"):
        make_key(args.file)
    print(
        f"{args.file}: a new key, for your eyes only. Copy it to the other side by a safe way, "
        "mode 0600",
        file=sys.stderr,
    )
    return Exit.DONE


def config_completion(args: argparse.Namespace) -> Exit:
    """Print the script by which a shell completes our command lines."""
    print(completion_script(args.program, args.shell, words_of_flying))
    return Exit.DONE


def carry(args: argparse.Namespace) -> Exit:
    """Have the vehicle carried along shown moves, and find its tracker's axes."""
    from groundstation.lab import carry_command

    config = _load(args)
    # What a rehearsal finds is of the simulated cameras: it must not stay in the file of the real
    # ones.
    return carry_command(
        config, args.config, args.overrides, as_json=args.json, keep=args.dry_run or args.rehearse
    )


def trajectory(args: argparse.Namespace) -> Exit:
    """Say what the trajectory asks of the vehicle, and whether it may fly."""
    from groundstation.flight import StepTimer
    from groundstation.flight.preflight import (
        describe_trajectory,
        examine_trajectory,
        explain_fence,
        explain_refusal,
    )

    StepTimer.start()
    config = load(args.config, Config, args.overrides)
    report = examine_trajectory(config)
    refusal = explain_refusal(config, report) or explain_fence(config)
    if args.json:
        facts = {
            "kind": config.trajectory.__struct_config__.tag,
            "vehicle": config.vehicle.name,
            "pass": refusal is None,
            "refusal": None if refusal is None else refusal.text,
            **msgspec.to_builtins(report),
        }
        print(json.dumps(facts))
    else:
        print(describe_trajectory(config, report))
    return Exit.DONE if refusal is None else Exit.FAILED


def check(args: argparse.Namespace) -> Exit:
    """Connect, run the pre-flight checks, and disconnect; or show the pose source live.

    Nothing is armed.
    """
    if args.seconds is not None and not args.watch:
        raise ConfigError("--seconds", notice("option.only_with", option="--watch"))
    if args.watch:
        from groundstation.lab import watch_poses

        return watch_poses(_load(args), seconds=args.seconds, as_json=args.json)
    from groundstation.flight import StepTimer, make_flight
    from groundstation.flight.preflight import describe_checks, describe_failures
    from groundstation.interfaces.service import require_flyable

    StepTimer.start()
    config = _load(args, require_flyable)

    async def never() -> bool:
        return False

    found = asyncio.run(make_flight(config, confirm=never, running=running_processes).check())
    bad = describe_failures(found)
    verdict = "NOT ready to fly: see FAIL above" if bad else "ready to fly"
    verdict = f"REHEARSAL: {verdict}" if args.rehearse else verdict
    limits = list_limits(config, config.guards) if args.limits else []
    facts = {"pass": not bad, "checks": msgspec.to_builtins(found)}
    if args.limits:
        facts["limits"] = [msgspec.to_builtins(one._asdict()) for one in limits]
    lines = [
        f"{one.says} ({one.key}{'' if one.limit is None else f' = {one.limit}'}) for "
        f"{one.lasts_s:g} s: {one.step}"
        for one in limits
    ]
    print(json.dumps(facts) if args.json else "\n".join([describe_checks(found), *lines, verdict]))
    return Exit.FAILED if bad else Exit.DONE


def config_vehicles(args: argparse.Namespace) -> Exit:
    """List the vehicles that come along, or print the file of one."""
    known = presets(Vehicle)
    if args.name is not None:
        if args.name not in known:
            raise ConfigError("NAME", notice("value.choice", choices=list(known), found=args.name))
        print(known[args.name], end="")
        return Exit.DONE
    for name, text in known.items():
        vehicle = from_dict({"vehicle": {"preset": name}}, Config).vehicle
        figures = f"{vehicle.mass_kg:.4g} kg, {vehicle.thrust_max_n:.4g} N"
        summary = text.splitlines()[0].lstrip("# ")
        print(f"{name:12}{figures:20}{summary}")
    return Exit.DONE


def _terminal_writer() -> Say:
    """Tell the operator in flight: a terminal that stands still (Ctrl-S) or is gone must not hold
    up a command.
    """
    return NonBlockingWriter(1).say


async def _serve(
    config: RfLinkConfig, thrust_max_n: float, what: str, seconds: float, say: Callable[[str], None]
) -> bool:
    link = SerialRfLink(config, thrust_max_n=thrust_max_n)
    try:
        await link.connect()
        say(f"{config.port}: {what} for {seconds:g} s, disarmed")
        if what == "idle":
            await asyncio.sleep(seconds)
        else:
            await link.serve(Service(what.replace("-", "_")), seconds)
        status = link.status
        say(f"{status.state}: {status.text}")
    except LinkError as error:
        say(f"{what} failed: {error}")
        return False
    finally:
        await link.close()
    return status.state == "connected"


async def _bridge(config: BridgeConfig, shared: bytes, say: Say) -> bool:
    from groundstation.flight.preflight import is_simulated
    from links.bridge import Bridge

    loop = asyncio.get_running_loop()
    link = config.link
    real = not is_simulated(link)
    it = Bridge(config, shared, say=lambda line: say(f"{loop.time():.3f} {line}"), remote_only=real)
    running = asyncio.ensure_future(it.run())

    def end(name: str) -> None:
        running.cancel()
        say(f"{name}: ending; what flies is brought down first. Ctrl-\\ (SIGQUIT) stops its motors")

    def kill() -> None:
        it.kill()
        say("SIGQUIT: motors off, now")

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, end, number.name)
    loop.add_signal_handler(signal.SIGQUIT, kill)
    if real:
        say(
            f"{link.port} may be a real module: whoever has the key {config.key_file} can start "
            "its vehicle's motors"
        )
    say(
        f"radio bridge at udp {config.listen}: {link.kind} module on {link.port}, a frame every "
        f"{1e3 * link.period_s:g} ms. Ctrl-C ends"
    )
    try:
        await running
    except asyncio.CancelledError:
        if it.dropped:
            say(f"datagrams dropped: {dict(it.dropped)}")
        return True
    except LinkError as error:
        say(str(error))
    return False


Words = Callable[[str, str], list[str]]
"""A command (``config new``) and the name of an argument of its → what that may be, as far as it
can be listed."""

_DEFINITION = {
    "bash": """{name}() {{ compgen -W "{words}" -- "$1"; }}""",
    "zsh": """{name}() {{ compadd {no_space}-- {words}; }}""",
}
# A value follows `KEY=` at once. In bash `compopt` says so, from the function alone that bash
# itself calls.
_BASH_END = """
_{name}() {{
  _shtab_{name} "$@"
  [[ ${{COMPREPLY[0]-}} == *= ]] && compopt -o nospace
  return 0
}}
complete -o bashdefault -F _{name} {prog}
"""


def completion_script(parser: argparse.ArgumentParser, shell: str, words: Words) -> str:
    """The script for the program of ``parser`` and ``shell``, ``bash`` or ``zsh``."""
    import shtab

    name = parser.prog.replace("-", "_")
    functions: dict[tuple[str, ...], str] = {}
    for command, action in _arguments(parser, "", shell):
        choice = tuple(words(command, action.dest))
        completes: Any = None
        if choice:
            function = functions.setdefault(choice, f"_{name}_words_{len(functions)}")
            completes = {shell: function}
        elif action.type is path:
            completes = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE
        if completes is not None:
            action.complete = completes  # type: ignore[attr-defined]  # where shtab looks
    preamble = [
        _DEFINITION[shell].format(
            name=function,
            words=" ".join(choice),
            no_space="-S '' " if choice[0].endswith("=") else "",
        )
        for choice, function in functions.items()
    ]
    script = shtab.complete(parser, shell, preamble="\n".join(preamble))
    return script + (_BASH_END.format(name=name, prog=parser.prog) if shell == "bash" else "")


def _arguments(
    parser: argparse.ArgumentParser, command: str, shell: str
) -> Iterator[tuple[str, argparse.Action]]:
    """Every argument of every command.

    Below a command with arguments of its own (``fleet relay``) only bash completes: shtab's zsh
    takes no files beside.
    """
    offers_all = shell == "bash" or not command
    if isinstance(parser, Program) and parser.below and offers_all:
        parser.offer_below()
    for action in parser._actions:  # argparse has no public way to ask what it knows
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield from _arguments(inner, f"{command} {name}".strip(), shell)
        else:
            yield command, action


def words_of_flying(command: str, argument: str) -> list[str]:
    """See :data:`Words`, for ``groundstation``."""
    if argument == "overrides":
        return [f"{key}=" for key in keys_of(BridgeConfig if command == "radio bridge" else Config)]
    if (command, argument) == ("config new", "name"):
        return list(shipped_texts("examples"))
    return []
