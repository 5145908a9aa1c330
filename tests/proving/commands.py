"""``groundstation-sim dev faults``: break one thing, or disturb what is whole."""

import argparse
import json
import os

import msgspec

from groundstation.config import ConfigError
from groundstation.runtime import Exit
from sim.cli import ProgressBar
from sim.scenarios import scenario_of
from sim.text import notice
from tests.proving.faults import (
    CASES,
    FAULTS,
    MOMENTS,
    Kind,
    Planned,
    check_forced,
    deal_cells,
    fly_all,
    is_within,
    pick_worst,
    text,
    write,
)


def faults(args: argparse.Namespace) -> Exit:
    """Break one thing in every state of a mission."""
    scenario_of(args.scenario)
    kinds = set(args.kind or ())
    cases = list({**CASES, **FAULTS})
    choices = [("--fault", args.fault, cases), ("--state", args.state, list(MOMENTS))]
    choices += [("--kind", kind, list(map(str, Kind))) for kind in args.kind or ()]
    for option, given, known in choices:
        if given is not None and given not in known:
            raise ConfigError(option, notice("value.choice", choices=known, found=given))
    check_forced(args.forced)
    if args.forced and kinds != {Kind.HONEST}:
        raise ConfigError("--forced", notice("dev.forced"))
    cells = deal_cells(args.fault, args.state, args.link)
    work = [cell for cell in cells if not kinds or cell.fault.kind in kinds]
    if not work:
        raise ConfigError("--state", notice("dev.state", fault=args.fault or "nothing"))
    seeds = range(args.seed, args.seed + args.seeds)
    plan = [Planned(cell, args.scenario, seed, args.forced) for seed in seeds for cell in work]
    with ProgressBar("flights", len(plan), quiet=args.json) as counter:
        workers = args.workers or os.cpu_count() or 1
        flown = fly_all(plan, overrides=args.overrides, workers=workers, on_done=counter.at)
    rows = pick_worst([flown[i : i + len(work)] for i in range(0, len(flown), len(work))])
    if args.write is not None:
        write(args.write, rows)
    print(json.dumps({"rows": msgspec.to_builtins(rows)}) if args.json else text(rows))
    return Exit.DONE if is_within(rows) else Exit.FAILED
