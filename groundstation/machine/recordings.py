"""Recordings' folder: its place, the names of recordings, and their removal."""

import errno
import os
import re
from pathlib import Path
from typing import Annotated

import msgspec

from groundstation.config import NAME, config_notice
from groundstation.machine.files import is_locked

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
        Annotated[float, msgspec.Meta(ge=1e-6)] | None,
        msgspec.Meta(description="The oldest recordings go once all take more than this [GB]."),
    ] = 20.0
    keep_days: Annotated[
        Annotated[float, msgspec.Meta(ge=0.001)] | None,
        msgspec.Meta(description="Recordings older than this go [days]."),
    ] = None


def folder_of(config: RecordingConfig) -> Path:
    """Return the folder of the recordings; it may not exist yet."""
    if config.folder:
        return Path(config.folder).expanduser()
    state = os.environ.get("XDG_STATE_HOME", "")
    base = Path(state) if state.startswith("/") else Path("~/.local/state").expanduser()
    return base / "groundstation" / "flights"


def list_flights(folder: Path) -> list[Path]:
    """Return every recording in ``folder``, by name.

    Each simulated flight has a folder of its own in it. A link to a file that is gone is none.
    """
    found = sorted(folder.glob("*.mcap")) + sorted(folder.glob("*/*.mcap"))
    return [path for path in found if path.is_file()]


def make_folder(config: RecordingConfig) -> Path:
    """Make the folder of the recordings if it is missing, for its owner alone, and return it.

    The permissions of an existing folder of the operator's choice are not changed.

    Raises:
        OSError: it can't be made.
    """
    folder = folder_of(config)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except FileExistsError:
        raise NotADirectoryError(
            errno.ENOTDIR, str(config_notice("file.is_file")), str(folder)
        ) from None
    if not config.folder:
        folder.chmod(0o700)
    return folder


def open_private(path: str, flags: int) -> int:
    """Open ``path``, as an ``opener`` of open(); a new file is its owner's alone."""
    return os.open(path, flags, 0o600)


def free_name(folder: Path, stamp: str, vehicle: str) -> Path:
    """Return a free path in ``folder`` for a flight that begins at ``stamp`` (YYYYMMDD-HHMMSS)."""
    path, number = folder / f"{stamp}-{vehicle}.mcap", 2
    while path.exists():
        path, number = folder / f"{stamp}-{vehicle}-{number}.mcap", number + 1
    return path


def list_recordings(folder: Path) -> list[Path]:
    """Return the recordings in ``folder``, oldest first."""
    found = sorted(folder.glob("*.mcap"))
    return [path for path in found if RECORDING.fullmatch(path.name) and path.is_file()]


def is_being_written(path: Path) -> bool:
    """Whether a flight is being recorded to ``path``."""
    try:
        with path.open("rb") as file:
            return is_locked(file)
    except OSError:
        return False


def tidy(config: RecordingConfig, now_s: float) -> list[Path]:
    """Remove recordings beyond the limits of ``config``; ``now_s`` is the wall time [s since 1970].

    Return the removed ones. Never removed: a recording that is being written, and the newest one.
    """
    files = {path: (path, path.with_suffix(".tlog")) for path in list_recordings(folder_of(config))}
    sizes = {
        path: sum(file.stat().st_size for file in both if file.exists())
        for path, both in files.items()
    }
    total, removed = sum(sizes.values()), list[Path]()
    for path in list(files)[:-1]:
        old = (
            config.keep_days is not None
            and now_s - path.stat().st_mtime > config.keep_days * 86400.0
        )
        much = config.keep_gb is not None and total > config.keep_gb * 1e9
        if (old or much) and not is_being_written(path):
            for file in files[path]:
                file.unlink(missing_ok=True)
            total -= sizes[path]
            removed.append(path)
    return removed
