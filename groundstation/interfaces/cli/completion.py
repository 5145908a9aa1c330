"""Completion: scripts by which a shell completes our command lines. No key press runs any program of ours."""

import argparse
from collections.abc import Callable, Iterator
from typing import Any

import shtab

from groundstation.config import keys_of
from groundstation.interfaces.cli.program import LazyParser, path
from groundstation.settings import Config
from links.bridge import BridgeConfig

Words = Callable[[str, str], list[str]]
"""A command (``config new``) and the name of an argument of its → what that may be, as far as it can be listed."""

_DEFINITION = {
    "bash": """{name}() {{ compgen -W "{words}" -- "$1"; }}""",
    "zsh": """{name}() {{ compadd {no_space}-- {words}; }}""",
}
# A value follows `KEY=` at once. In bash `compopt` says so, from the function alone that bash itself calls.
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
    name = parser.prog.replace("-", "_")
    functions: dict[tuple[str, ...], str] = {}
    for command, action in _arguments(parser, ""):
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
            name=function, words=" ".join(choice), no_space="-S '' " if choice[0].endswith("=") else ""
        )
        for choice, function in functions.items()
    ]
    script = shtab.complete(parser, shell, preamble="\n".join(preamble))
    return script + (_BASH_END.format(name=name, prog=parser.prog) if shell == "bash" else "")


def _arguments(parser: argparse.ArgumentParser, command: str) -> Iterator[tuple[str, argparse.Action]]:
    """Every argument of every command."""
    for action in parser._actions:  # argparse has no public way to ask what it knows
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                if isinstance(inner, LazyParser):
                    action.choices[name] = inner.parser  # shtab takes nothing else for one
                yield from _arguments(inner, f"{command} {name}".strip())
        else:
            yield command, action


def words_of_flying(command: str, argument: str) -> list[str]:
    """See :data:`Words`, for ``groundstation``."""
    if argument == "overrides":
        return [f"{key}=" for key in keys_of(BridgeConfig if command == "rf-bridge" else Config)]
    if (command, argument) == ("config new", "name"):
        from groundstation.config import example_names

        return example_names()
    return []
