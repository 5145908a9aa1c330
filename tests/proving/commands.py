"""What ``groundstation-sim faults``, ``soak`` and ``fuzz`` do: break things, go on for long, feed garbage."""

import argparse
import json
import os
import shlex
import sys
from collections.abc import Callable

import msgspec

from groundstation.config import ConfigError
from groundstation.runtime import Exit
from sim.scenarios import scenario_of


def faults(args: argparse.Namespace) -> Exit:
    """Break one thing in every state of a mission."""
    from sim.cli import ProgressBar
    from tests.proving.faults import FAULTS, MOMENTS, Row, deal_cells, fly_all, pick_worst, quick, text, write

    scenario_of(args.scenario)
    for option, value, known in (("--fault", args.fault, FAULTS), ("--state", args.state, MOMENTS)):
        if value is not None and value not in known:
            raise ConfigError(option, f"expected one of {list(known)}, got {value!r}")
    if args.seeds < 1:
        raise ConfigError("--seeds", f"expected 1 or more, got {args.seeds}")
    work = deal_cells(args.fault, args.state)
    if args.quick:
        work = [cell for cell in quick() if cell in work]
    if not work:
        raise ConfigError("--state", f"{args.fault} is not flown there" + (" with --quick" if args.quick else ""))
    flown: list[list[Row]] = []
    with ProgressBar("cells", args.seeds * len(work), quiet=args.json) as counter:
        for number in range(args.seeds):

            def count(done: int, before: int = number * len(work)) -> None:  # that of this round
                counter.at(before + done)

            flown.append(
                fly_all(
                    work,
                    seed=args.seed + number,
                    scenario=args.scenario,
                    overrides=args.overrides,
                    workers=args.workers or os.cpu_count() or 1,
                    on_done=count,
                )
            )
    rows = pick_worst(flown)
    if args.write is not None:
        words = [word for word in sys.argv[1:] if word != "--json"]
        write(args.write, rows, shlex.join(["groundstation-sim", *words]))
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else text(rows))
    return Exit.DONE if all(row.safe for row in rows) else Exit.FAILED


def soak(args: argparse.Namespace) -> Exit:
    """Fly for hours, and see whether anything grows."""
    from sim.cli import ProgressBar
    from tests.proving.soak import soak as fly_on
    from tests.proving.soak import text

    scenario_of(args.scenario)
    with ProgressBar("flying", args.hours, quiet=args.json, unit="h", digits=1) as progress:
        facts = fly_on(args.hours, scenario=args.scenario, seed=args.seed, on_progress=progress.at)
    print(json.dumps(msgspec.to_builtins(facts)) if args.json else text(facts))
    return Exit.DONE if facts.passed else Exit.FAILED


def fuzz(args: argparse.Namespace) -> Exit:
    """Feed decoders random and damaged bytes."""
    from sim.cli import ProgressBar
    from tests.proving.fuzz import LINKS, SOURCES, Subject, fuzz_all, text

    chosen: dict[str, Callable[[], Subject]] = {}
    for option, table in (("source", SOURCES), ("link", LINKS)):
        name = getattr(args, option)
        if name is not None and not any(key.split()[0] == name for key in table):
            raise ConfigError(
                f"--{option}", f"expected one of {sorted({key.split()[0] for key in table})}, got {name!r}"
            )
        if name is not None or (args.source is None and args.link is None):
            chosen |= {key: make for key, make in table.items() if name in (None, key.split()[0])}
    with ProgressBar("datagrams", args.count * len(chosen), quiet=args.json) as counter:
        total = fuzz_all(chosen, args.count, args.seed, counter.at)
    print(json.dumps(msgspec.to_builtins(total)) if args.json else text(total))
    return Exit.DONE if total.exceptions == 0 and total.mismatches == 0 else Exit.FAILED
