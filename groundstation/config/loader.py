"""Configuration: one TOML file and ``--set`` overrides into frozen structs, and back into TOML.

Any ``msgspec.Struct`` may be the root; types, ``msgspec.Meta`` bounds, ``Literal`` and tagged unions are its schema.
A table needs only the keys that it changes: the rest comes from the field's default, also inside nested tables.
Some sections may stand in a file of their own (a vehicle, a preset that comes along, a CSV): its path is relative to
the configuration's. It is read once, when the configuration is, so that what was checked is what flies; the
configuration in force holds what was in it and needs it no more. As text it has every key in force, beside the first
sentence of its docstring.
"""

import linecache
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec
import tomli_w
from msgspec import inspect as mi

from groundstation.config.schema import (
    ConfigError,
    FromFile,
    KeyPath,
    Problem,
    complete,
    dotted_key,
    inspect_struct,
    kinds,
    locate,
    strip_metadata,
)

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

PACKAGE = "groundstation"
"""Where the presets stand."""
DEEPEST = 16
"""Tables and arrays stand within each other no deeper than this; ours need 5."""
TOO_DEEP = f"no configuration: its tables or arrays stand more than {DEEPEST} deep within each other"


def parse_toml(text: str) -> dict[str, Any]:
    """What the TOML ``text`` says.

    Raises:
        ValueError: it is no TOML, or nested deeper than any configuration is.
    """
    import tomllib

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"not valid TOML: {error}") from None
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    inside: list[Any] = [data]
    for _ in range(DEEPEST):
        inside = [one for item in inside for one in (item.values() if isinstance(item, dict) else item)]
        inside = [one for one in inside if isinstance(one, dict | list)]
        if not inside:
            return data
    raise ValueError(TOO_DEEP)


def with_files(root: type[msgspec.Struct], data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """``data`` with each section that names a ``preset`` or a ``file`` completed from it.

    Args:
        root: the configuration's type; its fields are the sections.
        data: what was written.
        folder: what the names of files are relative to.

    Raises:
        Problem: a file can't be read, or its text is wrong; the path is that of the key that names it.
    """
    info = inspect_struct(root)
    assert isinstance(info, mi.StructType)
    changed = dict(data)
    for field in info.fields:
        table = data.get(field.encode_name)
        if isinstance(table, dict):
            kind = _kind(field, table)
            if kind is not None:
                changed[field.encode_name] = _read_section(kind, table, folder, (field.encode_name,))
    return changed


def resolve_files(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """``data`` with the name of each key, password or certificate (``…_file = "name"``) as it is seen from ``folder``.

    The names become absolute, so that the configuration in force means the same wherever it is read again.
    """
    changed: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, dict):
            changed[key] = resolve_files(value, folder)
        elif key.endswith("_file") and isinstance(value, str) and value:
            changed[key] = str(folder.absolute() / value)
        else:
            changed[key] = value
    return changed


def presets(kind: type[FromFile]) -> dict[str, str]:
    """The text of each preset of ``kind``, by name, in the order of their names."""
    if not kind.PRESETS:
        return {}
    files = sorted(_folder(kind.PRESETS).iterdir(), key=lambda file: file.name)
    return {file.name.removesuffix(".toml"): file.read_text("utf-8") for file in files if file.name.endswith(".toml")}


def _kind(field: mi.Field, table: dict[str, Any]) -> type[FromFile] | None:
    """The struct of the section ``table`` if it may stand in a file."""
    info = strip_metadata(field.type)
    kinds = [strip_metadata(one) for one in info.types] if isinstance(info, mi.UnionType) else [info]
    for kind in kinds:
        if isinstance(kind, mi.StructType) and issubclass(kind.cls, FromFile):
            default = isinstance(field.default, kind.cls)
            tag = kind.tag if kind.tag_field is None else table.get(kind.tag_field, kind.tag if default else None)
            if tag == kind.tag:
                return kind.cls
    return None


def _read_section(kind: type[FromFile], table: dict[str, Any], folder: Path, path: KeyPath) -> dict[str, Any]:
    preset, file = table.get("preset"), table.get("file")
    rest = {key: value for key, value in table.items() if key not in ("preset", "file")}
    if kind.PRESETS and isinstance(preset, str):
        if file is not None:
            raise Problem((*path, "file"), "preset and file exclude each other; a file may name a preset itself")
        known = presets(kind)
        if preset not in known:
            raise Problem((*path, "preset"), f"expected one of {list(known)}, got {preset!r}")
        return _with_text(kind, rest, known[preset], preset, (*path, "preset"))
    if isinstance(file, str):
        return _with_text(kind, rest, _read_text(folder / file, (*path, "file")), file, (*path, "file"))
    return table


def _with_text(kind: type[FromFile], table: dict[str, Any], text: str, name: str, path: KeyPath) -> dict[str, Any]:
    try:
        return kind.with_text(table, text)
    except ValueError as error:
        raise Problem(path, f"{name}: {error}") from None


def _read_text(file: Path, path: KeyPath) -> str:
    try:
        return file.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise Problem(path, f"cannot read {file}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise Problem(path, f"{file} is not UTF-8 text (byte {error.start})") from None
    except ValueError as error:  # a name that no file can have
        raise Problem(path, f"cannot read {str(file)!r}: {error}") from None


T = TypeVar("T", bound=msgspec.Struct)


def load(path: Path | None, root: type[T], overrides: Sequence[str] = ()) -> T:
    """The configuration in the TOML file ``path`` (None: all defaults), changed by ``overrides`` (``a.b=value``).

    Raises:
        ConfigError: the file can't be read or is not TOML, or see :func:`from_dict`.
    """
    if path is None:
        return from_dict({}, root, overrides)
    return from_dict(resolve_files(read_toml(path), path.parent), root, overrides, source=str(path), folder=path.parent)


def read_toml(path: Path) -> dict[str, Any]:
    """What the TOML file ``path`` says.

    Raises:
        ConfigError: it can't be read, or is not TOML.
    """
    try:
        return parse_toml(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise ConfigError("", f"cannot read the configuration: {error.strerror}", str(path)) from None
    except UnicodeDecodeError as error:
        raise ConfigError("", f"not UTF-8 text (byte {error.start})", str(path)) from None
    except ValueError as error:
        raise ConfigError("", str(error), str(path)) from None


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
        whole = complete(root, with_files(root, changed, folder))
    except Problem as problem:
        if problem.path[:1] in told and problem.text.startswith("missing"):
            key = dotted_key(problem.path)
            raise ConfigError(key, f"{problem.text}; add --set {key}=VALUE", "--set") from None
        raise ConfigError(
            dotted_key(problem.path), problem.text, _blame(problem.path, data, set_paths, source)
        ) from None
    try:
        return msgspec.convert(whole, root)
    except msgspec.ValidationError as error:  # what only a __post_init__ could see
        where, text = locate(error)
        path = tuple(where.split(".")) if where else ()
        name, colon, rest = text.partition(": ")
        if colon and name in _keys_at(whole, path):  # where several could be meant, the message begins with the key
            path, text = (*path, name), rest
        raise ConfigError(dotted_key(path), text, _blame(path, data, set_paths, source)) from None


def _keys_at(table: Any, path: KeyPath) -> Sequence[str]:
    for part in path:
        table = table.get(part) if isinstance(table, dict) else None
    return list(table) if isinstance(table, dict) else []


def dump(config: msgspec.Struct) -> str:
    """The configuration in force as TOML, each key with the first sentence of its docstring; loads back to the same.

    A key that is None has no TOML form and appears as a comment.
    """
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
        parsed = parse_toml(f"value = {text}")
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


def _folder(name: str) -> "Traversable":
    """A folder of files that come along."""
    from importlib import resources

    return resources.files(PACKAGE) / name


def example_names() -> list[str]:
    """The names of the configurations, in their order."""
    return sorted(
        file.name.removesuffix(".toml") for file in _folder("examples").iterdir() if file.name.endswith(".toml")
    )


def list_examples() -> str:
    """A line each: its name, and what it says first of itself."""
    names = example_names()
    width = max(map(len, names))
    return "\n".join(f"{name:{width}}  {example_text(name).splitlines()[0].removeprefix('# ')}" for name in names)


def example_text(name: str) -> str:
    """The configuration of that name, with its notes.

    Raises:
        ConfigError: there is none.
    """
    if name not in example_names():
        raise ConfigError("config new", f"expected one of {example_names()}, got {name!r}")
    return (_folder("examples") / f"{name}.toml").read_text("utf-8")


def copy_examples(folder: Path) -> None:
    """Write all of them, and the files beside them, into the new ``folder``.

    Raises:
        ConfigError: it exists, or can't be written.
    """
    try:
        _copy(_folder("examples"), folder)
    except OSError as error:
        raise ConfigError("--all", f"cannot write {error.filename}: {error.strerror}") from None


def _copy(source: "Traversable", target: Path) -> None:
    if source.is_dir():
        target.mkdir()
        for each in source.iterdir():
            _copy(each, target / each.name)
    else:
        target.write_bytes(source.read_bytes())


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


_FIELD = re.compile(r'^    (\w+): .*\n(?:(?:     .*|    [)\]}#].*)?\n)*    """(\S[\s\S]*?)"""', re.MULTILINE)
"""A field of a class, and its docstring: parsing all of them takes the time of a second of flight."""


@cache
def field_notes(struct: type[msgspec.Struct]) -> dict[str, str]:
    """The first sentence of the docstring of each field, by key; empty where the source can't be read."""
    found: dict[str, str] = {}
    for cls in reversed(struct.__mro__):
        for name, text in _FIELD.findall(_definition(cls)):
            found[name] = _sentence(text)
    return {field.encode_name: found[field.name] for field in msgspec.structs.fields(struct) if field.name in found}


def _definition(cls: type) -> str:
    """The source of a class of a module; empty where it can't be read."""
    file = getattr(sys.modules.get(cls.__module__), "__file__", None)
    lines = linecache.getlines(file) if file is not None else []
    heads = (f"class {cls.__qualname__}(", f"class {cls.__qualname__}:")
    first = next((n for n, line in enumerate(lines) if line.startswith(heads)), len(lines))
    ends = (n for n in range(first + 1, len(lines)) if lines[n][0] not in " )\n#")
    return "".join(lines[first : next(ends, len(lines))])


def _sentence(text: str) -> str:
    words = " ".join(text.split()).replace("``", "`")
    end = words.find(". ")
    return words if end < 0 else words[: end + 1]
