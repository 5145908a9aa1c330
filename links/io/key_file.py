"""A key on disk that two sides share, and that nobody but its owner may read."""

import base64
import binascii
import os
import stat
from pathlib import Path

from links.text import link_notice

KEY_BYTES = 32
"""Length of a key [bytes]."""


def read_key(path: Path) -> bytes:
    """The 32 bytes of the key in ``path``: raw, or as text in hex or base64.

    Raises:
        ValueError: it can't be read, others may read it, or it is no key; the message says what to
            do.
    """
    try:
        with path.open("rb") as file:
            owner = os.fstat(file.fileno())
            data = file.read(200)
    except OSError as error:
        raise ValueError(link_notice("file.unread", path=path, why=error.strerror)) from None
    if not stat.S_ISREG(owner.st_mode):
        raise ValueError(link_notice("key_file.no_file", path=path))
    if owner.st_uid != os.getuid():
        raise ValueError(link_notice("key_file.other_owner", path=path))
    if stat.S_IMODE(owner.st_mode) != 0o600:
        mode = stat.S_IMODE(owner.st_mode)
        raise ValueError(link_notice("key_file.mode", path=path, mode=f"{mode:04o}"))
    key = _decode(data)
    if key is None:
        raise ValueError(link_notice("key_file.none", path=path, bytes=KEY_BYTES))
    if not any(key):
        raise ValueError(link_notice("key_file.zeros", path=path))
    return key


def _decode(data: bytes) -> bytes | None:
    if len(data) == KEY_BYTES:
        return data
    text = data.strip()
    for decode in (bytes.fromhex, lambda t: base64.b64decode(t, validate=True)):
        try:
            key = decode(text.decode("ascii"))
        except (ValueError, binascii.Error):
            continue
        if len(key) == KEY_BYTES:
            return key
    return None


def make_key(path: Path) -> None:
    """Write a new key to ``path``, for its owner's eyes only.

    Raises:
        ValueError: the file is there already, or can't be written.
    """
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
        try:
            with os.fdopen(fd, "w", encoding="ascii") as file:
                file.write(os.urandom(KEY_BYTES).hex() + "\n")
        except OSError:
            path.unlink()  # half a key is none
            raise
    except OSError as error:
        raise ValueError(link_notice("file.unwritten", path=path, why=error.strerror)) from None
