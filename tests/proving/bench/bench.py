"""``groundstation-sim bench``: what there is to measure. One file for each.

A measurement is a module with ``measure(options) -> facts`` (JSON, see docs/reference/bench.md) and
``text(facts) -> lines`` for people. They are edge files: they read the machine's clock.
"""

import importlib
import os
import sys
from collections.abc import Callable
from statistics import median
from time import perf_counter
from typing import Any, NamedTuple

from sim.cli import MEASUREMENTS

WHAT = {name: f"tests.proving.bench.{name}" for name in MEASUREMENTS}
"""Name -> module, in the order in which they run."""


class Options(NamedTuple):
    """Options of the command line."""

    peers: bool = False
    """Measure crazyflow and rotorpy beside ours, where they are installed."""
    seconds: float = 30.0
    """Duration of each part of ``links`` [s]."""


def measure_all(names: list[str], options: Options) -> dict[str, Any]:
    """The facts of each measurement, and of the machine."""
    import platform

    facts: dict[str, Any] = {
        "machine": {
            "python": platform.python_version(),
            "system": f"{platform.system()} {platform.machine()}",
            "cpus": os.cpu_count(),
            "load": os.getloadavg()[0],
        }
    }
    for name in names:
        print(f"bench {name} …", file=sys.stderr, flush=True)
        facts[name] = importlib.import_module(WHAT[name]).measure(options)
    return facts


def text(facts: dict[str, Any]) -> str:
    """The facts as lines for people."""
    machine = facts["machine"]
    lines = [f"Python {machine['python']}, {machine['system']}, {machine['cpus']} CPUs, load {machine['load']:.1f}"]
    for name, module in WHAT.items():
        if name in facts:
            lines += ["", f"{name}:", *(f"  {line}" for line in importlib.import_module(module).text(facts[name]))]
    return "\n".join(lines)


def in_turns(runs: dict[str, Callable[[], None]], rounds: int) -> dict[str, float]:
    """The median duration [s] of each of ``runs``, after one round that does not count.

    They take turns (A B A B …), so that a machine that slows down slows all alike.
    """
    times: dict[str, list[float]] = {name: [] for name in runs}
    for turn in range(rounds + 1):
        for name, run in runs.items():
            start = perf_counter()
            run()
            if turn:
                times[name].append(perf_counter() - start)
    return {name: median(found) for name, found in times.items()}
