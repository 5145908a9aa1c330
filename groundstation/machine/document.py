"""Marked document: the text between two markers of a page is made by the code and replaced.

The rest is kept.
"""

from collections.abc import Mapping
from pathlib import Path

from groundstation.config import ConfigError, config_notice, refuse_io
from groundstation.machine.files import write_whole


def fill_markers(path: Path, parts: Mapping[str, str]) -> str:
    """Return the text of ``path`` with each of ``parts`` between its markers.

    They are ``<!-- NAME:begin -->`` and ``<!-- NAME:end -->``, with the name of the part.

    Raises:
        ConfigError: the file can't be read, or has not just one pair of markers.
    """
    with refuse_io("--write", "file.unread", path):
        text = path.read_text("utf-8")
    for name, part in parts.items():
        begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
        if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
            raise ConfigError(
                "--write", config_notice("file.markers", path=path, begin=begin, end=end)
            )
        text = f"{text[: text.index(begin) + len(begin)]}\n{part}\n{text[text.index(end) :]}"
    return text


def replace_between_markers(path: Path, text: str, name: str = "figures") -> None:
    """Replace the text between the markers ``name`` of ``path`` by ``text``.

    Raises:
        ConfigError: the file can't be read or written, or has not just one pair of markers.
    """
    page = fill_markers(path, {name: text})
    with refuse_io("--write", "file.unwritten", path):
        write_whole(path, page)
