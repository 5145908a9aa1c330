"""What the docstrings under a struct's fields say, which Python itself throws away."""

import ast
import functools
import inspect
import re
import sys
from typing import Any

ROLE = re.compile(r":\w+:`~?([^`]+)`")


def remarks(cls: type[Any]) -> dict[str, str]:
    """Field → the docstring below it, as one line; a base class's where that only points there."""
    found: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if base.__module__.split(".")[0] not in ("builtins", "msgspec"):
            own = _below(base.__module__, base.__name__)
            found.update({field: text for field, text in own.items() if field not in found or text[:4] != "See "})
    return found


@functools.cache
def _below(module: str, name: str) -> dict[str, str]:
    found: dict[str, str] = {}
    for node in ast.walk(_tree(module)):
        if isinstance(node, ast.ClassDef) and node.name == name:
            for field, below in zip(node.body, node.body[1:], strict=False):
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                    text = _text(below)
                    found.update({field.target.id: one_line(text)} if text is not None else {})
    return found


def _text(node: ast.stmt) -> str | None:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
        return node.value.value
    return None


@functools.cache
def _tree(module: str) -> ast.Module:
    return ast.parse(inspect.getsource(sys.modules[module]))


def one_line(text: str) -> str:
    """A docstring as one line of Markdown, for a cell of a table too."""
    return ROLE.sub(r"`\1`", " ".join(text.split())).replace("``", "`").replace("|", "\\|")


def summary(cls: type[Any]) -> str:
    """The first paragraph of the class's docstring."""
    return one_line((cls.__doc__ or "").strip().split("\n\n")[0])
