"""Configuration: one TOML file and ``--set`` overrides into frozen structs, and back into TOML.

Any ``msgspec.Struct`` may be the root; types, ``msgspec.Meta`` bounds, ``Literal`` and tagged unions are its schema.
A table needs only the keys that it changes: the rest comes from the field's default, also inside nested tables.
Some sections may name a file of their own (a vehicle, a CSV, a key): its path is relative to the configuration's.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from groundstation.config.files import beside, toml, with_files
from groundstation.config.schema import KeyPath, Problem, completed, dotted, kinds

T = TypeVar("T", bound=msgspec.Struct)


class ConfigError(Exception):
    """A bad configuration, as one line for the operator: ``source: key: problem``."""

    def __init__(self, key: str, problem: str, source: str = "") -> None:
        """Keep ``key`` (dotted, may be empty), ``problem``, and ``source`` (the file's name, or the override)."""
        super().__init__(": ".join(part for part in (source, key, problem) if part))
        self.key = key
        self.problem = problem
        self.source = source


def load(path: Path | None, root: type[T], overrides: Sequence[str] = ()) -> T:
    """The configuration in the TOML file ``path`` (None: all defaults), changed by ``overrides`` (``a.b=value``).

    Raises:
        ConfigError: the file can't be read or is not TOML, or see :func:`from_dict`.
    """
    if path is None:
        return from_dict({}, root, overrides)
    try:
        data = toml(path.read_bytes().decode())
    except OSError as error:
        raise ConfigError("", f"cannot read the configuration: {error.strerror}", str(path)) from None
    except UnicodeDecodeError as error:
        raise ConfigError("", f"not UTF-8 text (byte {error.start})", str(path)) from None
    except ValueError as error:
        raise ConfigError("", str(error), str(path)) from None
    return from_dict(beside(data, path.parent), root, overrides, source=str(path), folder=path.parent)


def from_dict(
    data: Mapping[str, Any], root: type[T], overrides: Sequence[str] = (), *, source: str = "", folder: Path = Path()
) -> T:
    """The configuration in ``data`` as a ``root``, changed by ``overrides``, ``source`` being named in errors.

    The value of an override is TOML (``3.5``, ``true``, ``[1, 2]``, ``"text"``), or else a string as it stands. One
    that gives a section another kind leaves out what ``data`` says there for the old kind alone.
    Files that a section names are relative to ``folder``.

    Raises:
        ConfigError: an unknown key, a missing one, or a value outside its type or bounds; NaN and infinity always.
    """
    changed: dict[str, Any] = dict(data)
    set_paths = [_override(changed, text) for text in overrides]
    told = _switch(root, data, changed, set_paths)
    try:
        complete = completed(root, with_files(root, changed, folder))
    except Problem as problem:
        if problem.path[:1] in told and problem.text.startswith("missing"):
            key = dotted(problem.path)
            raise ConfigError(key, f"{problem.text}; add --set {key}=VALUE", "--set") from None
        raise ConfigError(dotted(problem.path), problem.text, _blame(problem.path, data, set_paths, source)) from None
    try:
        return msgspec.convert(complete, root)
    except msgspec.ValidationError as error:  # what only a __post_init__ could see
        text, _, where = str(error).partition(" - at `$.")
        where = where.rstrip("`")
        name, colon, rest = text.partition(": ")
        if colon and not where and name in changed:  # of the root itself: its message begins with the key
            where, text = name, rest
        raise ConfigError(where, text, _blame(tuple(where.split(".")), data, set_paths, source)) from None


def dump(config: msgspec.Struct) -> str:
    """The configuration in force as TOML, each key with the first sentence of its docstring; loads back to the same.

    A key that is None has no TOML form and appears as a comment.
    """
    from groundstation.config.text import toml_text  # ast and tomli_w: only here

    return toml_text(config)


def _override(data: dict[str, Any], text: str) -> KeyPath:
    """Set ``a.b=value`` in ``data`` (whose nested tables are copied, never changed) and return its path."""
    key, equals, value = text.partition("=")
    path = tuple(part.strip() for part in key.split("."))
    if not equals or not all(path):
        raise ConfigError("", f"expected key=value, such as vehicle.mass_kg=0.08, got {text!r}", "--set")
    table = data
    for part in path[:-1]:
        inner = table.get(part)
        table[part] = dict(inner) if isinstance(inner, dict) else {}
        table = table[part]
    table[path[-1]] = _toml_value(value.strip())
    return path


def _switch(
    root: type[msgspec.Struct], data: Mapping[str, Any], changed: dict[str, Any], set_paths: Sequence[KeyPath]
) -> list[KeyPath]:
    """Where an override gives a section another kind, leave out the keys of ``data`` that only other kinds have.

    Returns the sections whose kind an override tells.
    """
    told: list[KeyPath] = []
    for section, *rest in set_paths:
        tag_field, keys = kinds(root, section)
        table, written = changed[section], data.get(section)
        if rest != [tag_field] or not keys or not isinstance(table, dict):
            continue
        told.append((section,))
        kind = table.get(tag_field)
        if isinstance(kind, str) and kind in keys and isinstance(written, Mapping) and kind != written.get(tag_field):
            strange = set().union(*keys.values()) - keys[kind]
            kept = {key: value for key, value in table.items() if key not in strange or (section, key) in set_paths}
            changed[section] = kept
    return told


def _toml_value(text: str) -> Any:
    try:
        parsed = toml(f"value = {text}")
    except ValueError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _blame(path: KeyPath, data: Any, set_paths: Iterable[KeyPath], source: str) -> str:
    """Who wrote the value at ``path``: an override, or else the file."""
    in_file = data
    for part in path:
        in_file = in_file[part] if isinstance(in_file, Mapping) and part in in_file else None
    for override in set_paths:
        if path[: len(override)] == override or (not isinstance(in_file, Mapping) and override[: len(path)] == path):
            return "--set"
    return source
