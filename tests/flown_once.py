"""What a whole run of tests computes once, however many tests and workers ask for it."""

import fcntl
import hashlib
import os
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeVar

T = TypeVar("T")
FOLDER = "GROUNDSTATION_TEST_FLIGHTS"
"""Names, in the environment, the folder that the workers of one run share."""


@cache
def _own() -> "TemporaryDirectory[str]":
    return TemporaryDirectory(prefix="gs-")  # for a program that no run of tests has started


def folder_of(key: object) -> Path:
    """The folder of what ``key`` names; ``repr(key)`` must tell all that it depends on."""
    base = Path(os.environ.get(FOLDER) or _own().name)
    folder = base / hashlib.sha256(repr(key).encode()).hexdigest()[:32]
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def once(key: object, make: Callable[[Path], T]) -> T:
    """Return what the first call of ``make`` returned, which may leave files in its folder."""
    folder = folder_of(key)
    kept = folder / "kept.pickle"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            made = make(folder)
            fresh = kept.with_suffix(".fresh")
            fresh.write_bytes(pickle.dumps(made))
            fresh.rename(kept)
            return made
    found: T = pickle.loads(kept.read_bytes())
    return found
