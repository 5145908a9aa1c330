"""Log lines for a terminal, a journal or a collector; a reader that is stuck loses lines, and holds up nobody."""

import json
import logging
import os
from collections.abc import Mapping
from enum import StrEnum

from groundstation.runtime import Outlet


class Format(StrEnum):
    """What a line looks like."""

    TEXT = "text"
    LOGFMT = "logfmt"
    """``level=info state=landing msg="..."``."""
    JSON = "json"


class Lines(logging.Handler):
    """Writes to a file descriptor only what it takes at once."""

    def __init__(self, number: int, style: Format, *, journal: bool) -> None:
        """``journal``: begin each line with its priority, ``<6>``, as sd-daemon(3) has it."""
        super().__init__()
        self._outlet = Outlet(number)
        self._style = style
        self._journal = journal

    def emit(self, record: logging.LogRecord) -> None:
        """Write one line, or count it as lost."""
        try:
            lost = self._outlet.lost
            if lost and self._write(logging.WARNING, f"{lost} log lines were lost: nobody read them"):
                self._outlet.lost = 0
            if not self._write(record.levelno, record.getMessage()):
                self._outlet.lost += 1
        except Exception:  # noqa: BLE001  # a log must not end a flight
            self._outlet.lost += 1

    def _write(self, level: int, message: str) -> bool:
        return self._outlet.write(line_of(level, message, self._style, journal=self._journal))


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
