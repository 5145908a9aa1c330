"""The command line of a process that runs one of our own modules. Sans-IO."""

import sys


def make_child_command(module: str, *words: str) -> list[str]:
    """Run ``module`` (``links.pacer_child``) of this very installation, by this very Python, with ``words`` for it.

    A file or a folder `links`, `groundstation` or `sim` where the operator happens to stand is not ours, nor is one on
    PYTHONPATH.
    """
    return [sys.executable, "-P", "-m", "groundstation.launch", module, *words]
