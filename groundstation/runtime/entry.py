"""How a program begins and ends: its commands, its exit codes, and output that nobody takes."""

import argparse
import contextlib
import errno
import importlib
import os
import sys
from collections.abc import Callable, Iterator

from links.core import printable

TYPE_CHECKING = False  # typing's own would have to be imported, also for --help
if TYPE_CHECKING:
    from typing import Any, TextIO

UNREAD = 1
"""Exit code of a program whose output nobody takes."""


def run(parser: Callable[[], argparse.ArgumentParser], commands: str) -> int:
    """Do what the command line says, by the function of that name in the module ``commands``; the exit code.

    Where whoever reads the output has gone (``| head``), or the disk is full, it ends without a trace.
    """
    with _unsteered():
        return _run(parser, commands)


class _Unsteered:
    """A stream on which nothing steers a terminal, whatever is quoted there: only lines and tabs pass of controls."""

    def __init__(self, stream: "TextIO") -> None:
        self.bare = stream

    def __getattr__(self, name: str) -> "Any":
        return getattr(self.bare, name)

    def write(self, text: str) -> int:
        self.bare.write(printable(text, keep="\n\t"))
        return len(text)

    def writelines(self, lines: "Any") -> None:
        for line in lines:
            self.write(line)


def bare(stream: "TextIO") -> "TextIO":
    """``stream`` as it was, for what draws with escape sequences of its own and quotes nobody unwashed."""
    return stream.bare if isinstance(stream, _Unsteered) else stream


@contextlib.contextmanager
def _unsteered() -> Iterator[None]:
    """Guard standard output and standard error: what is printed may come from a vehicle, a broker, or a recording."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = map(_Unsteered, before)  # all else is the stream's own
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _run(parser: Callable[[], argparse.ArgumentParser], commands: str) -> int:
    try:
        code = _done(parser(), commands)
        sys.stdout.flush()
    except BrokenPipeError:
        _hush()
        return UNREAD
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        _hush()
        print(f"the output cannot be written: {error.strerror}", file=sys.stderr)
        return UNREAD
    return code


def _done(parser: argparse.ArgumentParser, commands: str) -> int:
    if len(sys.argv) == 1:
        parser.print_help(sys.stderr)
        return 2
    args = parser.parse_args()
    # Only now: --help must not wait for what a command needs.
    from groundstation.config import ConfigError

    does = getattr(importlib.import_module(commands), args.command.replace("-", "_"))
    try:
        return int(does(args))
    except ConfigError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{parser.prog}: interrupted", file=sys.stderr)
        return 130


def _hush() -> None:
    """What is still to be written goes nowhere: Python would complain of it at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
