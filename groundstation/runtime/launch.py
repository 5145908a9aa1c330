"""Launcher: starts this installation's programs, whatever else is called ``sim`` or ``links``.

These are words that a file or a folder of the operator's may bear too, and PYTHONPATH may put it first. Whoever imports
this module finds those packages beside it from then on, so only programs do, and the processes that they start:
``python -P -m groundstation.runtime.launch MODULE …`` (links/io/child.py).
"""

import gc
import runpy
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.machinery import PathFinder
from os.path import dirname  # pathlib would be a tenth of the time that --help takes

PACKAGES = ("groundstation", "links", "sim")
ROOT_FOLDER = dirname(dirname(dirname(__file__)))  # noqa: PTH120  # as above


class OwnPackages:
    """Finds our packages beside this one, before any path is looked at; all else is found as ever."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> object:
        """The spec of one of our packages; None for any other module."""
        return PathFinder.find_spec(name, [ROOT_FOLDER]) if name in PACKAGES else None


# Here and not in a function: a process that multiprocessing spawns imports what its parent's script does, and no more.
sys.meta_path.insert(0, OwnPackages)  # type: ignore[arg-type]  # a class that finds is a finder


def run_groundstation() -> int:
    """The program ``groundstation``."""
    return _run("groundstation", "groundstation")


def run_groundstation_sim() -> int:
    """The program ``groundstation-sim``."""
    return _run("sim", "groundstation-sim")


def _run(package: str, program: str) -> int:
    try:
        code = _end_quickly(lambda: import_module(f"{package}.__main__").main())
    except KeyboardInterrupt:  # while it was loaded: what runs answers for itself
        print(f"{program}: interrupted", file=sys.stderr)
        from groundstation.runtime import Exit  # by now: --help must not wait for it

        return Exit.INTERRUPTED
    assert isinstance(code, int)
    return code


def _end_quickly(program: Callable[[], object]) -> object:
    try:
        return program()
    finally:
        gc.freeze()  # else Python ends by looking for garbage in all that was loaded, for longer than --help takes


if __name__ == "__main__":
    del sys.argv[0]
    _end_quickly(lambda: runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True))
