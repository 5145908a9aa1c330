"""How a daemon is, in a file beside its socket: for monitors that can't attach."""

import asyncio
import json
import os
import sys
from contextlib import suppress
from glob import escape
from pathlib import Path

import msgspec

from groundstation.config import ConfigError
from groundstation.core.mission import IN_AIR
from groundstation.runtime import SERVICES, directory

WRITE_S = 1.0
"""How often it is written [s]."""
STALE_S = 3.5
"""An older one is of a daemon that hangs or is no more [s]."""
TICK_S = 1.0
"""In the air, a command is never so old [s]."""
EXIT_WELL, EXIT_ILL, EXIT_NOBODY = 0, 1, 2


class Health(msgspec.Struct, frozen=True):
    """One daemon at one instant."""

    vehicle: str
    state: str
    reason: str
    pid: int
    written_s: float
    """The machine's monotonic clock [s]: the same in all its processes."""
    tick_age_s: float | None
    """Age of the newest command of the controller [s]; None before the first of a flight."""
    flights: int
    """How many have been armed since it started."""
    refused: dict[str, int]
    """What clients have sent that was no order, by reason."""


def health_path(socket: Path) -> Path:
    """The file beside a socket."""
    return socket.with_suffix(".health.json")


class HealthFile:
    """Replaced as a whole, in two short steps. Never raises: a full disk is not the flight's trouble."""

    def __init__(self, path: Path) -> None:
        """Nothing is written yet."""
        self._path = path
        self._draft = path.with_suffix(".new")
        self._encode = msgspec.json.Encoder().encode

    def draft(self, health: Health) -> None:
        """Write it down, for nobody yet."""
        with suppress(OSError):
            number = os.open(self._draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600)
            try:
                os.write(number, self._encode(health) + b"\n")
            finally:
                os.close(number)

    def publish(self) -> None:
        """Put the draft in the file's place."""
        with suppress(OSError):
            self._draft.replace(self._path)

    def remove(self) -> None:
        """The daemon ends."""
        for path in (self._path, self._draft):
            with suppress(OSError):
                path.unlink()


def ill(health: Health, now_s: float) -> str:
    """What is wrong with it; empty for nothing."""
    age = now_s - health.written_s
    if not -0.1 <= age <= STALE_S:
        return f"stale: written {age:.1f} s ago, by process {health.pid}"
    if health.state in IN_AIR and (health.tick_age_s is None or health.tick_age_s > TICK_S):
        return f"{health.state}, but no command has left lately"
    return ""


def health_command(vehicle: str | None, socket: Path | None, *, as_json: bool) -> int:
    """Print how a daemon is; 0 where it is well, 1 where it is not, 2 where there is none."""
    try:
        path = health_path(socket) if socket is not None else _only(vehicle)
        health = msgspec.json.decode(path.read_bytes(), type=Health)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        print(f"groundstation: health: {error}", file=sys.stderr)
        return EXIT_NOBODY
    wrong = ill(health, asyncio.new_event_loop().time())
    if as_json:
        print(json.dumps({"well": not wrong, "why": wrong, **msgspec.to_builtins(health)}))
    else:
        print(f"{health.vehicle}: {wrong or 'well'}; {health.state}: {health.reason}")
    return EXIT_ILL if wrong else EXIT_WELL


def _only(vehicle: str | None) -> Path:
    """The file of ``vehicle``, or the only one.

    Raises:
        FileNotFoundError: there is none.
        ConfigError: there are several.
    """
    name = "*" if vehicle is None else escape(vehicle)
    found = [*directory().glob(f"{name}.health.json"), *SERVICES.glob(f"*/{name}.health.json")]
    if not found:
        raise FileNotFoundError(f"no daemon runs here (looked in {directory()} and {SERVICES})")
    if len(found) > 1:
        raise ConfigError("--vehicle", f"several daemons run here, name one: {', '.join(map(str, found))}")
    return found[0]
