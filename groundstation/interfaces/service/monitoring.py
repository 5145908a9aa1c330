"""Monitoring of a daemon: log lines, and a health file beside its socket for monitors that can't attach."""

import asyncio
import json
import logging
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from enum import StrEnum
from glob import escape
from pathlib import Path

import msgspec

from groundstation.config import ConfigError
from groundstation.core.mission import IN_AIR
from groundstation.runtime import SERVICES, NonBlockingWriter, socket_folder

WRITE_S = 1.0
"""How often it is written [s]."""
STALE_S = 3.5
"""An older one is of a daemon that hangs or is no more [s]."""
TICK_S = 1.0
"""In the air, a command is never so old [s]."""
EXIT_WELL, EXIT_ILL, EXIT_NOBODY = 0, 1, 2


class DaemonHealth(msgspec.Struct, frozen=True):
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

    def draft(self, health: DaemonHealth) -> None:
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


def find_fault(health: DaemonHealth, now_s: float) -> str:
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
        health = msgspec.json.decode(path.read_bytes(), type=DaemonHealth)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        print(f"groundstation: health: {error}", file=sys.stderr)
        return EXIT_NOBODY
    wrong = find_fault(health, asyncio.new_event_loop().time())
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
    found = [*socket_folder().glob(f"{name}.health.json"), *SERVICES.glob(f"*/{name}.health.json")]
    if not found:
        raise FileNotFoundError(f"no daemon runs here (looked in {socket_folder()} and {SERVICES})")
    if len(found) > 1:
        raise ConfigError("--vehicle", f"several daemons run here, name one: {', '.join(map(str, found))}")
    return found[0]


class Format(StrEnum):
    """What a line looks like."""

    TEXT = "text"
    LOGFMT = "logfmt"
    """``level=info state=landing msg="..."``."""
    JSON = "json"


class LogHandler(logging.Handler):
    """Writes to a file descriptor only what it takes at once."""

    def __init__(self, number: int, style: Format, *, journal: bool) -> None:
        """``journal``: begin each line with its priority, ``<6>``, as sd-daemon(3) has it."""
        super().__init__()
        self._writer = NonBlockingWriter(number)
        self._style = style
        self._journal = journal

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line, or count it as lost."""
        try:
            lost = self._writer.lost
            if lost and self._write(logging.WARNING, f"{lost} log lines were lost: nobody read them"):
                self._writer.lost = 0
            if not self._write(record.levelno, record.getMessage()):
                self._writer.lost += 1
        except Exception:  # noqa: BLE001  # a log must not end a flight
            self._writer.lost += 1

    def _write(self, level: int, message: str) -> bool:
        return self._writer.write(line_of(level, message, self._style, journal=self._journal))


def line_of(level: int, message: str, style: Format, *, journal: bool) -> str:
    """One line: ``level`` is logging's."""
    message = " ".join(message.split("\n"))
    prefix = f"<{_PRIORITY.get(level, 6)}>" if journal else ""
    name = logging.getLevelName(level)
    match style:
        case Format.TEXT:
            return prefix + (message if journal else f"{name} {message}")
        case Format.LOGFMT:
            return f"{prefix}level={name.lower()} msg={json.dumps(message, ensure_ascii=False)}"
        case Format.JSON:
            return prefix + json.dumps({"level": name.lower(), "msg": message}, ensure_ascii=False)


_PRIORITY = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}


def is_journal(number: int, environment: Mapping[str, str] = os.environ) -> bool:
    """Whether what is written to ``number`` goes to the journal (systemd.exec(5), ``$JOURNAL_STREAM``)."""
    info = os.fstat(number)
    return environment.get("JOURNAL_STREAM", "") == f"{info.st_dev}:{info.st_ino}"


def level_of(line: str) -> int:
    """How grave a line for the operator is, by its first word after the time."""
    words = line.split(" ", 1)
    text = words[1] if len(words) == 2 and words[0].replace(".", "", 1).isdigit() else line
    return logging.WARNING if text.lower().startswith(GRAVE) else logging.INFO


GRAVE = ("warning", "aborted", "killed", "handed_over", "descent", "not ", "pre-flight", "bringing down")
