"""Starts this installation's programs, whatever else bears the names of their packages.

``sim``, ``links`` and ``groundstation`` are words that a file or a folder of the operator's may bear too, and
PYTHONPATH may put it first; nothing else bears the name of this package. Whoever imports it finds those three beside it
from then on, so only programs do, and the processes that they start (links/child_command.py).
"""

import sys
from importlib.machinery import PathFinder
from os.path import dirname  # pathlib would be a tenth of the time that --help takes

PACKAGES = ("groundstation", "links", "sim")
FOLDER = dirname(dirname(__file__))  # noqa: PTH120  # as above


class OwnPackages:
    """Finds our packages beside this one, before any path is looked at; all else is found as ever."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> object:
        """The spec of one of our packages; None for any other module."""
        return PathFinder.find_spec(name, [FOLDER]) if name in PACKAGES else None


# Here and not in a function: a process that multiprocessing spawns imports what its parent's script does, and no more.
sys.meta_path.insert(0, OwnPackages)  # type: ignore[arg-type]  # a class that finds is a finder


def run_groundstation() -> int:
    """The program ``groundstation``."""
    from groundstation.__main__ import main

    return main()


def run_groundstation_sim() -> int:
    """The program ``groundstation-sim``."""
    from sim.__main__ import main

    return main()
