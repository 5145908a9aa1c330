"""The configurations that come along, to start one's own from, and what they name beside them."""

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from groundstation.config.loader import ConfigError

_FOLDER = resources.files("groundstation") / "examples"


def example_names() -> list[str]:
    """The names of the configurations, in their order."""
    return sorted(file.name.removesuffix(".toml") for file in _FOLDER.iterdir() if file.name.endswith(".toml"))


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
    return (_FOLDER / f"{name}.toml").read_text("utf-8")


def copy_examples(folder: Path) -> None:
    """Write all of them, and the files beside them, into the new ``folder``.

    Raises:
        ConfigError: it exists, or can't be written.
    """
    try:
        _copy(_FOLDER, folder)
    except OSError as error:
        raise ConfigError("--all", f"cannot write {error.filename}: {error.strerror}") from None


def _copy(source: Traversable, target: Path) -> None:
    if source.is_dir():
        target.mkdir()
        for each in source.iterdir():
            _copy(each, target / each.name)
    else:
        target.write_bytes(source.read_bytes())
