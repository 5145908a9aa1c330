"""``groundstation tui``, and ``groundstation fly --tui``: what is shown, and what is said when the screen closes."""

import argparse
import asyncio
import shlex
import subprocess
import sys
from pathlib import Path

from groundstation.api.place import ApiError, find, socket_path
from groundstation.config import ConfigError
from groundstation.recording.reader import NoRecording
from groundstation.settings import Config
from groundstation.telemetry.flights import folder_of
from groundstation.tui.app import NO_SCREEN, Dashboard
from groundstation.tui.attached import Attached
from groundstation.tui.playback import Playback
from groundstation.tui.screenshot import shoot
from groundstation.tui.tape import Tape

END_S = 20.0
"""How long a ground station on the ground may take to end [s]."""


def tui_command(args: argparse.Namespace) -> int:
    """Show a flight that is going on, or a recorded one; or make a picture of a recorded one."""
    if args.log is not None:
        return _recorded(args.log, args.theme, args.at, args.screenshot, args.size)
    if args.screenshot is not None or args.at is not None:
        raise ConfigError("--screenshot, --at", "need a recording, LOG.mcap")
    path = args.socket or _socket(args.vehicle)
    again = ["groundstation", "tui", *(("--socket", str(args.socket)) if args.socket else ())]
    again += ["--vehicle", args.vehicle] if args.vehicle else []
    dashboard = Dashboard(Attached(path), read_only=args.read_only, again=shlex.join(again))
    return _run(dashboard, args.theme)


def fly_with_screen(args: argparse.Namespace, config: Config) -> int:
    """Start the ground station as a process of its own, which outlives this one, and show what it does."""
    vehicle = config.vehicle.name
    path = socket_path(config.status, vehicle)
    if asyncio.run(_served(path)):
        again = f"groundstation tui --socket {shlex.quote(str(path))}"
        raise ConfigError("status.path", f"a ground station serves {path} already; to see it: {again}")
    log = folder_of(config.recording) / f"{vehicle}.log"
    log.parent.mkdir(parents=True, exist_ok=True)
    overrides = [word for override in args.overrides for word in ("--set", override)]
    arm = [] if args.arm is None else ["--arm", args.arm]
    command = [sys.executable, "-m", "groundstation", "daemon", str(args.config), *overrides, *arm]
    with log.open("wb") as output:
        core = subprocess.Popen(  # noqa: S603  # ourselves
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True
        )

    def gone() -> str:
        return "" if core.poll() is None else f"It has ended, exit code {core.returncode}: {_last_line(log)}"

    named = ["--vehicle", vehicle] if not config.status.path else ["--socket", str(path)]
    again = shlex.join(["groundstation", "tui", *named])
    dashboard = Dashboard(Attached(path, core.pid, gone), take_control=True, again=again)
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
    print(f"The ground station has ended: {_last_line(log)}\nWhat it said is in {log}")
    return core.returncode


def _run(dashboard: Dashboard, theme: str) -> int:
    dashboard.theme = theme
    dashboard.run()
    return dashboard.return_code or 0


def _recorded(log: Path, theme: str, at: float | None, picture: Path | None, size: str) -> int:
    try:
        tape = Tape(log)
    except (NoRecording, OSError) as error:
        raise ConfigError("LOG", str(error)) from None
    playback = Playback(tape.hello, list(tape.snapshots()))
    dashboard = Dashboard(playback)
    if at is not None:
        playback.seek(at)
    if picture is None:
        return _run(dashboard, theme)
    dashboard.theme = theme
    playback.paused = True
    columns, rows = _size(size)
    picture.write_text(shoot(dashboard, (columns, rows)), "utf-8")
    print(f"written: {picture}")
    return 0


def _size(text: str) -> tuple[int, int]:
    columns, _, rows = text.partition("x")
    if not (columns.isdigit() and rows.isdigit() and 40 <= int(columns) <= 400 and 12 <= int(rows) <= 200):
        raise ConfigError("--size", f"expected COLUMNSxROWS, 40x12 to 400x200, got {text!r}")
    return int(columns), int(rows)


def _socket(vehicle: str | None) -> Path:
    """Where the ground station that is meant serves."""
    try:
        return asyncio.run(find(vehicle))
    except ApiError as error:
        raise ConfigError("--vehicle", str(error)) from None


async def _served(path: Path) -> bool:
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except OSError:
        return False
    writer.close()
    return True


def _last_line(log: Path) -> str:
    lines = log.read_text("utf-8", "replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()), "it has said nothing")
