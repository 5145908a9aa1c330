"""Sections of a configuration with a file of their own, and the files that come along.

The path of such a file (a vehicle, a preset, a CSV) is relative to the configuration's: it is read
once, so that the checked values are those that fly.
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import msgspec
from msgspec import inspect as mi

from groundstation.config.config_notices import config_notice
from groundstation.config.errors import ConfigError, KeyPath, Problem, refuse_io
from groundstation.config.schema import default_of, find_struct, inspect_struct, suggest
from groundstation.config.toml_text import read_text

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable


class FromFile:
    """Base of a section of a configuration whose keys may be in a file that its key ``file`` names.

    Such a struct has the optional key ``file``, and ``preset`` if it has :attr:`PRESETS`. Both are
    gone once read.
    """

    __slots__ = ()
    PRESETS: ClassVar[str] = ""
    """Folder of the package with a file for each preset; empty without any."""

    @classmethod
    def with_text(cls, table: dict[str, Any], text: str) -> dict[str, Any]:
        """Return the section as written, ``table``, completed from the text of its file.

        Raises:
            ValueError: the fault of the text, and its line or key; without the file's name.
        """
        raise NotImplementedError


def with_files(root: type[msgspec.Struct], data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """``data`` with each section that names a ``preset`` or a ``file`` completed from it.

    Args:
        root: the configuration's type; its fields are the sections.
        data: what was written.
        folder: what the names of files are relative to.

    Raises:
        Problem: a file can't be read, or its text is wrong; the path is that of the key that names
            it.
    """
    info = inspect_struct(root)
    assert isinstance(info, mi.StructType)
    changed = dict(data)
    for field in info.fields:
        table = data.get(field.encode_name)
        if isinstance(table, dict):
            struct = find_struct(field.type, table, default_of(field))
            if struct is not None and issubclass(struct.cls, FromFile):
                changed[field.encode_name] = _read_section(
                    struct.cls, table, folder, (field.encode_name,)
                )
    return changed


def resolve_files(data: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return ``data`` with the name of each key, password or certificate (``…_file = "name"``)
    resolved in ``folder``.

    The names become absolute, so that the configuration means the same wherever it is read.
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
    """Return the text of each preset of ``kind``, by name, in the order of their names."""
    return shipped_texts(kind.PRESETS) if kind.PRESETS else {}


def _read_section(
    kind: type[FromFile], table: dict[str, Any], folder: Path, path: KeyPath
) -> dict[str, Any]:
    preset, file = table.get("preset"), table.get("file")
    rest = {key: value for key, value in table.items() if key not in ("preset", "file")}
    if kind.PRESETS and isinstance(preset, str):
        if file is not None:
            raise Problem((*path, "file"), config_notice("config.two_sources"))
        known = presets(kind)
        if preset not in known:
            nearest = suggest(preset, known)
            problem = config_notice(
                "config.unknown_name", choices=list(known), found=preset, nearest=nearest
            )
            raise Problem((*path, "preset"), problem)
        key, name, text = "preset", preset, known[preset]
    elif isinstance(file, str):
        key, name, text = "file", file, _read_text(folder / file, (*path, "file"))
    else:
        return table
    try:
        return kind.with_text(rest, text)
    except ValueError as error:
        raise Problem((*path, key), config_notice("value.refused", value=name, why=error)) from None


def _read_text(file: Path, path: KeyPath) -> str:
    try:
        return read_text(file)
    except OSError as error:
        raise Problem(path, config_notice("file.unread", path=file, why=error.strerror)) from None
    except UnicodeDecodeError as error:
        why = config_notice("file.not_utf8", at=error.start)
        raise Problem(path, config_notice("value.refused", value=file, why=why)) from None
    except ValueError as error:  # a name that no file can have
        raise Problem(path, config_notice("file.unread", path=repr(str(file)), why=error)) from None


def _find_shipped(folder: str) -> "Traversable":
    """Return a folder that comes along."""
    from importlib import resources  # with what it brings, milliseconds of every start

    return resources.files("groundstation") / folder


def shipped_texts(folder: str) -> dict[str, str]:
    """Return the text of each TOML file in a folder that comes along, by name and in the order of
    their names.
    """
    files = [file for file in _find_shipped(folder).iterdir() if file.name.endswith(".toml")]
    texts = {file.name.removesuffix(".toml"): file.read_text("utf-8") for file in files}
    return dict(sorted(texts.items()))


def list_examples() -> str:
    """Return a line for each configuration that comes along: its name, and its first line."""
    texts = shipped_texts("examples")
    width = max(map(len, texts))
    return "\n".join(
        f"{name:{width}}  {text.splitlines()[0].removeprefix('# ')}" for name, text in texts.items()
    )


def example_text(name: str) -> str:
    """Return the configuration that comes along as ``name``, with its notes.

    Raises:
        ConfigError: there is none.
    """
    texts = shipped_texts("examples")
    if name not in texts:
        problem = config_notice(
            "config.unknown_name", choices=list(texts), found=name, nearest=suggest(name, texts)
        )
        raise ConfigError("config new", problem)
    return texts[name]


def copy_examples(folder: Path) -> None:
    """Write all configurations that come along, and the files beside them, into the new ``folder``.

    Raises:
        ConfigError: it exists, or can't be written.
    """
    with refuse_io("--all", "file.unwritten", folder):
        _copy(_find_shipped("examples"), folder)


def _copy(source: "Traversable", target: Path) -> None:
    if source.is_dir():
        target.mkdir()
        for each in source.iterdir():
            _copy(each, target / each.name)
    else:
        target.write_bytes(source.read_bytes())
