"""Sections of a configuration that stand in files of their own: a vehicle's file, a preset that comes along, a CSV.

They are read once, when the configuration is, so that what was checked is what flies; the configuration in force holds
what was in them and needs them no more.
"""

import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect as mi

from groundstation.config.schema import FromFile, KeyPath, Problem, described
from groundstation.config.words import bare

PACKAGE = "groundstation"
"""Where the presets stand."""
DEEPEST = 16
"""Tables and arrays stand within each other no deeper than this; ours need 5."""
TOO_DEEP = f"no configuration: its tables or arrays stand more than {DEEPEST} deep within each other"


def toml(text: str) -> dict[str, Any]:
    """What the TOML ``text`` says.

    Raises:
        ValueError: it is no TOML, or nested deeper than any configuration is.
    """
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
    info = described(root)
    assert isinstance(info, mi.StructType)
    changed = dict(data)
    for field in info.fields:
        table = data.get(field.encode_name)
        if isinstance(table, dict):
            kind = _kind(field, table)
            if kind is not None:
                changed[field.encode_name] = _read(kind, table, folder, (field.encode_name,))
    return changed


def beside(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """``data`` with the name of each key, password or certificate (``…_file = "name"``) as it is seen from ``folder``.

    The names become absolute, so that the configuration in force means the same wherever it is read again.
    """
    changed: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, dict):
            changed[key] = beside(value, folder)
        elif key.endswith("_file") and isinstance(value, str) and value:
            changed[key] = str(folder.absolute() / value)
        else:
            changed[key] = value
    return changed


def presets(kind: type[FromFile]) -> dict[str, str]:
    """The text of each preset of ``kind``, by name, in the order of their names."""
    if not kind.PRESETS:
        return {}
    files = sorted((resources.files(PACKAGE) / kind.PRESETS).iterdir(), key=lambda file: file.name)
    return {file.name.removesuffix(".toml"): file.read_text("utf-8") for file in files if file.name.endswith(".toml")}


def _kind(field: mi.Field, table: dict[str, Any]) -> type[FromFile] | None:
    """The struct of the section ``table`` if it may stand in a file."""
    info = bare(field.type)
    kinds = [bare(one) for one in info.types] if isinstance(info, mi.UnionType) else [info]
    for kind in kinds:
        if isinstance(kind, mi.StructType) and issubclass(kind.cls, FromFile):
            default = isinstance(field.default, kind.cls)
            tag = kind.tag if kind.tag_field is None else table.get(kind.tag_field, kind.tag if default else None)
            if tag == kind.tag:
                return kind.cls
    return None


def _read(kind: type[FromFile], table: dict[str, Any], folder: Path, path: KeyPath) -> dict[str, Any]:
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
        return _with_text(kind, rest, _text(folder / file, (*path, "file")), file, (*path, "file"))
    return table


def _with_text(kind: type[FromFile], table: dict[str, Any], text: str, name: str, path: KeyPath) -> dict[str, Any]:
    try:
        return kind.with_text(table, text)
    except ValueError as error:
        raise Problem(path, f"{name}: {error}") from None


def _text(file: Path, path: KeyPath) -> str:
    try:
        return file.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise Problem(path, f"cannot read {file}: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise Problem(path, f"{file} is not UTF-8 text (byte {error.start})") from None
    except ValueError as error:  # a name that no file can have
        raise Problem(path, f"cannot read {str(file)!r}: {error}") from None
