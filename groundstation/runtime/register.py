"""The register of what runs: one file a process, in this user's folder of sockets, locked for as long as it lives.

So whoever wants all of them finds those too whose status socket is elsewhere, is not served, or does not answer.
"""

import fcntl
import os
import signal
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from groundstation.runtime.place import FILE, FOLDER, SERVICES, directory, ours, own_directory

SUFFIX = ".running"
BRIDGE = "rf-bridge"
"""The command of what paces another computer's commands, and has no flight of its own."""


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """One process that flies a vehicle, or paces what flies one."""

    pid: int
    command: str
    """``fly``, ``daemon`` or ``rf-bridge``."""
    vehicle: str
    """Its name; of a bridge, its address."""
    socket: str = ""
    """Its status socket; empty where it has none."""
    body: str = ""
    """Which object of the capture system it follows."""
    poses: str = ""
    """Where its poses come from."""
    link: str = ""
    """Where its commands go."""


@contextmanager
def registered(one: Running) -> Iterator[None]:
    """Keep ``one`` in the register for as long as this lasts; it goes with the process, however that ends.

    Raises:
        ApiError: the folder is not ours alone.
    """
    folder = directory()
    own_directory(folder)
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


def running(services: Path = SERVICES) -> list[Running]:
    """What runs for this user, but for this process; what dead ones have left is removed."""
    found = []
    for folder in sorted({*_folders(), *_services(services)}):
        with suppress(OSError):
            if ours(folder.lstat(), FOLDER):
                found += [one for path in sorted(folder.glob(f"*{SUFFIX}")) if (one := _read(path)) is not None]
    return sorted((one for one in found if one.pid != os.getpid()), key=lambda one: (one.vehicle, one.pid))


def strangers(services: Path = SERVICES) -> list[Path]:
    """Folders of services that run for another user."""
    return [folder for folder in _services(services) if folder.stat().st_uid != os.geteuid()]


def _folders() -> set[Path]:
    """Where processes of this user may have registered: not every shell of theirs has a runtime folder."""
    told, usual = os.environ.get("XDG_RUNTIME_DIR", ""), f"/run/user/{os.getuid()}"
    if told not in ("", usual):
        return {directory()}
    return {directory(), Path(usual) / "groundstation", Path(f"/tmp/groundstation-{os.getuid()}")}  # noqa: S108  # each is checked


def _services(services: Path) -> list[Path]:
    try:
        return sorted(folder for folder in services.iterdir() if folder.is_dir())
    except OSError:
        return []


def _read(path: Path) -> Running | None:
    """What ``path`` tells; None where its process is dead, or it is none of ours."""
    try:
        number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError:
        return None
    try:
        if not ours(os.fstat(number), FILE):
            return None
        if not _is_locked(number):
            path.unlink(missing_ok=True)
            return None
        return msgspec.json.decode(os.read(number, 1 << 16), type=Running)
    except (OSError, msgspec.DecodeError):
        return None
    finally:
        os.close(number)


def _is_locked(number: int) -> bool:
    try:
        fcntl.flock(number, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


def send(one: Running, number: signal.Signals) -> bool:
    """Send a signal to the process of ``one``; False where it has ended.

    Its number can't have become another's: it is held fast first, and then the register must still have it.
    """
    try:
        held = os.pidfd_open(one.pid)
    except OSError:
        return False
    try:
        if one not in running():
            return False
        signal.pidfd_send_signal(held, number)
    except ProcessLookupError:
        return False
    finally:
        os.close(held)
    return True
