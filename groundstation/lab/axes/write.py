"""Keys into a configuration file, with everything else in it left as it stands: comments, order, other keys."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import tomli_w

from groundstation.config import ConfigError, load
from groundstation.settings import Config

_HEADER = re.compile(r"\s*\[\s*([^\[\]]+?)\s*\]\s*(#.*)?$")

Value = str | float | Sequence[float]


def written(text: str, table: str, keys: Mapping[str, Value]) -> str:
    """``text`` (TOML) with ``keys`` set in ``table``, each on a line of its own; new tables go to the end.

    Sees tables that have a header, and keys that are written on one line.
    """
    lines = text.splitlines()
    begin = next((n for n, line in enumerate(lines) if (m := _HEADER.match(line)) and m[1] == table), None)
    if begin is None:
        return "\n".join([*lines, *([""] if lines else []), f"[{table}]", *map(_line, keys.items())]) + "\n"
    end = next((n for n in range(begin + 1, len(lines)) if lines[n].lstrip().startswith("[")), len(lines))
    body = lines[begin + 1 : end]
    for key, value in keys.items():
        mine = re.compile(rf"\s*{re.escape(key)}\s*=")
        at = next((n for n, line in enumerate(body) if mine.match(line)), None)
        if at is None:
            after = max((n for n, line in enumerate(body) if line.strip()), default=-1)
            body.insert(after + 1, _line((key, value)))
        else:
            body[at] = _line((key, value))
    return "\n".join([*lines[: begin + 1], *body, *lines[end:]]) + "\n"


def write(path: Path, tables: Mapping[str, Mapping[str, Value]], expected: Config) -> Path:
    """Set the keys of ``tables`` in the file ``path``; returns where the file as it was is kept.

    Raises:
        ConfigError: it can't be written, or what would be read from it then is not ``expected``; it is left as it was.
    """
    by_hand = "; ".join(f"[{table}] {' '.join(map(_line, keys.items()))}" for table, keys in tables.items() if keys)
    try:
        before = path.read_text("utf-8")
        text = before
        for table, keys in tables.items():
            text = written(text, table, keys) if keys else text
        new, kept = path.with_name(f"{path.name}.new"), path.with_name(f"{path.name}.before-carry")
        new.write_text(text, "utf-8")
        try:
            understood = load(new, Config) == expected
        except ConfigError:
            understood = False
        if not understood:
            new.unlink()
            raise ConfigError(
                "", f"is written in a way that can't be changed here; put this into it: {by_hand}", str(path)
            )
        kept.write_text(before, "utf-8")
        new.replace(path)
    except OSError as error:
        raise ConfigError("", f"can't be written ({error.strerror}); put this into it: {by_hand}", str(path)) from None
    return kept


def _line(item: tuple[str, Value]) -> str:
    key, value = item
    plain = list(value) if isinstance(value, tuple | list) else value
    return f"{key} = " + re.sub(r"\s+", " ", tomli_w.dumps({"v": plain}).removeprefix("v = ")).strip().replace(
        ",]", "]"
    )
