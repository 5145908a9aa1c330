"""Files: text in UTF-8 whatever the locale is, written whole or not at all; locks."""

import fcntl
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, TextIO


@contextmanager
def open_whole(path: Path) -> Iterator[TextIO]:
    """Open a text file that replaces ``path`` when it is closed.

    After an error ``path`` is as it was.

    Line ends are not changed.

    Raises:
        OSError: it can't be written.
    """
    target = path.resolve()  # a link stays one
    if target.exists() and not target.is_file():  # a device or a pipe is not replaced
        with target.open("w", encoding="utf-8", newline="") as file:
            yield file
        return
    new = target.with_name(f".{target.name}.{os.getpid()}")
    try:
        with new.open("w", encoding="utf-8", newline="") as file:
            yield file
        if target.exists():
            with target.open("a"):  # a file without write permission is not replaced
                new.chmod(stat.S_IMODE(target.stat().st_mode))
        new.replace(target)
    except BaseException as error:
        with suppress(OSError):
            new.unlink()
        if isinstance(error, OSError) and str(error.filename) == str(new):
            error.filename = str(path)  # the caller does not know the other
        raise


def write_whole(path: Path, text: str) -> None:
    """Write ``text`` as the whole file ``path``; see :func:`open_whole`."""
    with open_whole(path) as file:
        file.write(text)


def is_locked(file: IO[bytes]) -> bool:
    """Whether another process has locked ``file`` (flock(2))."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False
