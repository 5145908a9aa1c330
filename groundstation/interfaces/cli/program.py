"""The command line of a program: its commands, each with what gives it its arguments when they are asked for.

Whoever asks for help waits for what this imports: no pathlib, no typing, and not what argparse itself imports to see
how wide the terminal is.
"""

import argparse
import os
from collections.abc import Callable, Mapping
from functools import cached_property, partial

from groundstation.runtime import __version__

TYPE_CHECKING = False  # typing's own would have to be imported
if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any

AddArguments = Callable[[argparse.ArgumentParser], None]
Commands = Mapping[str, tuple[str, AddArguments]]
"""Name → what it does, in a line, and what gives its parser its arguments."""


def build_parser(prog: str, description: str, commands: Commands) -> argparse.ArgumentParser:
    """The parser of the program ``prog``; what it makes of a command line has it as ``program``."""
    formatter = partial(argparse.HelpFormatter, width=_width())
    program = argparse.ArgumentParser(prog, description=description, formatter_class=formatter)
    program.set_defaults(program=program)
    program.add_argument("--version", action="version", version=f"%(prog)s {__version__}", help="print it, and end")
    parsers = program.add_subparsers(
        dest="command", required=True, metavar="COMMAND",
        parser_class=LazyParser,  # type: ignore[type-var]  # as good as one
    )  # fmt: skip
    for name, (does, add_arguments) in commands.items():
        parsers.add_parser(name, help=does, formatter_class=formatter, add_arguments=add_arguments)
    return program


def add_completion(parser: argparse.ArgumentParser) -> None:
    """The arguments of the command ``completion``, which both programs have."""
    parser.add_argument("shell", choices=["bash", "zsh"])


class LazyParser:
    """The parser of one command, made when something is asked of it: help of the program asks nothing of any."""

    def __init__(self, add_arguments: AddArguments, **words: "Any") -> None:
        self._add_arguments = add_arguments
        self._words = words

    @cached_property
    def parser(self) -> argparse.ArgumentParser:
        """The parser itself."""
        parser = argparse.ArgumentParser(**self._words)
        self._add_arguments(parser)
        return parser

    def __getattr__(self, name: str) -> "Any":
        return getattr(self.parser, name)

    def parse_known_args(self, args: "Any" = None, namespace: "Any" = None) -> "Any":
        """Those of the command; what it does not know is an error of its own, beside its own usage."""
        return self.parser.parse_args(args, namespace), []

    def _check_help(self, action: argparse.Action) -> None:
        """Python 3.14 looks here whether the help of each command may be formatted: it would make them all."""


def _width() -> int:
    """The columns that help may take, as argparse reckons them."""
    try:
        columns = int(os.environ.get("COLUMNS", "0"))
    except ValueError:
        columns = 0
    if columns <= 0:
        try:
            columns = os.get_terminal_size().columns  # of standard output; 0 where it does not know
        except OSError:
            columns = 0
    return (columns or 80) - 2


def path(text: str) -> "Path":
    """The type of an argument that is a file or a folder."""
    from pathlib import Path

    return Path(text)
