"""``groundstation tui``, and ``groundstation fly --tui``: what is shown, and what is said when the screen closes."""

import argparse
import asyncio
import os
import shlex
import subprocess
import sys
from pathlib import Path

from groundstation.config import ConfigError
from groundstation.core.mission import FINAL
from groundstation.interfaces.tui.app import NO_SCREEN, Dashboard, shoot
from groundstation.interfaces.tui.feeds import Attached, Playback, Tape
from groundstation.recording import NoRecording
from groundstation.runtime import (
    ApiError,
    StatusConfig,
    find_socket,
    is_served,
    make_folder,
    open_private,
    served_sockets,
    socket_path,
)
from groundstation.settings import Config
from links.core import make_child_command

NICE = 5
"""By so much the dashboard stands behind what flies (nice(2)): a key still gets through on a machine that is busy."""
END_S = 20.0
"""How long a ground station on the ground may take to end [s]."""


def tui_command(args: argparse.Namespace) -> int:
    """Show a flight that is going on, or a recorded one; or make a picture of a recorded one."""
    if args.browser is not None:
        return _in_browser(args)
    if args.log is not None:
        return _show_recording(args.log, args.theme, args.at, args.screenshot, args.size)
    if args.screenshot is not None or args.at is not None:
        raise ConfigError("--screenshot, --at", "need a recording, LOG.mcap")
    path = args.socket or served_socket(args.vehicle)
    which = _which(args.socket)
    dashboard = Dashboard(Attached(path), read_only=args.read_only, which=which)
    return _run(dashboard, args.theme)


def fly_with_screen(args: argparse.Namespace, config: Config) -> int:
    """Start the ground station as a process of its own, which outlives this one, and show what it does."""
    vehicle = config.vehicle.name
    path = socket_path(config.status, vehicle)
    if not sys.stdin.isatty():
        raise ConfigError("--tui", "needs a terminal")
    if asyncio.run(is_served(path)):
        again = f"groundstation tui {_which(path)}"
        raise ConfigError("status.path", f"a ground station serves {path} already; to see it: {again}")
    log = make_folder(config.recording) / f"{vehicle}.log"
    overrides = [word for override in args.overrides for word in ("--set", override)]
    arm = [] if args.arm is None else ["--arm", args.arm]
    command = make_child_command("groundstation", "daemon", str(args.config), "--once", *overrides, *arm)
    with open(log, "wb", opener=open_private) as output:  # Path.open has no opener
        core = subprocess.Popen(  # noqa: S603  # ourselves
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True
        )

    def describe_end() -> str:
        return "" if core.poll() is None else f"It has ended, exit code {core.returncode}: {_last_line(log)}"

    which = _which(path if config.status.path else None)
    dashboard = Dashboard(Attached(path, core.pid, describe_end), take_control=True, which=which)
    code = _run(dashboard, args.theme)
    newest = dashboard.picture.newest
    if core.poll() is None and newest is not None and newest.state in NO_SCREEN:
        core.terminate()  # it ends what has not taken off; it would land what has, meanwhile
        try:
            core.wait(END_S)
        except subprocess.TimeoutExpired:
            print(f"The ground station is still busy, see {log}")
    if core.poll() is None:
        print(f"The ground station goes on as process {core.pid}; what it says is in {log}")
        return code
    told = newest is not None and newest.state in FINAL
    ended = f"{vehicle} {newest.state}: {newest.reason}" if told and newest is not None else _last_line(log)
    print(f"The ground station has ended. {ended}\nWhat it said is in {log}")
    return core.returncode


def _in_browser(args: argparse.Namespace) -> int:
    """Serve the same screen, without its orders, to browsers; each begins one of its own."""
    if args.screenshot is not None or not 1 <= args.browser <= 65535:
        raise ConfigError("--browser", f"expected a port from 1 to 65535, and no --screenshot, got {args.browser}")
    try:
        from groundstation.interfaces.tui.browser import serve
    except ImportError:
        raise ConfigError("--browser", "needs textual-serve: pip install 'quadrotor-groundstation[browser]'") from None
    if args.log is not None:
        title, what = args.log.name, [str(args.log), *([] if args.at is None else ["--at", str(args.at)])]
    else:
        path = args.socket or served_socket(args.vehicle)
        title, what = path.stem, ["--read-only", "--socket", str(path)]
    serve(make_child_command("groundstation", "tui", *what, "--theme", args.theme), args.browser, title)
    return 0


def _which(socket: Path | None) -> str | None:
    return None if socket is None else f"--socket {shlex.quote(str(socket))}"


def _run(dashboard: Dashboard, theme: str) -> int:
    os.nice(NICE)  # what flies comes first, where both want the same processor
    dashboard.theme = theme
    dashboard.run()
    return dashboard.return_code or 0


def _show_recording(log: Path, theme: str, at: float | None, picture: Path | None, size: str) -> int:
    try:
        tape = Tape(log)
    except NoRecording as error:
        raise ConfigError("LOG", str(error)) from None
    except OSError as error:
        raise ConfigError("LOG", f"cannot read {log}: {error.strerror}") from None
    playback = Playback(tape.hello, list(tape.snapshots()))
    dashboard = Dashboard(playback)
    if at is not None:
        playback.seek(at)
    if picture is None:
        return _run(dashboard, theme)
    dashboard.theme = theme
    playback.paused = True
    columns, rows = _size(size)
    try:
        picture.write_text(shoot(dashboard, (columns, rows)), "utf-8")
    except OSError as error:
        raise ConfigError("--screenshot", f"cannot write {picture}: {error.strerror}") from None
    print(f"written: {picture}")
    return 0


def _size(text: str) -> tuple[int, int]:
    columns, _, rows = text.partition("x")
    if not (columns.isdigit() and rows.isdigit() and 40 <= int(columns) <= 400 and 12 <= int(rows) <= 200):
        raise ConfigError("--size", f"expected COLUMNSxROWS, 40x12 to 400x200, got {text!r}")
    return int(columns), int(rows)


def served_socket(vehicle: str | None) -> Path:
    """Where the ground station that is meant serves; the operator chooses among several."""
    served = asyncio.run(served_sockets(vehicle))
    if len(served) == 1:
        return served[0]
    if not served and vehicle is not None:
        return socket_path(StatusConfig(), vehicle)  # it may come up yet
    if not served:
        raise ConfigError(
            "tui",
            "no ground station runs here: `groundstation fly CONFIG --tui` starts one; or name a recording, LOG.mcap",
        )
    if not sys.stdin.isatty():
        try:
            return asyncio.run(find_socket(vehicle))
        except ApiError as error:
            raise ConfigError("--vehicle", str(error)) from None
    for number, path in enumerate(served, 1):
        print(f"{number}  {path.stem:16} {path}")
    answer = input("Which one? ").strip()
    if not (answer.isdigit() and 1 <= int(answer) <= len(served)):
        raise ConfigError("--vehicle", f"expected a number from 1 to {len(served)}, got {answer!r}")
    return served[int(answer) - 1]


def _last_line(log: Path) -> str:
    lines = log.read_text("utf-8", "replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), "it has said nothing")
