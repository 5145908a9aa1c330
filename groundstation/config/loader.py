"""Configuration: one TOML file and ``--set`` overrides into frozen structs.

Any ``msgspec.Struct`` may be the root; types, ``msgspec.Meta`` bounds, ``Literal`` and tagged
unions are its schema; its ``FOREIGN_KEYS`` may say by which keys of another file a user has taken
that for it. A table needs only the keys that it changes. :func:`msgspec.convert` checks
everything, once; its errors are translated for the operator: the dotted key, what is accepted
there, and what was written instead.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import inspect as mi

from groundstation.config.config_notices import config_notice
from groundstation.config.errors import ConfigError, KeyPath, Problem, dotted_key, element_path
from groundstation.config.retired import drop_retired_keys
from groundstation.config.schema import (
    OpenFactory,
    default_of,
    describe_type,
    describe_unknown_key,
    describe_value,
    find_struct,
    inspect_struct,
    item_types,
    kinds,
    options,
    suggest,
    tags,
)
from groundstation.config.sections import resolve_files, with_files
from groundstation.config.toml_text import DEEPEST, parse_toml, read_toml

T = TypeVar("T", bound=msgspec.Struct)


def load(path: Path | None, root: type[T], overrides: Sequence[str] = ()) -> T:
    """Load the TOML file ``path`` (None: all defaults), changed by ``overrides`` (``a.b=value``).

    Raises:
        ConfigError: the file can't be read or is not TOML, or see :func:`from_dict`.
    """
    if path is None:
        return from_dict({}, root, overrides)
    return from_dict(
        resolve_files(read_toml(path), path.parent),
        root,
        overrides,
        source=str(path),
        folder=path.parent,
    )


def from_dict(
    data: Mapping[str, Any],
    root: type[T],
    overrides: Sequence[str] = (),
    *,
    source: str = "",
    folder: Path = Path(),
) -> T:
    """Make a ``root`` of ``data``, changed by ``overrides``; errors name ``source``.

    The value of an override is TOML (``3.5``, ``true``, ``[1, 2]``, ``"text"``), or else a plain
    string. One that gives a section another kind removes the keys of ``data`` that only the old
    kind has. Files that a section names are relative to ``folder``. Keys of earlier versions are
    left out, with a warning.

    Raises:
        ConfigError: an unknown key, a missing one, or a value outside its type or bounds; NaN and
            infinity always.
    """
    data = drop_retired_keys(data, source)
    changed = dict(data)
    set_paths = [_override(changed, text) for text in overrides]
    changed = drop_retired_keys(changed, "--set")
    switched = _switch(root, data, changed, set_paths)
    try:
        return convert(root, with_files(root, changed, folder))
    except Problem as problem:
        key = dotted_key(problem.path)
        if problem.path[:1] in switched and problem.text.startswith("missing"):
            raise ConfigError(
                key, config_notice("config.switched", why=problem.text, key=key), "--set"
            ) from None
        raise ConfigError(
            key, problem.text, _blame(problem.path, data, set_paths, source)
        ) from None


LARGEST = 2**63
"""Bound on the size of TOML's whole numbers: 64 bits."""


def convert(root: type[T], data: Mapping[str, Any]) -> T:
    """Convert ``data`` to a ``root``; a missing key of a table is as in the default of that table.

    Raises:
        Problem: the first fault in the order of ``data``; a missing key comes after its neighbours.
    """
    whole = _complete(inspect_struct(root), data, None, ())
    try:
        return msgspec.convert(whole, root)
    except msgspec.ValidationError as error:
        raise _translate(root, whole, str(error)) from None


def _complete(info: mi.Type, value: Any, default: Any, path: KeyPath) -> Any:
    """Complete ``value`` by the keys of ``default`` (a struct, or None); require finite numbers."""
    if isinstance(value, Mapping):
        struct = find_struct(info, value, default)
        if struct is None:
            inner = next(
                (kind.value_type for kind in options(info) if isinstance(kind, mi.DictType)), None
            )
            if inner is None:
                return value
            return {
                key: _complete(inner, item, None, (*path, str(key))) for key, item in value.items()
            }
        return _complete_table(
            struct, value, default if isinstance(default, struct.cls) else None, path
        )
    if isinstance(value, list | tuple):
        kinds_of_items = item_types(info, len(value))
        return [
            _complete(kind, item, None, element_path(path, i))
            for i, (kind, item) in enumerate(zip(kinds_of_items, value, strict=True))
        ]
    if (isinstance(value, float) and not math.isfinite(value)) or (
        isinstance(value, int) and abs(value) >= LARGEST
    ):
        raise Problem(path, _refuse(info, value))
    return value


def _complete_table(
    struct: mi.StructType, value: Mapping[str, Any], default: Any, path: KeyPath
) -> dict[str, Any]:
    if issubclass(struct.cls, OpenFactory):
        value = struct.cls.expand(dict(value))
    fields = {field.encode_name: field for field in struct.fields}
    tag = {} if struct.tag_field is None else {struct.tag_field: struct.tag}
    whole: dict[str, Any] = dict(tag)
    for key, item in value.items():
        if key in fields:
            base = (
                default_of(fields[key]) if default is None else getattr(default, fields[key].name)
            )
            whole[key] = _complete(fields[key].type, item, base, (*path, key))
        elif key not in tag:
            why = getattr(struct.cls, "FOREIGN_KEYS", {}).get(key)
            raise Problem((*path, key), why or describe_unknown_key(key, item, [*tag, *fields]))
    if default is not None:
        for key, field in fields.items():
            whole.setdefault(key, msgspec.to_builtins(getattr(default, field.name)))
    return whole


_STEP = re.compile(r"\.([^.\[\]`]+)|\[(\d+)\]|\[\.\.\.\]")
"""One step of a path as msgspec writes it: a struct's key, an array's place, or a table's key."""


def _translate(root: type[msgspec.Struct], whole: dict[str, Any], error: str) -> Problem:
    """Translate msgspec's ``error`` about ``whole`` into the operator's words."""
    text, _, where = error.partition(" - at `")
    info, path = inspect_struct(root), KeyPath()
    value: Any = whole
    for step in _STEP.finditer(where):
        name, index = step.groups()
        if index is not None:
            place = int(index)
            info, value, path = (
                item_types(info, len(value))[place],
                value[place],
                element_path(path, place),
            )
            continue
        struct = find_struct(info, value, None)
        if name is None:
            name = _find_wrong_key(root, whole, value, error)
            info = next(kind.value_type for kind in options(info) if isinstance(kind, mi.DictType))
        elif struct is None:  # the key of the kind is wrong
            known, tag = tags(info), value[name]
            return Problem(
                (*path, name),
                f"expected one of {known}, got {describe_value(tag)}{suggest(tag, known)}",
            )
        else:
            info = next(field.type for field in struct.fields if field.encode_name == name)
        value, path = value[name], (*path, name)
    struct = find_struct(info, value, None) if isinstance(value, dict) else None
    missing = (
        text.removeprefix("Object missing required field `").rstrip("`")
        if text.startswith("Object")
        else ""
    )
    if missing and struct is None:
        return Problem((*path, missing), f"missing; expected one of {tags(info)}")
    if struct is None:
        return Problem(path, _refuse(info, value))
    if missing:
        kind = next(field.type for field in struct.fields if field.encode_name == missing)
        return Problem((*path, missing), f"missing; expected {describe_type(kind)}")
    # Of a __post_init__: the key comes first if several are possible.
    name, colon, rest = text.partition(": ")
    return Problem((*path, name), rest) if colon and name in value else Problem(path, text)


def _find_wrong_key(
    root: type[msgspec.Struct], whole: dict[str, Any], table: dict[str, Any], error: str
) -> str:
    """Find the key of ``table``, somewhere in ``whole``, that alone causes ``error``: msgspec does
    not name it.
    """
    entries = dict(table)
    for key, item in entries.items():
        table.clear()
        table[key] = item
        try:
            msgspec.convert(whole, root)
        except msgspec.ValidationError as again:
            if str(again) == error:
                break
    table.update(entries)
    return key


def _refuse(info: mi.Type, value: Any) -> str:
    words = [
        word for kind in options(info) if isinstance(kind, mi.LiteralType) for word in kind.values
    ]
    return f"expected {describe_type(info)}, got {describe_value(value)}{suggest(value, words)}"


def _override(data: dict[str, Any], text: str) -> KeyPath:
    """Set ``a.b=value`` in ``data``, whose nested tables are copied, and return its path."""
    key, equals, value = text.partition("=")
    path = tuple(part.strip() for part in key.split("."))
    if not equals or not all(path):
        raise ConfigError("--set", config_notice("config.override", text=text))
    if len(path) > DEEPEST:
        raise ConfigError("--set", config_notice("config.depth", most=DEEPEST))
    table = data
    for part in path[:-1]:
        inner = table.get(part)
        table[part] = dict(inner) if isinstance(inner, dict) else {}
        table = table[part]
    table[path[-1]] = _toml_value(value.strip())
    return path


def _switch(
    root: type[msgspec.Struct],
    data: Mapping[str, Any],
    changed: dict[str, Any],
    set_paths: Sequence[KeyPath],
) -> list[KeyPath]:
    """Remove keys that only other kinds have from a section whose kind an override changes.

    Return the sections whose kind an override gives.
    """
    switched: list[KeyPath] = []
    for section, *rest in set_paths:
        tag_field, keys = kinds(root, section)
        table, written = changed[section], data.get(section)
        if rest != [tag_field] or not keys or not isinstance(table, dict):
            continue
        switched.append((section,))
        kind = table.get(tag_field)
        if (
            isinstance(kind, str)
            and kind in keys
            and isinstance(written, Mapping)
            and kind != written.get(tag_field)
        ):
            strange = set().union(*keys.values()) - keys[kind]
            kept = {
                key: value
                for key, value in table.items()
                if key not in strange or (section, key) in set_paths
            }
            changed[section] = kept
    return switched


_BARE_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.|\.[0-9]+)")


def _toml_value(text: str) -> Any:
    if _BARE_NUMBER.fullmatch(text):  # TOML wants digits on both sides of the point
        return float(text)
    try:
        parsed = parse_toml(f"value = {text}")
    except ValueError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


_ELEMENT = re.compile(r"(\[\d+\])+$")
"""End of the last part of a path to an element of an array, as :func:`element_path` writes it."""


def _blame(path: KeyPath, data: Any, set_paths: Iterable[KeyPath], source: str) -> str:
    """Name the source of the value at ``path``: an override, or else the file."""
    in_file = data
    path = (*path[:-1], _ELEMENT.sub("", path[-1])) if path else path
    for part in path:
        in_file = in_file[part] if isinstance(in_file, Mapping) and part in in_file else None
    for override in set_paths:
        if path[: len(override)] == override or (
            not isinstance(in_file, Mapping) and override[: len(path)] == path
        ):
            return "--set"
    return source
