"""Places of the sockets of running ground stations, which nobody else can take.

What lies in a folder must be this user's alone: others could put a file or a socket of theirs in its place.
"""

import asyncio
import os
import stat
from collections.abc import Callable
from glob import escape
from pathlib import Path
from typing import Annotated

import msgspec

FOLDER, FILE = stat.S_ISDIR, stat.S_ISREG


def ours(found: os.stat_result, kind: Callable[[int], bool]) -> bool:
    """Whether it is of that kind, this user's, and nobody else may write it; ``found`` is of lstat(2): no link is."""
    return kind(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022


SERVICES = Path("/run/groundstation")
"""Here every service of the machine has a folder of its own: ``groundstation service`` makes it so."""


class StatusConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The socket that screens and requests attach to."""

    path: str = ""
    """Path of the UNIX socket; empty means ``$XDG_RUNTIME_DIR/groundstation/VEHICLE.sock``, or else in /tmp."""
    rate_hz: Annotated[float, msgspec.Meta(ge=1.0, le=50.0)] = 5.0
    """Most snapshots a second to each client [1/s]; screens call it silence when none comes for 1.5 s."""


class ApiError(Exception):
    """The socket can't be opened or read; the text says why and what to do."""


def directory() -> Path:
    """The folder of this user's sockets; a service has the one that its manager made for it."""
    service = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if service.startswith("/"):
        return Path(service)
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    return Path(runtime) / "groundstation" if runtime.startswith("/") else Path(f"/tmp/groundstation-{os.getuid()}")  # noqa: S108  # checked before use, see own_directory


def socket_path(config: StatusConfig, vehicle: str) -> Path:
    """Where the socket of ``vehicle`` is, to serve at."""
    return Path(config.path) if config.path else directory() / f"{vehicle}.sock"


async def find(vehicle: str | None, services: Path = SERVICES) -> Path:
    """The socket of ``vehicle``, to attach to: this user's, or else a service's; without a name, of the only one.

    Raises:
        ApiError: nobody serves it, or more than one could be meant.
    """
    served = await serving(vehicle, services)
    if not served:
        whom = "a vehicle" if vehicle is None else repr(vehicle)
        raise ApiError(
            f"nobody flies {whom} here (looked in {directory()} and {services}): name it by --vehicle, "
            "or its socket by --socket"
        )
    if len(served) > 1:
        several = ", ".join(str(path) for path in served)
        raise ApiError(f"more than one could be meant: name one by --vehicle or --socket: {several}")
    return served[0]


async def serving(vehicle: str | None, services: Path = SERVICES) -> list[Path]:
    """The sockets of ``vehicle``, or without a name of all, that somebody serves: this user's first."""
    found = _sockets("*" if vehicle is None else escape(vehicle), services)
    return [path for path in found if await is_served(path)]


def owner(path: Path) -> str:
    """Who owns ``path``, or else what can be seen of it: the nearest folder above."""
    for seen in (path, *path.parents):
        try:
            return seen.owner()
        except KeyError:  # a number without a name
            return f"#{seen.stat().st_uid}"
        except OSError:
            continue
    return "root"


def _sockets(name: str, services: Path) -> list[Path]:
    found = (*sorted(directory().glob(f"{name}.sock")), *sorted(services.glob(f"*/{name}.sock")))
    return [path for path in found if path.is_socket()]


async def is_served(path: Path) -> bool:
    """Whether somebody listens; where we may not look, somebody may."""
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except PermissionError:
        return True
    except OSError:
        return False
    writer.close()
    return True


def own_directory(folder: Path) -> None:
    """Make ``folder`` where it is missing, for us alone.

    Raises:
        ApiError: it belongs to somebody else, or others may write to it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        info = folder.lstat()
    except OSError as error:
        raise ApiError(f"folder {folder} of the status socket: {error.strerror}") from error
    if not ours(info, FOLDER):
        raise ApiError(
            f"folder {folder} of the status socket must be a folder that belongs to you and that nobody else "
            "may write to: another program could take the socket's place; set status.path"
        )


async def claim(path: Path) -> None:
    """Make ``path`` free for us: the folder is ours, and what a dead process left there is removed.

    Raises:
        ApiError: another ground station serves there, or the path can't be used.
    """
    own_directory(path.parent)
    if not _is_socket(path):
        return
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except ConnectionRefusedError:
        os.unlink(path)  # noqa: PTH108  # a local file, on the ground
    except OSError as error:
        raise ApiError(f"status socket {path}: {error.strerror}") from error
    else:
        writer.close()
        raise ApiError(
            f"status socket {path}: another ground station is serving this vehicle; stop it, "
            "or give this one another vehicle.name or status.path"
        )


def _is_socket(path: Path) -> bool:
    """Whether a socket is there; False where nothing is.

    Raises:
        ApiError: something else is there.
    """
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return False
    if not stat.S_ISSOCK(mode):
        raise ApiError(f"status socket {path}: a file that is not a socket is there; move it away")
    return True
