"""``groundstation-sim bench``: how commands keep time on this machine. An edge file: it reads the machine's clock."""

import argparse
import json
import os
import platform
from typing import Any

from groundstation.runtime import Exit
from tests.proving.bench import links


def bench(args: argparse.Namespace) -> Exit:
    """Measure this machine."""
    facts = measure_all(args.seconds)
    if args.json and args.what:
        facts |= facts.pop("links")
    print(json.dumps(facts) if args.json else text(facts))
    return Exit.DONE


def measure_all(seconds: float) -> dict[str, Any]:
    """Return the facts of the machine, and of its links, of which each part takes ``seconds`` [s]."""
    machine = {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpus": os.cpu_count(),
        "load": os.getloadavg()[0],
    }
    return {"machine": machine, "links": links.measure(seconds)}


def text(facts: dict[str, Any]) -> str:
    """Return the facts as lines for people."""
    machine = facts["machine"]
    head = f"Python {machine['python']}, {machine['system']}, {machine['cpus']} CPUs, load {machine['load']:.1f}"
    return "\n".join([head, "", "links:", *(f"  {line}" for line in links.text(facts["links"]))])
