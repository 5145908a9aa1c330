"""Errors of a configuration: which key is wrong and why, in one line for the operator."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import msgspec

from groundstation.config.config_notices import config_notice
from links.text import Sentence

KeyPath = tuple[str, ...]


class ConfigError(Exception):
    """A bad configuration, as one line for the operator: ``source: key: problem``.

    The problem is a row of a table: ``ConfigError("--out", notice("file.exists", path=path))``.
    """

    def __init__(self, key: str, problem: str | Sentence, source: str = "") -> None:
        """Keep ``key`` (dotted, may be empty), ``problem``, and ``source`` (file or override)."""
        self.key = key
        self.problem = str(problem)
        super().__init__(": ".join(part for part in (source, key, self.problem) if part))
        self.source = source

    def __reduce__(self) -> tuple[type[Self], tuple[str, ...]]:
        """Pickle the constructor's arguments: a worker process hands its errors to the one that
        started it.
        """
        return type(self), (self.key, self.problem, self.source)


class ArgumentError(ConfigError):
    """A bad argument of a function, by its name in Python; on the command line it is ``option``."""

    def __init__(self, option: str, problem: str | Sentence) -> None:
        super().__init__("overrides" if option == "--set" else option.removeprefix("--"), problem)
        self.option = option

    def __reduce__(self) -> tuple[type[Self], tuple[str, ...]]:
        """See :meth:`ConfigError.__reduce__`."""
        return type(self), (self.option, self.problem)


class Problem(Exception):
    """A wrong key, and the reason."""

    def __init__(self, path: KeyPath, text: str | Sentence) -> None:
        super().__init__(str(text))
        self.path = path
        self.text = str(text)

    def __reduce__(self) -> tuple[type[Self], tuple[KeyPath, str]]:
        """See :meth:`ConfigError.__reduce__`."""
        return type(self), (self.path, self.text)


def dotted_key(path: KeyPath) -> str:
    """Return the path as an operator writes it."""
    return ".".join(path)


def element_path(path: KeyPath, index: int) -> KeyPath:
    """Return the path of an element of the array at ``path``."""
    return (*path[:-1], f"{path[-1]}[{index}]")


@contextmanager
def refuse_io(key: str, id: str, path: Path | str) -> Iterator[None]:
    """Report by ``key`` why the block fails.

    ``id`` names the sentence about ``path``, such as ``file.unwritten``.

    Where ``path`` is a folder, the sentence is about the file in it that the system names.

    Raises:
        ConfigError: in the place of an OSError, as ssl.SSLError is one, and of text that is no
            UTF-8.
    """
    try:
        yield
    except OSError as error:
        named = error.filename if error.filename is not None and Path(path).is_dir() else path
        why = error.strerror or error
        raise ConfigError(key, config_notice(id, path=named, why=why)) from None
    except UnicodeDecodeError as error:
        fault = config_notice("file.not_utf8", at=error.start)
        raise ConfigError(key, config_notice(id, path=path, why=fault)) from None


@contextmanager
def refuse_value(key: str, kind: type[Exception] = ValueError) -> Iterator[None]:
    """Report by ``key`` why the block fails, in the words of its error.

    Raises:
        ConfigError: in the place of an error of this ``kind``.
    """
    try:
        yield
    except kind as error:
        raise ConfigError(key, str(error)) from None


def locate(error: msgspec.ValidationError) -> tuple[str, str]:
    """Return the dotted key that ``error`` is about (empty: the whole), and the fault."""
    text, _, where = str(error).partition(" - at `$")
    return where.rstrip("`").lstrip("."), text
