"""Recordings' folder: where they are kept, what they are called, and how long they stay."""

import errno
import fcntl
import os
import re
from pathlib import Path
from typing import Annotated

import msgspec

from groundstation.config import NAME

RECORDING = re.compile(rf"[0-9]{{8}}-[0-9]{{6}}-{NAME}\.mcap")
"""YYYYMMDD-HHMMSS-VEHICLE.mcap, in local time; nothing else is ever tidied away."""


class RecordingConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The flight recorder: one MCAP file a flight."""

    enabled: Annotated[bool, msgspec.Meta(description="Record every flight.")] = True
    folder: Annotated[
        str,
        msgspec.Meta(
            description="Folder of the recordings; empty means "
            "`$XDG_STATE_HOME/groundstation/flights`, or else in ~/.local/state."
        ),
    ] = ""
    keep_gb: Annotated[
        Annotated[float, msgspec.Meta(gt=0.0)] | None,
        msgspec.Meta(description="The oldest recordings go once all take more than this [GB]."),
    ] = 20.0
    keep_days: Annotated[
        Annotated[float, msgspec.Meta(gt=0.0)] | None, msgspec.Meta(description="Recordings older than this go [days].")
    ] = None


def folder_of(config: RecordingConfig) -> Path:
    """Where its recordings are; the folder may not exist yet."""
    if config.folder:
        return Path(config.folder).expanduser()
    state = os.environ.get("XDG_STATE_HOME", "")
    base = Path(state) if state.startswith("/") else Path("~/.local/state").expanduser()
    return base / "groundstation" / "flights"


def list_flights(folder: Path) -> list[Path]:
    """Return every recording in ``folder``, by name; each simulated flight has a folder of its own in it."""
    found = sorted(folder.glob("*.mcap")) + sorted(folder.glob("*/*.mcap"))
    return [path for path in found if not path.is_dir()]


def make_folder(config: RecordingConfig) -> Path:
    """Where its recordings are, made where it is missing, for its owner alone: they show who flew what, and how.

    A folder of the operator's choice that is there already stays as open as it is.

    Raises:
        OSError: it can't be made.
    """
    folder = folder_of(config)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except FileExistsError:
        raise NotADirectoryError(errno.ENOTDIR, "it is a file, not a folder", str(folder)) from None
    if not config.folder:
        folder.chmod(0o700)
    return folder


def open_private(path: str, flags: int) -> int:
    """Open ``path`` as ``open(..., opener=...)`` wants it; a new file is its owner's alone."""
    return os.open(path, flags, 0o600)


def free_name(folder: Path, stamp: str, vehicle: str) -> Path:
    """A path in ``folder`` for a flight that begins at ``stamp`` (YYYYMMDD-HHMMSS), with nothing there yet."""
    path = folder / f"{stamp}-{vehicle}.mcap"
    number = 2
    while path.exists():
        path = folder / f"{stamp}-{vehicle}-{number}.mcap"
        number += 1
    return path


def list_recordings(folder: Path) -> list[Path]:
    """The recordings in ``folder``, oldest first."""
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if RECORDING.fullmatch(path.name))


def is_being_written(path: Path) -> bool:
    """Whether a flight is being recorded to ``path``."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def tidy(config: RecordingConfig, now_s: float) -> list[Path]:
    """Remove what ``config`` no longer keeps; ``now_s`` is the wall time [s since 1970]. Returns what was removed.

    Never removed: a recording that is being written, and the newest one.
    """
    found = [(path, path.stat(), path.with_suffix(".tlog")) for path in list_recordings(folder_of(config))[:-1]]
    newest = list_recordings(folder_of(config))[-1:]
    total = sum(file.stat().st_size for path in newest for file in (path, path.with_suffix(".tlog")) if file.exists())
    sizes = [info.st_size + (tlog.stat().st_size if tlog.exists() else 0) for _, info, tlog in found]
    total += sum(sizes)
    removed = []
    for (path, info, tlog), size in zip(found, sizes, strict=True):
        old = config.keep_days is not None and now_s - info.st_mtime > config.keep_days * 86400.0
        much = config.keep_gb is not None and total > config.keep_gb * 1e9
        if (old or much) and not is_being_written(path):
            path.unlink(missing_ok=True)
            tlog.unlink(missing_ok=True)
            total -= size
            removed.append(path)
    return removed
