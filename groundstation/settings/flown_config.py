"""Configuration that a flight was flown with, read from its recording, also of another version."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from groundstation.config import RETIRED_KEYS, ConfigError, from_dict, parse_toml
from groundstation.core.messages import notice
from groundstation.settings.settings import Config


class FlownConfig(NamedTuple):
    """The configuration in a recording."""

    config: Config
    left_out: list[str]
    """Settings that this version does not know, or not with such values; they are left out."""


def read_flown_config(
    about: Mapping[str, str], path: Path, overrides: Sequence[str] = ()
) -> FlownConfig:
    """Read the configuration in ``about`` of the recording at ``path``, with ``overrides``.

    Raises:
        ConfigError: it is no TOML, a value in a list is refused, or an override is bad.
    """
    try:
        settings = parse_toml(about.get("config", ""))
    except ValueError as error:
        raise ConfigError("", notice("recording.bad_config", why=error), str(path)) from None
    left_out = [key for key in RETIRED_KEYS if _remove(settings, key)]
    while True:
        try:
            return FlownConfig(from_dict(settings, Config, overrides, source=str(path)), left_out)
        except ConfigError as error:
            if not _remove(settings, error.key):
                raise
            left_out.append(error.key)


def _remove(settings: dict[str, Any], key: str) -> bool:
    """Remove the dotted ``key``; return whether it was there."""
    *tables, name = key.split(".")
    table: Any = settings
    for part in tables:
        table = table.get(part) if isinstance(table, dict) else None
    return isinstance(table, dict) and table.pop(name, None) is not None
