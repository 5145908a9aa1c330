"""TOML: text into tables, and a configuration back into text, each key with its note."""

import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import tomli_w

from groundstation.config.config_notices import config_notice
from groundstation.config.errors import ConfigError
from groundstation.config.schema import field_descriptions

DIGITS = 4
"""Number of digits of a result that is written into a configuration [-]: no vehicle is known better
than 0.5 %."""
LARGEST_MB = 64
"""Largest file that is read [MB]: a trajectory of a whole day at 10 rows a second. A device such as
/dev/zero never ends."""
DEEPEST = 16
"""Deepest nesting of tables and arrays [-]; ours need 5."""


def read_text(path: Path) -> str:
    """Read the file ``path``, which must be UTF-8.

    Raises:
        OSError: it can't be read.
        ValueError: it is no UTF-8 (UnicodeDecodeError), or larger than ``LARGEST_MB``.
    """
    most = LARGEST_MB * 1_000_000
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(config_notice("file.too_large", most_mb=LARGEST_MB))
    return data.decode("utf-8-sig")


def parse_toml(text: str) -> dict[str, Any]:
    """Parse the TOML ``text``.

    Raises:
        ValueError: it is no TOML, or nested deeper than ``DEEPEST``.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(config_notice("config.not_toml", why=error)) from None
    except ValueError:  # int() refuses more digits, and tomllib does not say where they are
        most = sys.get_int_max_str_digits()
        long = re.search(rf"\d[\d_]{{{most},}}", text)
        line = text.count("\n", 0, long.start() if long else 0) + 1
        raise ValueError(config_notice("config.digits", line=line, most=most)) from None
    except RecursionError:
        raise ValueError(config_notice("config.depth", most=DEEPEST)) from None
    inside: list[Any] = [data]
    for _ in range(DEEPEST):
        inside = [
            one for item in inside for one in (item.values() if isinstance(item, dict) else item)
        ]
        inside = [one for one in inside if isinstance(one, dict | list)]
        if not inside:
            return data
    raise ValueError(config_notice("config.depth", most=DEEPEST))


def read_toml(path: Path) -> dict[str, Any]:
    """Read and parse the TOML file ``path``.

    Raises:
        ConfigError: it can't be read, is an empty file (``/dev/null`` asks for the defaults), or is
            not TOML.
    """
    try:
        text = read_text(path)
        if not text.strip() and path.is_file():
            raise ValueError(config_notice("file.empty"))
        return parse_toml(text)
    except OSError as error:
        raise ConfigError(
            "", config_notice("config.unread", why=error.strerror), str(path)
        ) from None
    except UnicodeDecodeError as error:
        raise ConfigError("", config_notice("file.not_utf8", at=error.start), str(path)) from None
    except ValueError as error:
        raise ConfigError("", str(error), str(path)) from None


def dump(config: msgspec.Struct) -> str:
    """Return the configuration as TOML, each key with the first sentence of its description.

    It loads back to the same. A key that is None has no TOML form and appears as a comment. A path
    that the locale could not decode is UTF-8 here.
    """
    text = "\n".join(_table(config, ())).lstrip("\n") + "\n"
    return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")


def _table(table: msgspec.Struct | dict[str, Any], path: tuple[str, ...]) -> Iterator[str]:
    """Return the lines of one table: its own keys first, then its sub-tables, in TOML's order."""
    notes = field_descriptions(type(table)) if isinstance(table, msgspec.Struct) else {}
    if path:
        yield f"\n[{'.'.join(map(_key, path))}]"
    inner = []
    for key, value in _entries(table).items():
        if isinstance(value, msgspec.Struct | dict):
            inner.append((key, value))
            continue
        line = (
            f"# {_key(key)} is not set" if value is None else f"{_key(key)} = {write_value(value)}"
        )
        first, stop, _ = notes.get(key, "").partition(". ")
        note = first + stop.rstrip()
        yield f"{line}{'. ' if value is None else '  # '}{note}" if note else line
    for key, value in inner:
        yield from _table(value, (*path, key))


def _entries(table: msgspec.Struct | dict[str, Any]) -> dict[str, Any]:
    """Return the entries of ``table``, the key that names its kind first."""
    if isinstance(table, dict):
        return table
    settings = table.__struct_config__
    tag = {} if settings.tag_field is None else {settings.tag_field: settings.tag}
    names = zip(table.__struct_encode_fields__, table.__struct_fields__, strict=True)
    return tag | {key: getattr(table, name) for key, name in names}


def round_digits(value: float) -> float:
    """``value`` with as many digits as a written result has."""
    return float(f"{value:.{DIGITS}g}")


def write_value(value: Any) -> str:
    """Return ``value`` as TOML, on one line."""
    if isinstance(value, msgspec.Struct | dict):
        entries = _entries(value).items()
        items = ", ".join(
            f"{_key(key)} = {write_value(item)}" for key, item in entries if item is not None
        )
        return f"{{ {items} }}" if items else "{}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(write_value, value))}]"
    if type(value) in (int, float):  # a course of 50,000 samples would take seconds
        return str(value)
    return tomli_w.dumps({"v": msgspec.to_builtins(value)}).removeprefix("v = ").rstrip("\n")


def _key(key: str) -> str:
    return tomli_w.dumps({key: 0}).removesuffix(" = 0\n")
