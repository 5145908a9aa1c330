"""Every command of both programs, with its arguments."""

import argparse
from collections.abc import Iterator
from typing import Any

from groundstation.__main__ import parser as flying
from sim.__main__ import parser as simulating

HEAD = """# Commands

`groundstation` is the real thing; `groundstation-sim` simulates everything. Both explain themselves with `--help`. A
wrong argument or configuration ends them with code 2 and a line that says what is expected."""


def page() -> str:
    """The page."""
    return "\n\n".join([HEAD, *_commands(flying()), *_commands(simulating())])


def _commands(parser: argparse.ArgumentParser, help_: str = "", level: int = 2) -> Iterator[str]:
    # argparse has no public way to ask what it knows.
    inner = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    yield f"{'#' * level} `{parser.prog}`\n\n{_sentence(parser.description or help_)}".rstrip()
    rows = [_row(action) for action in parser._actions if action not in inner and action.dest != "help"]
    if rows:
        yield "\n".join(["| argument | |", "|---|---|", *rows])
    for action in inner:
        helps = {choice.dest: choice.help or "" for choice in action._choices_actions}
        for name, command in action.choices.items():
            yield from _commands(command, helps.get(name, ""), level + 1)


def _row(action: argparse.Action) -> str:
    value: Any = action.metavar or (f"{{{','.join(map(str, action.choices))}}}" if action.choices else "")
    if not value and action.nargs != 0:
        value = action.dest.upper()
    names = ", ".join(f"{name} {value}".strip() for name in action.option_strings) or str(value)
    return f"| `{names}` | {_sentence(action.help or '')} |".replace("{", "(").replace("}", ")")


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:].removesuffix('.')}.".replace("|", "\\|").replace("%%", "%") if text else ""
