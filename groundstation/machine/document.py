"""Marked document: the text between two markers of a page is made by the code and replaced; the rest is kept."""

from collections.abc import Mapping
from pathlib import Path

from groundstation.config import ConfigError, refuse_io
from groundstation.machine.files import write_whole


def split_at_markers(path: Path, name: str = "figures") -> tuple[str, str]:
    """Return the text of ``path`` up to and with the marker ``<!-- NAME:begin -->``, and from ``<!-- NAME:end -->`` on.

    Raises:
        ConfigError: the file can't be read, or has not just one pair of markers.
    """
    return _split(_read(path), path, name)


def fill_markers(path: Path, parts: Mapping[str, str]) -> str:
    """Return the text of ``path`` with each of ``parts`` between the markers of its name.

    Raises:
        ConfigError: see :func:`split_at_markers`.
    """
    text = _read(path)
    for name, part in parts.items():
        before, after = _split(text, path, name)
        text = f"{before}\n{part}\n{after}"
    return text


def replace_between_markers(path: Path, text: str, name: str = "figures") -> None:
    """Replace the text between the markers ``name`` of ``path`` by ``text``.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    page = fill_markers(path, {name: text})
    with refuse_io("--write", f"cannot write {path}"):
        write_whole(path, page)


def _read(path: Path) -> str:
    try:
        with refuse_io("--write", f"cannot read {path}"):
            return path.read_text("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError("--write", f"{path} is not UTF-8 text (byte {error.start})") from None


def _split(text: str, path: Path, name: str) -> tuple[str, str]:
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ConfigError("--write", f"{path} needs a line {begin} and below it a line {end}, once each")
    return text[: text.index(begin) + len(begin)], text[text.index(end) :]
