"""One ground station a vehicle: whoever is second is refused, and told who is first."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from groundstation.runtime.place import own_directory


class Taken(Exception):
    """Another ground station flies this vehicle."""


@contextmanager
def only_one(path: Path, vehicle: str) -> Iterator[None]:
    """Hold the lock at ``path`` for as long as this lasts. It falls with the process, however that ends.

    The file stays: to remove it would let a third take a lock of the same name beside the second's.

    Raises:
        Taken: another process holds it.
        ApiError: its folder is not ours alone.
    """
    own_directory(path.parent)
    number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            pid = os.read(number, 20).decode(errors="replace").strip()
            raise Taken(
                f"{vehicle} is flown by another ground station already (process {pid}, lock {path}): stop that one, "
                "or give this one another vehicle.name or status.path"
            ) from None
        os.ftruncate(number, 0)
        os.pwrite(number, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(number)


def lock_path(socket: Path) -> Path:
    """The lock beside a socket."""
    return socket.with_suffix(".lock")
