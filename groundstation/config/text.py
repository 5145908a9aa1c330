"""A configuration as annotated TOML: every key in force, beside the first sentence of its docstring."""

import ast
import linecache
import re
import sys
from collections.abc import Iterator
from functools import cache
from typing import Any

import msgspec
import tomli_w


def toml_text(config: msgspec.Struct) -> str:
    """The TOML of ``config``; a key that is None appears as a comment, as TOML has no word for it."""
    return "\n".join(_table(config, ())).lstrip("\n") + "\n"


def _table(table: msgspec.Struct | dict[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    """The lines of one table: its own keys first, then its sub-tables, as TOML's order demands."""
    notes = field_notes(type(table)) if isinstance(table, msgspec.Struct) else {}
    entries = dict(_entries(table))
    if path:
        yield f"\n[{'.'.join(map(_key, path))}]"
    for key, value in entries.items():
        if _is_table(value):
            continue
        line = f"# {_key(key)} is not set" if value is None else f"{_key(key)} = {_value(value)}"
        note = notes.get(key, "")
        yield f"{line}{'. ' if value is None else '  # '}{note}" if note else line
    for key, value in entries.items():
        if _is_table(value):
            yield from _table(value, (*path, key))


def _entries(table: msgspec.Struct | dict[str, Any]) -> Iterator[tuple[str, Any]]:
    if isinstance(table, dict):
        yield from table.items()
        return
    settings = table.__struct_config__
    if settings.tag_field is not None:
        yield settings.tag_field, settings.tag
    for field in msgspec.structs.fields(table):
        yield field.encode_name, getattr(table, field.name)


def _is_table(value: Any) -> bool:
    return isinstance(value, msgspec.Struct | dict)


def _value(value: Any) -> str:
    """One value on one line."""
    if _is_table(value):
        items = ", ".join(f"{_key(key)} = {_value(item)}" for key, item in _entries(value) if item is not None)
        return f"{{ {items} }}" if items else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_value, value))}]"
    return tomli_w.dumps({"v": msgspec.to_builtins(value)}).removeprefix("v = ").rstrip("\n")


def _key(key: str) -> str:
    return tomli_w.dumps({key: 0}).removesuffix(" = 0\n")


@cache
def field_notes(struct: type[msgspec.Struct]) -> dict[str, str]:
    """The first sentence of the docstring of each field, by key; empty where the source can't be read."""
    found: dict[str, str] = {}
    for cls in reversed(struct.__mro__):
        body = _definition(cls)
        if body is None:
            continue
        for field, note in zip(body.body, body.body[1:], strict=False):
            match field, note:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    found[name] = _sentence(text)
    return {field.encode_name: found[field.name] for field in msgspec.structs.fields(struct) if field.name in found}


def _definition(cls: type) -> ast.ClassDef | None:
    """The source of a class of a module, parsed alone: :mod:`inspect` parses all of its module to find it."""
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    lines = linecache.getlines(file) if file is not None else []
    head = re.compile(rf"class {re.escape(cls.__qualname__)}\b")
    first = next((n for n, line in enumerate(lines) if head.match(line)), None)
    if first is None:
        return None
    ends = (n for n in range(first + 1, len(lines)) if lines[n][0] not in " )\n#")
    try:
        (body,) = ast.parse("".join(lines[first : next(ends, len(lines))])).body
    except SyntaxError:
        return None
    return body if isinstance(body, ast.ClassDef) else None


def _sentence(text: str) -> str:
    words = " ".join(text.split()).replace("``", "`")
    end = words.find(". ")
    return words if end < 0 else words[: end + 1]
