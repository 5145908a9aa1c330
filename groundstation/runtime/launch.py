"""Launcher: starts this installation's programs, whatever else is called ``sim`` or ``links``.

A file or a folder of the operator's may have the same name, and PYTHONPATH may put it first. After
the import of this module those packages are found beside it, so only programs import it, and the
processes that they start: ``python -P -m groundstation.runtime.launch MODULE …``
(links/io/child.py).
"""

import runpy
import sys
from importlib import import_module
from importlib.machinery import PathFinder
from os.path import dirname  # pathlib would be a tenth of the time that --help takes

PACKAGES = ("groundstation", "links", "sim")
ROOT_FOLDER = dirname(dirname(dirname(__file__)))  # noqa: PTH120  # as above


class OwnPackages:
    """Finds our packages beside this one, before any path is searched.

    Others are found as usual.
    """

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> object:
        """Return the spec of one of our packages; None for any other module."""
        return PathFinder.find_spec(name, [ROOT_FOLDER]) if name in PACKAGES else None


# At import: a process that multiprocessing spawns imports the modules of its parent's script, and
# no more.
sys.meta_path.insert(0, OwnPackages)  # type: ignore[arg-type]  # a class that finds is a finder


def run_groundstation() -> int:
    """Run the program ``groundstation``."""
    return _run("groundstation", "groundstation")


def run_groundstation_sim() -> int:
    """Run the program ``groundstation-sim``."""
    return _run("sim", "groundstation-sim")


def _run(package: str, program: str) -> int:
    try:
        code: int = import_module(f"{package}.__main__").main()
    except KeyboardInterrupt:  # while it was loaded; a running command handles it itself
        print(f"{program}: interrupted", file=sys.stderr)
        from groundstation.runtime import Exit  # by now: --help must not wait for it

        return Exit.INTERRUPTED
    return code


if __name__ == "__main__":
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
