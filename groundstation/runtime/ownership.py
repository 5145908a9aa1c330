"""Whether what lies in a folder is this user's alone: others could put a file or a socket of theirs in its place."""

import os
import stat
from collections.abc import Callable

FOLDER, FILE = stat.S_ISDIR, stat.S_ISREG


def ours(found: os.stat_result, kind: Callable[[int], bool]) -> bool:
    """Whether it is of that kind, this user's, and nobody else may write it; ``found`` is of lstat(2): no link is."""
    return kind(found.st_mode) and found.st_uid == os.geteuid() and not found.st_mode & 0o022
