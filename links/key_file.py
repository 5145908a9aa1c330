"""A shared key on disk, which nobody but its owner may read."""

import contextlib
import os
import stat
from pathlib import Path

KEY_BYTES = 32


def read_key(path: Path) -> bytes:
    """The 32 bytes of the key in ``path``: 64 hexadecimal digits.

    Raises:
        ValueError: it can't be read, others may read it, or it is no key; the message says what to do.
    """
    try:
        with path.open("rb") as file:
            facts = os.fstat(file.fileno())
            data = file.read(200)
    except OSError as error:
        raise ValueError(f"cannot read {path}: {error.strerror}; make a key with --make-key") from None
    if facts.st_uid != os.getuid():
        raise ValueError(f"{path} belongs to another user, who knows the key: make one of your own")
    mode = stat.S_IMODE(facts.st_mode)
    if not stat.S_ISREG(facts.st_mode) or mode & 0o077:
        raise ValueError(f"{path} has mode {mode:04o}, so others may know the key: make a new one, chmod 600")
    with contextlib.suppress(ValueError):
        key = bytes.fromhex(data.decode("ascii"))
        if len(key) == KEY_BYTES and any(key):
            return key
    raise ValueError(f"{path} is no key: expected {2 * KEY_BYTES} hexadecimal digits")


def make_key(path: Path) -> None:
    """Write a new key to ``path``, for its owner's eyes only.

    Raises:
        ValueError: the file is there already, or can't be written.
    """
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error.strerror}") from None
    with os.fdopen(fd, "w") as file:
        file.write(os.urandom(KEY_BYTES).hex() + "\n")
