"""``groundstation-sim bench``: what there is to measure. One file for each.

A measurement is a module with ``measure(seconds) -> facts`` (JSON, see docs/reference/bench.md) and
``text(facts) -> lines`` for people. They are edge files: they read the machine's clock.
"""

import argparse
import json
import os
import platform
import sys
from collections.abc import Sequence
from typing import Any

from groundstation.runtime import Exit
from tests.proving.bench import links

WHAT = {"links": links}
"""Name -> module, in the order in which they run."""


def bench(args: argparse.Namespace) -> Exit:
    """Measure this machine."""
    facts = measure_all(args.what or list(WHAT), args.seconds)
    if args.json and args.what == ["links"]:
        facts |= facts.pop("links")
    print(json.dumps(facts) if args.json else text(facts))
    return Exit.DONE


def measure_all(names: Sequence[str], seconds: float) -> dict[str, Any]:
    """The facts of each measurement, and of the machine; each part of ``links`` takes ``seconds`` [s]."""
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
        facts[name] = WHAT[name].measure(seconds)
    return facts


def text(facts: dict[str, Any]) -> str:
    """The facts as lines for people."""
    machine = facts["machine"]
    lines = [f"Python {machine['python']}, {machine['system']}, {machine['cpus']} CPUs, load {machine['load']:.1f}"]
    for name, module in WHAT.items():
        if name in facts:
            lines += ["", f"{name}:", *(f"  {line}" for line in module.text(facts[name]))]
    return "\n".join(lines)
