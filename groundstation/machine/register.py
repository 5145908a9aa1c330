"""Register of running programs: sockets, the lock of each vehicle, and one file a process, locked
while it lives.

The files also name the programs whose status socket is elsewhere, is not served, or does not
answer. The files in a folder must be this user's alone: others could replace a file or a socket by
their own.
"""

import asyncio
import fcntl
import os
import signal
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum
from pathlib import Path
from typing import Annotated

import msgspec

from groundstation.config import config_notice
from groundstation.machine.clock import begin_of_process_s, uptime_s
from groundstation.machine.files import is_locked, write_whole
from links.text import Sentence

FOLDER, FILE = stat.S_ISDIR, stat.S_ISREG


def is_ours(found: os.stat_result, kind: Callable[[int], bool]) -> bool:
    """Whether ``found`` (of lstat(2)) is of ``kind``, this user's, and not writable for others."""
    return kind(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022


SERVICES = Path("/run/groundstation")
"""Folder with one folder for each service of the machine, as ``groundstation daemon unit``
configures it."""


class StatusConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The socket that screens and requests attach to."""

    path: Annotated[
        str,
        msgspec.Meta(
            description="Path of the UNIX socket; empty means "
            "`$XDG_RUNTIME_DIR/groundstation/VEHICLE.sock`, or else in /tmp."
        ),
    ] = ""
    rate_hz: Annotated[
        float,
        msgspec.Meta(
            ge=1.0,
            le=50.0,
            description="Most snapshots a second to each client [1/s]; screens call it silence "
            "when none comes for 1.5 s.",
        ),
    ] = 5.0


class ApiError(Exception):
    """The socket can't be opened or read; the text has reason and remedy."""


def shared_folder() -> Path:
    """Return this user's folder in /tmp, which must be checked before use, see own_directory."""
    return Path(f"/tmp/groundstation-{os.getuid()}")  # noqa: S108


def socket_folder() -> Path:
    """Return the folder of this user's sockets.

    A service has the one that its manager made for it.
    """
    service = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if service.startswith("/"):
        return Path(service)
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    if runtime.startswith("/"):
        return Path(runtime) / "groundstation"
    return shared_folder()


def socket_path(config: StatusConfig, vehicle: str) -> Path:
    """Return the path at which the socket of ``vehicle`` is served."""
    return Path(config.path) if config.path else socket_folder() / f"{vehicle}.sock"


async def find_socket(vehicle: str | None, services: Path = SERVICES) -> Path:
    """Find the served socket of ``vehicle``: this user's, or else a service's.

    Without a name, the only one.

    Raises:
        ApiError: nobody serves it, or more than one could be meant.
    """
    served = await served_sockets(vehicle, services)
    if not served:
        whom = "a vehicle" if vehicle is None else repr(vehicle)
        raise ApiError(
            config_notice("station.nobody", whom=whom, folder=socket_folder(), services=services)
        )
    if len(served) > 1:
        several = ", ".join(str(path) for path in served)
        raise ApiError(config_notice("station.several", sockets=several))
    return served[0]


async def served_sockets(vehicle: str | None, services: Path = SERVICES) -> list[Path]:
    """Return the served sockets of ``vehicle``, or without a name of all: this user's first."""
    from glob import escape

    found = _sockets("*" if vehicle is None else escape(vehicle), services)
    return [path for path in found if await is_served(path)]


def _sockets(name: str, services: Path) -> list[Path]:
    found = (
        *sorted(socket_folder().glob(f"{name}.sock")),
        *sorted(services.glob(f"*/{name}.sock")),
    )
    return [path for path in found if path.is_socket()]


def owner(path: Path) -> str:
    """Return the owner of ``path``, or else of the nearest folder above that can be seen."""
    for seen in (path, *path.parents):
        try:
            return seen.owner()
        except KeyError:  # a number without a name
            return f"#{seen.stat().st_uid}"
        except OSError:
            continue
    return "root"


async def is_served(path: Path) -> bool:
    """Whether a program listens at ``path``; assumed without permission to connect."""
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
        raise ApiError(
            config_notice("socket.no_folder", folder=folder, why=error.strerror)
        ) from error
    if not is_ours(info, FOLDER):
        raise ApiError(config_notice("socket.open_folder", folder=folder))


async def claim_socket(path: Path) -> None:
    """Make ``path`` free for us: the folder is ours, and the socket of a dead process is removed.

    Raises:
        ApiError: another ground station serves there, or the path can't be used.
    """
    own_directory(path.parent)
    if not path.is_socket():  # noqa: ASYNC240  # a local file, on the ground
        if os.path.lexists(path):  # noqa: ASYNC240  # as above
            raise ApiError(config_notice("socket.other_file", path=path))
        return
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except ConnectionRefusedError:
        os.unlink(path)  # noqa: PTH108  # a local file, on the ground
    except OSError as error:
        raise ApiError(config_notice("socket.failed", path=path, why=error.strerror)) from error
    else:
        writer.close()
        raise ApiError(config_notice("socket.taken", path=path))


class Taken(Exception):
    """Another ground station flies this vehicle."""


@contextmanager
def hold_lock(socket: Path, vehicle: str) -> Iterator[None]:
    """Hold the lock beside the status ``socket`` of ``vehicle``.

    The end of the process releases it.

    The file is kept: without it a third process could lock a new file of the same name.

    Raises:
        Taken: another process holds it.
        ApiError: its folder is not ours alone, or takes no file.
    """
    if not socket.name:  # a folder such as / or .
        raise ApiError(config_notice("socket.other_file", path=socket))
    path = socket.with_suffix(".lock")
    own_directory(path.parent)
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    except OSError as error:
        raise ApiError(config_notice("socket.failed", path=path, why=error.strerror)) from error
    try:
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            pid = os.read(number, 20).decode(errors="replace").strip()
            raise Taken(
                config_notice("station.taken", vehicle=vehicle, pid=pid, path=path)
            ) from None
        os.ftruncate(number, 0)
        os.pwrite(number, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(number)


SUFFIX = ".running"
BRIDGE = "rf-bridge"
"""Command of a process that paces another computer's commands, and has no flight of its own."""
FLEET = "fleet"
"""Command of a process that starts the cores of a fleet, and will arm them."""


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """One process that flies a vehicle, or paces what flies one."""

    pid: int
    command: str
    """``fly``, ``daemon``, ``fleet`` or ``rf-bridge``."""
    vehicle: str
    """Its name; of a bridge, its address; of a fleet, the names of all."""
    socket: str = ""
    """Its status socket; empty without one."""
    body: str = ""
    """Its body in the capture system."""
    poses: str = ""
    """Source of its poses."""
    link: str = ""
    """Destination of its commands."""


@contextmanager
def registration(one: Running) -> Iterator[None]:
    """Keep ``one`` in the register for as long as this lasts.

    It goes with the process, however that ends.

    Raises:
        ApiError: the folder is not ours alone.
    """
    folder = socket_folder()
    own_directory(folder)
    import tempfile  # with what it brings, milliseconds of every program's start

    number, draft = tempfile.mkstemp(dir=folder)  # 0600, and O_CLOEXEC
    path = Path(draft).with_suffix(SUFFIX)
    try:
        fcntl.flock(number, fcntl.LOCK_EX)
        os.write(number, msgspec.json.encode(one))
        Path(draft).rename(path)  # nobody sees it before it is whole, and locked
        yield
    finally:
        for left in (path, Path(draft)):
            left.unlink(missing_ok=True)
        os.close(number)


def running_processes(services: Path = SERVICES) -> list[Running]:
    """Return this user's other running processes, and remove the entries of dead ones."""
    found = []
    for folder in sorted({*_folders(), *_services(services)}):
        with suppress(OSError):
            if is_ours(folder.lstat(), FOLDER):
                found += [
                    one
                    for path in sorted(folder.glob(f"*{SUFFIX}"))
                    if (one := _read_entry(path)) is not None
                ]
    return sorted(
        (one for one in found if one.pid != os.getpid()), key=lambda one: (one.vehicle, one.pid)
    )


STOP = "stop-all"
"""File in the folder of sockets with the time of the newest order that all flights land."""


def note_stop() -> None:
    """Note that all flights of this user are ordered to land now, for programs that only start."""
    if sys.platform != "linux":
        return  # nothing flies elsewhere
    with suppress(ApiError):
        own_directory(socket_folder())
    for folder in _folders():
        with suppress(OSError):
            if is_ours(folder.lstat(), FOLDER):
                write_whole(folder / STOP, f"{uptime_s()}\n")


def explain_stop() -> Sentence | None:
    """Return the reason not to arm where all flights were ordered to land since this process began.

    To be called by a process that is registered: later orders reach it.
    """
    try:
        ordered_s = float((socket_folder() / STOP).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    now_s = uptime_s()
    if not begin_of_process_s() <= ordered_s <= now_s:  # a later one was before the machine's start
        return None
    return config_notice("station.stopped", age_s=now_s - ordered_s)


def foreign_services() -> list[Path]:
    """Folders of services that run for another user."""
    return [folder for folder in _services(SERVICES) if folder.stat().st_uid != os.geteuid()]


def _folders() -> set[Path]:
    """Return where processes of this user may have registered: not every shell of theirs has a
    runtime folder.
    """
    usual = f"/run/user/{os.getuid()}"
    if os.environ.get("XDG_RUNTIME_DIR", "") not in ("", usual):
        return {socket_folder()}
    return {socket_folder(), Path(usual) / "groundstation", shared_folder()}


def _services(services: Path) -> list[Path]:
    try:
        return sorted(folder for folder in services.iterdir() if folder.is_dir())
    except OSError:
        return []


def _read_entry(path: Path) -> Running | None:
    """Read the entry at ``path``; None if its process is dead, or it is none of ours."""
    try:
        with open(path, "rb", opener=_open_file) as file:
            if not is_ours(os.fstat(file.fileno()), FILE):
                return None
            if is_locked(file):
                return msgspec.json.decode(file.read(), type=Running)
        path.unlink(missing_ok=True)
    except (OSError, msgspec.DecodeError):
        pass
    return None


def _open_file(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK)


def send_signal(one: Running, number: signal.Signals) -> bool:
    """Send a signal to the process of ``one``; False where it has ended.

    Its number can't have become another's: the process is pinned first, and then the register must
    still have it.
    """
    try:
        held = os.pidfd_open(one.pid)
    except OSError:
        return False
    try:
        if one not in running_processes():
            return False
        signal.pidfd_send_signal(held, number)
    except ProcessLookupError:
        return False
    finally:
        os.close(held)
    return True


class Prctl(IntEnum):
    """Options of prctl(2), from linux/prctl.h."""

    SET_PDEATHSIG = 1


def follow_parent(parent: int, number: signal.Signals) -> bool:
    """Have the system send ``number`` to this process when its parent dies.

    False where ``parent`` is dead by now.
    """
    import ctypes  # only children need it

    # Linux has it; elsewhere a child outlives its parent.
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(Prctl.SET_PDEATHSIG, int(number))
    return os.getppid() == parent
