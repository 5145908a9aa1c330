"""C text made machine code by this machine's compiler, and kept in the user's cache.

What is loaded runs as the user, so it is kept where nobody else can write, or not at all.
"""

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from groundstation.runtime.ownership import FILE, FOLDER, ours

FLAGS = ("-std=gnu99", "-O1", "-ftree-vectorize", "-shared", "-fPIC", "-nostdlib")
"""For any machine of this kind, as homes are shared. No headers, no library: a bare compiler will do."""
EXACT = ("-ffp-contract=off", "-fno-fast-math", "-fno-math-errno", "-fno-trapping-math")
"""Nothing is contracted or reordered. Roots set no errno, and nobody traps: only then is a loop made of vectors."""
_PATIENCE_S = 60.0


def built(text: str) -> ctypes.CDLL:
    """``text`` compiled, or as it was compiled before.

    Raises:
        OSError: there is no compiler, it does not take the text, or what it made can't be loaded.
    """
    command, version = installed()
    said = "\n".join((text, *command, version, *FLAGS, *EXACT, platform.machine()))
    name = f"{hashlib.sha256(said.encode()).hexdigest()}.so"
    folder = _cache()
    if folder is not None and _own(folder / name, FILE):
        with suppress(OSError):  # spoilt, by a full disk or a crash: it is made anew
            return ctypes.CDLL(str(folder / name))
    with tempfile.TemporaryDirectory(dir=folder) as scratch:  # for this user alone
        made = Path(scratch) / name
        _run([*command, *FLAGS, *EXACT, "-x", "c", "-", "-o", str(made)], text)
        if folder is None:
            return ctypes.CDLL(str(made))
        made.chmod(0o700)
        made.replace(folder / name)
    return ctypes.CDLL(str(folder / name))


@cache
def installed() -> tuple[list[str], str]:
    """The command, and which version it is."""
    command = shlex.split(os.environ.get("CC", "")) or ["cc"]
    if shutil.which(command[0]) is None:
        raise OSError(f"no C compiler: {command[0]!r} is not installed")
    return command, _run([*command, "--version"])


def _run(command: list[str], text: str = "") -> str:
    try:
        done = subprocess.run(  # noqa: S603  # the user's own compiler
            command, input=text, capture_output=True, text=True, check=False, timeout=_PATIENCE_S
        )
    except subprocess.TimeoutExpired:
        raise OSError(f"{command[0]!r} takes too long") from None
    if done.returncode != 0:
        said = next(iter(done.stderr.splitlines()), "") or f"exit {done.returncode}"
        raise OSError(f"{command[0]!r} fails: {said}")
    return done.stdout


def _cache() -> Path | None:
    """Where compiled text is kept; None where that is not for this user alone."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    try:
        root = (Path(given) if Path(given).is_absolute() else Path.home() / ".cache").resolve()
        root.mkdir(mode=0o700, parents=True, exist_ok=True)
        # Who may write a folder may put others in the place of those in it.
        for folder in (root, root / "groundstation", root / "groundstation" / "kernels"):
            folder.mkdir(mode=0o700, exist_ok=True)
            if not _own(folder, FOLDER):
                return None
    except (OSError, RuntimeError):
        return None
    return folder if os.access(folder, os.W_OK) else None


def _own(path: Path, kind: Callable[[int], bool]) -> bool:
    """Whether it is there, and this user's alone."""
    try:
        return ours(path.lstat(), kind)
    except OSError:
        return False
