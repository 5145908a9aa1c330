"""Entry point of a program: its commands, its exit codes, and output without a reader.

``--help`` waits for all imports here: no pathlib, no typing.
"""

import argparse
import contextlib
import errno
import gc
import importlib
import io
import os
import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum
from functools import cached_property
from types import MappingProxyType

from groundstation.runtime.packages import describe_install
from groundstation.runtime.version import __version__

TYPE_CHECKING = False  # typing's own would have to be imported, also for --help
if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any, TextIO


class Exit(IntEnum):
    """Exit codes of every program; :data:`CODES` has their meanings for one command."""

    DONE = 0
    """Landed, or the request was carried out."""
    FAILED = 1
    """Ended otherwise than requested: aborted, killed, refused, landed by a fault, or a finding."""
    USAGE = 2
    """A bad configuration or command line; nothing was opened."""
    NOBODY = 2  # of commands that only ask: nothing was begun either
    """No ground station is running."""
    TAKEN = 3
    """Another ground station flies this vehicle already."""
    UNHEARD = 3  # of commands that fly nothing: they can't begin either
    """No poses, or no answer of the vehicle."""
    INTERRUPTED = 130
    """Ctrl-C outside a flight."""


def run(
    parser: Callable[[], argparse.ArgumentParser],
    commands: str,
    moved: Mapping[str, str] = MappingProxyType({}),
    gone: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Run the command of the command line, by the function of that name in the module ``commands``.

    The exit code.

    ``moved``: old spelling of a command → its name today; the old one works, with advice by
        ``advise_name`` there.
    ``gone``: words that a command line no longer has, such as ``export --format rrd`` → what to do
    instead; the advice follows the error about them. If the reader of the output has gone
    (``| head``), or the disk is full, it ends without a traceback.
    """
    _open_missing_streams()
    with _guard_output():
        try:
            try:
                code = _execute(parser(), commands, moved)
                if code == Exit.USAGE:
                    _advise_gone(gone, moved)
                return code
            except SystemExit as left:  # argparse has refused the words
                if left.code == Exit.USAGE:
                    _advise_gone(gone, moved)
                raise
            finally:  # after --help, too, which leaves by SystemExit
                sys.stdout.flush()
        except OSError as error:
            if not isinstance(error, BrokenPipeError) and error.errno != errno.ENOSPC:
                raise
            # Otherwise Python complains of the rest of the output as it ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            if error.errno == errno.ENOSPC:
                print(f"the output cannot be written: {error.strerror}", file=sys.stderr)
            return Exit.FAILED


def _advise_gone(gone: Mapping[str, str], moved: Mapping[str, str]) -> None:
    """Tell the operator what replaces the words of the command line that are among ``gone``."""
    command, *rest = sys.argv[1:] or [""]
    line = " ".join([moved.get(command, command), *rest])
    words = line.replace("=", " ").replace(",", " ").split()
    for spelling, instead in gone.items():
        name = spelling.partition(" --")[0].split()
        if words[: len(name)] == name and set(words).issuperset(spelling.split()):
            from groundstation.config import config_notice

            print(config_notice("command.gone", words=spelling, instead=instead), file=sys.stderr)


def _open_missing_streams() -> None:
    """Open the standard streams that the parent has closed, to and from /dev/null.

    Else the next file or port that is opened gets the number of one of them, and the output.
    """
    while (fd := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(fd, True)
    os.close(fd)
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115  # until the end


class _GuardedStream:
    """A stream on which quoted text can't control the terminal: of control characters only line
    ends and tabs pass.
    """

    def __init__(self, stream: "TextIO") -> None:
        self.bare = stream

    def __getattr__(self, name: str) -> "Any":
        return getattr(self.bare, name)

    def write(self, text: str) -> int:
        shown = text
        if not text.replace("\n", "").replace("\t", "").isprintable():
            # Only now: it brings msgspec, for a third of the time that --help takes.
            from links.text import printable

            shown = printable(text, keep="\n\t")
        self.bare.write(shown)
        return len(text)

    def writelines(self, lines: "Any") -> None:
        # Else __getattr__ would lead past the guard.
        for line in lines:
            self.write(line)


def raw_stream(stream: "TextIO") -> "TextIO":
    """Return ``stream`` unguarded, for a program that draws with its own escape sequences."""
    return stream.bare if isinstance(stream, _GuardedStream) else stream


def _is_file(stream: "TextIO") -> bool:
    try:
        return stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
    except OSError:  # it has no descriptor, or a closed one
        return False


@contextlib.contextmanager
def _guard_output() -> Iterator[None]:
    """Guard standard output and standard error: printed text may come from a vehicle, a broker, or
    a recording.
    """
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")  # an invalid byte must not end the program
    before = sys.stdout, sys.stderr
    for stream in before:
        if isinstance(stream, io.TextIOWrapper) and stream.encoding.lower() not in (
            "utf-8",
            "utf8",
        ):
            if _is_file(stream):
                stream.reconfigure(encoding="utf-8")  # `config show > lab.toml` is read again
            else:
                stream.reconfigure(errors="replace")  # a terminal without ² shows ?
    sys.stdout, sys.stderr = map(_GuardedStream, before)  # all else is the stream's own
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def _execute(parser: argparse.ArgumentParser, commands: str, moved: Mapping[str, str]) -> int:
    words = sys.argv[1:]
    if not words:
        parser.print_help(sys.stderr)
        return Exit.USAGE
    if words[0] in moved:
        today = moved[words[0]]
        importlib.import_module(commands).advise_name(parser.prog, words[0], today)
        words[:1] = today.split()
    args = parser.parse_args(words)
    # Only now: --help must not wait for what a command needs.
    gc.disable()  # modules are never garbage: to look for any takes a fifth of the start
    import warnings

    from groundstation.config import (
        ArgumentError,
        ConfigError,
        RetiredKeyWarning,
        UserCodeFault,
        config_notice,
    )

    show = warnings.showwarning

    def show_advice(
        message: "Warning | str", category: type[Warning], *where: "Any", **more: "Any"
    ) -> None:
        if issubclass(category, RetiredKeyWarning):
            print(f"{parser.prog}: {message}", file=sys.stderr)
        else:
            show(message, category, *where, **more)

    warnings.showwarning = show_advice
    try:
        does = getattr(
            importlib.import_module(commands), args.command.replace("-", "_").replace(" ", "_")
        )
        gc.freeze()
        gc.enable()
        return int(does(args))
    except ConfigError as error:
        says = f"{error.option}: {error.problem}" if isinstance(error, ArgumentError) else error
        print(f"{parser.prog}: {says}", file=sys.stderr)
        return Exit.USAGE
    except OSError as error:
        if error.filename is None or error.errno not in PATH_ERRORS:
            raise
        unusable = config_notice("file.unusable", path=error.filename, why=error.strerror)
        print(f"{parser.prog}: {unusable}", file=sys.stderr)
        return Exit.USAGE
    except UserCodeFault as fault:
        print(f"{fault.frames()}{parser.prog}: {fault}", file=sys.stderr)
        return Exit.FAILED
    except KeyboardInterrupt:
        print(f"{parser.prog}: interrupted", file=sys.stderr)
        return Exit.INTERRUPTED
    finally:
        warnings.showwarning = show


PATH_ERRORS = (errno.EACCES, errno.ENAMETOOLONG)
"""Errors of the system with which pathlib.Path.exists ends: a path that a person has given."""

CODES: dict[str, dict[int, str]] = {
    "fly": {
        0: "landed",
        1: "aborted, killed, handed over, not confirmed, or landed because of a fault",
        3: "another ground station flies this vehicle already",
    },
    "daemon": {
        0: "SIGTERM or SIGINT ended it, with the vehicle landed or never armed; with `--once`: "
        "landed",
        1: "the last flight was aborted, killed or handed over, or something failed at the start",
        3: "another ground station flies this vehicle already, or its socket can't be served",
    },
    "fleet": {
        0: "every vehicle landed, or was never armed",
        1: "one of them was aborted, killed or handed over, landed because of a fault, or its "
        "core has died",
    },
    "daemon unit": {0: "the unit file is printed"},
    "request": {
        0: "done: the answer is printed",
        1: "refused: the reason is printed",
        2: "nobody there, or not clear who is meant",
    },
    "stop-all": {
        0: "every flight has answered, or none is there",
        1: "one did not answer, and got a signal; or `--kill` was not confirmed",
    },
    "daemon health": {
        0: "alive and well",
        1: "it hangs, or its link is lost in flight",
        2: "nobody flies",
    },
    "check": {
        0: "ready to fly",
        1: "a check fails, or (`--watch`) no poses, or too few",
        3: "(`--watch`) no such source",
    },
    "carry": {
        0: "the axes are found",
        1: "a move contradicts, or was not made",
        3: "no poses, or no autopilot",
    },
    "doctor": {
        0: "nothing to change",
        1: "something to change, or not confirmed",
        3: "no answer, or a refusal",
    },
    "props-off": {
        0: "passed, and kept on file",
        1: "not proven, interrupted, or it could not go on: the motors were ordered off",
        3: "another ground station flies this vehicle",
    },
    "trajectory": {0: "PASS", 1: "FAIL"},
    "identify": {0: "something was found", 1: "the flight shows nothing of thrust, lags and delay"},
    "replay": {
        0: "the same to the last bit (own recordings), or within its limits (.tlog)",
        1: "it differs, or the recording is damaged",
    },
}
"""Meanings of a command's exit codes; those not named here have 0 for done and 1 for not done. 2 is
usage in all of them."""


def require_package(package: str, key: str, extra: str, id: str = "package.needed") -> None:
    """Require an optional package, before any work is done that needs it in the end.

    Raises:
        ConfigError: it is not installed; by ``key``; the sentence ``id`` tells the command that
            installs the ``extra``.
    """
    from groundstation.config import ConfigError, config_notice

    try:
        importlib.import_module(package)
    except ImportError:
        raise ConfigError(
            key, config_notice(id, package=package, command=describe_install(extra))
        ) from None


Arguments = Mapping[str, Mapping[str, object]]
"""Name of each argument of a command → its options for
:meth:`argparse.ArgumentParser.add_argument`."""
AddArguments = Callable[[argparse.ArgumentParser], None]
Commands = Mapping[str, tuple[str, Arguments | AddArguments | None]]
"""Name → its purpose in a line, and its arguments, or a function that adds them; None: it only
groups other commands.

A name of two words (``fleet relay``) is a command below the first word.
"""


def add_arguments(
    parser: argparse.ArgumentParser, arguments: "Mapping[str, Mapping[str, Any]]"
) -> None:
    """Add ``arguments`` to ``parser``."""
    for name, options in arguments.items():
        parser.add_argument(name, **options)


def json_argument(other: str) -> "Mapping[str, Mapping[str, object]]":
    """The argument ``--json`` of a command that else prints ``other``."""
    return {"--json": {"action": "store_true", "help": f"print one JSON object instead of {other}"}}


Groups = Mapping[str, Commands]
"""Heading in the program's help → the commands below it."""


class Program(argparse.ArgumentParser):
    """The parser of a program or of one of its commands.

    Lists the commands below it by group in its help.

    A command with arguments of its own (``fleet``) may have others below it (``fleet relay``): the
    first word decides.
    """

    def __init__(
        self,
        prog: str = "",
        command: str = "",
        commands: Commands = MappingProxyType({}),
        program: "Program | None" = None,
        **words: "Any",
    ) -> None:
        """``command`` is its full name, and ``commands`` are all that there are.

        ``program`` is the one that it is a command of; None: it is the program itself.
        """
        super().__init__(prog, **words)
        self.program = program or self
        self.set_defaults(program=self.program)
        prefix = f"{command} " if command else ""
        self._commands = commands
        self._names = {
            name.removeprefix(prefix): name
            for name in commands
            if name.startswith(prefix) and " " not in name.removeprefix(prefix)
        }
        self.groups: Groups = (
            {"commands": {word: commands[name] for word, name in self._names.items()}}
            if self._names
            else {}
        )
        self.offers = False
        """Whether the commands below it are subcommands for argparse: those of a program only once
        its first word is none of them, as all their parsers are made for that."""
        if command:
            self.set_defaults(command=command)
            arguments = commands[command][1]
            if arguments is None:
                self.offer_below()
            elif isinstance(arguments, Mapping):
                add_arguments(self, arguments)
            else:
                arguments(self)

    def _make(self, word: str) -> "Program":
        """Make the parser of the command ``word`` below this one."""
        return Program(f"{self.prog} {word}", self._names[word], self._commands, self.program)

    @cached_property
    def below(self) -> "dict[str, Program]":
        """Parsers of the commands below this one by their last word, made where all are wanted."""
        return {word: self._make(word) for word in self._names}

    def offer_below(self) -> None:
        """Add the commands below this one as subcommands, once: completion reads them."""
        if self.offers:
            return
        parsers = self.add_subparsers(
            dest="command", required=True, metavar="COMMAND", parser_class=Program
        )
        for commands in self.groups.values():
            for name, (does, _) in commands.items():
                if " " not in name:
                    parsers.add_parser(name, help=does)
        parsers.choices.update(self.below)
        self.offers = True

    def parse_known_args(self, args: "Any" = None, namespace: "Any" = None) -> "Any":
        """Parse the arguments, or let the command below parse them that the first word names.

        An unknown argument is an error shown with the command's own usage.
        """
        if args and not self.offers and args[0] in self._names:
            return self._make(args[0]).parse_known_args(args[1:], namespace)
        if self.program is self:
            self.offer_below()
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            told = f"unrecognized arguments: {' '.join(unknown)}"
            takes_words = any(a.nargs == "*" and not a.option_strings for a in self._actions)
            if takes_words and not any(word.startswith("--") for word in unknown):
                from groundstation.config import config_notice

                told += f"; {config_notice('command.divided')}"
            self.error(told)
        return found, unknown

    def format_help(self) -> str:
        """Return the help text: usage, each group of commands, options."""
        if not self.groups:
            return super().format_help()
        if self.program is self:
            self.offer_below()
        formatter = self._get_formatter()
        formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
        formatter.add_text(self.description)
        for title, commands in self.groups.items():
            formatter.start_section(title)
            formatter.add_arguments(
                [
                    argparse.Action([], name, help=does)
                    for name, (does, _) in commands.items()
                    if " " not in name
                ]
            )
            formatter.end_section()
        own = [
            action for action in self._actions if not isinstance(action, argparse._SubParsersAction)
        ]
        formatter.start_section("options")
        formatter.add_arguments(own)
        formatter.end_section()
        return formatter.format_help()


def build_parser(prog: str, description: str, groups: Groups) -> Program:
    """Make the parser of the program ``prog``; the parsed arguments have it as ``program``."""
    commands = {name: entry for group in groups.values() for name, entry in group.items()}
    program = Program(prog, commands=commands, description=description)
    program.groups = groups
    program.add_argument(
        "--version", action="version", version=f"%(prog)s {__version__}", help="print the version"
    )
    return program


COMPLETION: Arguments = {"shell": {"choices": ["bash", "zsh"]}}
"""Arguments of the command ``completion``, which both programs have."""


def path(text: str) -> "Path":
    """Read an argument that is a file or a folder."""
    from pathlib import Path

    if not text:  # Path("") is the present folder
        from groundstation.config import config_notice

        raise argparse.ArgumentTypeError(str(config_notice("value.path")))
    return Path(text)


DAY_S = 86400
"""Longest length of time that an argument may state [s]: a day."""


def seconds(text: str) -> float:
    """Read an argument that is a length of time [s], at most a day."""
    from groundstation.config import config_notice, parse_number

    try:
        value = parse_number(text)
    except ValueError:
        value = float("nan")  # refused below
    if not 0.0 < value <= DAY_S:
        raise argparse.ArgumentTypeError(
            str(config_notice("value.seconds", above=0, most=DAY_S, found=text))
        )
    return value
