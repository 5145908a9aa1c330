"""Text files: UTF-8 whatever the locale is, and written whole or not at all."""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TextIO


@contextmanager
def open_whole(path: Path) -> Iterator[TextIO]:
    """Open a text file that takes the place of ``path`` when it is closed; after an error ``path`` is as it was.

    Line ends stay as they are written.

    Raises:
        OSError: it can't be written.
    """
    target = path.resolve()  # a link stays one
    if target.exists() and not target.is_file():  # a device or a pipe has no whole
        with target.open("w", encoding="utf-8", newline="") as file:
            yield file
        return
    new = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with new.open("w", encoding="utf-8", newline="") as file:
            yield file
        if target.exists():
            with target.open("a"):  # what may not be written is not replaced either
                new.chmod(stat.S_IMODE(target.stat().st_mode))
        new.replace(target)
    except BaseException as error:
        with suppress(OSError):
            new.unlink()
        if isinstance(error, OSError) and str(error.filename) == str(new):
            error.filename = str(path)  # nobody has asked for the other
        raise


def write_whole(path: Path, text: str) -> None:
    """Write ``text`` as the whole file ``path``; see :func:`open_whole`."""
    with open_whole(path) as file:
        file.write(text)
